//! Optical flow of features to the last frame.

use super::Tracker;
use super::flow_search::Guess;
use super::motion::CameraMotion;
use crate::sensor::DepthReader;
use crate::shutter::TYPICAL_DEPTH;
use crate::static_filter::FlowPair;
use stillpoint_geometry::{Se3, Vec2, Vec6};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::KeyframeData;

impl Tracker {
    /// Camera motion for a pose `camera_from_world` of the current frame.
    pub(super) fn motion_to(&self, camera_from_world: &Se3) -> CameraMotion {
        let now = self.front_end.clock.now();
        let motion = self.state.motion_to(camera_from_world, now);
        motion.turning(self.turning())
    }

    /// Searches the features in the last image, starting from positions in a static scene with pose
    /// `camera_from_world`. If the filter does not need features without depth, these are not searched but returned
    /// with their predictions, except near moving surfaces.
    pub(super) fn flow(
        &mut self,
        data: &KeyframeData,
        camera_from_world: &Se3,
    ) -> (Vec<Option<FlowPair>>, Vec<Guess>) {
        let wanted = self.filter.wants_flow();
        let Some(last) = self.state.tracked().filter(|_| wanted) else {
            return (Vec::new(), Vec::new());
        };
        let last_from_now = last.world_from_camera.inverse() * camera_from_world.inverse();
        let motion = self.motion_to(camera_from_world);
        let (now, before) = (motion.at_last(), motion.at_before());
        let shutter = self.front_end.shutter();
        let undistorted = &self.front_end.observer.undistorted;
        let guess = |i: usize| {
            let k = &data.keypoints[i];
            let z = data.depth(i).unwrap_or(TYPICAL_DEPTH);
            let seen = shutter.at_stamp(undistorted[i], f64::from(k.y), z, now.as_ref());
            let p = last_from_now.transform(&seen);
            if p.z <= 0.05 {
                // So near, small motion errors have a large effect; the feature's own pixel is a better guess.
                return (i, [k.x, k.y]);
            }
            let raw = shutter.exposed(&p, before.as_ref());
            (i, [raw.x as f32, raw.y as f32])
        };
        let all = !self.filter.measures_flow_by_depth();
        let [mut wanted, mut rest] = std::array::from_fn(|_| self.memory.guesses.take());
        for (i, at) in (0..data.len()).map(guess) {
            let which = if all || data.depth(i).is_some() || self.filter.is_suspect(at) {
                &mut wanted
            } else {
                &mut rest
            };
            which.push((i, at));
        }
        let mut pairs = self.memory.pairs.take();
        pairs.resize(data.len(), None);
        let (search, images) = self.front_end.observer.flow();
        search.search(&images, &wanted, &mut pairs);
        self.memory.guesses.give(wanted);
        self.bring_to_stamps(data, &mut pairs, &motion);
        (pairs, rest)
    }

    /// Corrects both ends of the pairs for rolling shutter, with the velocities at their own frames.
    pub(super) fn bring_to_stamps(
        &self,
        data: &KeyframeData,
        pairs: &mut [Option<FlowPair>],
        motion: &CameraMotion,
    ) {
        let shutter = self.front_end.shutter();
        let (now, before) = (motion.at_last(), motion.at_before());
        let unsteady = motion.unsteadiness();
        let observer = &self.front_end.observer;
        for (i, pair) in pairs.iter_mut().enumerate() {
            let Some(pair) = pair else { continue };
            let z = data.depth(i).unwrap_or(TYPICAL_DEPTH);
            let at_stamp = |pixel: Vec2, y: f32, v: &Option<Vec6>| {
                let p = shutter.at_stamp(pixel, f64::from(y), z, v.as_ref());
                data.camera.project(&p)
            };
            pair.now = at_stamp(observer.undistorted[i], data.keypoints[i].y, &now);
            pair.before = at_stamp(pair.before_exposed, pair.before_raw[1], &before);
            pair.shutter_sigma = shutter.sigma_px(f64::from(pair.before_raw[1]), unsteady);
        }
    }

    /// Reader for the depths of a frame, taken while the camera moved by `velocity`.
    pub(super) fn depth_reader<'a>(
        &'a self,
        frame: &'a RgbdFrame,
        velocity: Option<&Vec6>,
    ) -> DepthReader<'a> {
        let dt = self.front_end.depth_lag(frame);
        let camera = &self.front_end.observer.camera;
        DepthReader::new(&self.setup.sensor, camera, &frame.depth, velocity, dt)
    }
}

#[cfg(test)]
pub(super) mod tests;
