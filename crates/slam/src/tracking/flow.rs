//! Optical flow of features to the last frame.

use super::ego_motion::EgoMotion;
use super::frame::Observer;
use super::motion::CameraMotion;
use super::self_calibration::{Between, RowPair};
use super::state::LastFrame;
use super::{Solution, Tracker};
use crate::sensor::DepthReader;
use crate::shutter::TYPICAL_DEPTH;
use crate::static_filter::{FeatureVerdict, FlowPair};
use std::collections::BTreeMap;
use stillpoint_features::FlowMatch;
use stillpoint_geometry::{Camera, Se3, Vec2, Vec6};
use stillpoint_imaging::RgbdFrame;
use stillpoint_map::{KeyframeData, LandmarkId};

/// Distance from the position in a static scene beyond which a feature is searched again, px: flow errs by as much in
/// blurred images (decision 23).
const RECHECK_PX: f32 = 1.5;
/// Minimum standard deviation of flow, px: errors of corners on edges, and of depths.
const SIGMA_PX: f64 = 0.5;
/// Every n-th feature is searched at all scales. Chosen: a median of 100 is as steady as one of 125, and more take more
/// time (decision 55).
const SCOUT: usize = 10;
/// A feature index and its predicted raw pixel.
pub(super) type Guess = (usize, [f32; 2]);

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
        self.front_end
            .observer
            .flow_to_previous(&wanted, &mut pairs);
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

    /// Searches features that seem to move again, near their positions in a static scene: repetitive textures such as
    /// keyboards or shirts are ambiguous. A match there is static.
    pub(super) fn recheck_flow(
        &mut self,
        data: &KeyframeData,
        pairs: &mut [Option<FlowPair>],
        camera_from_world: &Se3,
    ) {
        let Some(last) = self.state.last() else {
            return;
        };
        let last_from_now = last.world_from_camera.inverse() * camera_from_world.inverse();
        let motion = self.motion_to(camera_from_world);
        let before = motion.at_before();
        let shutter = self.front_end.shutter();
        let mut again = std::mem::take(&mut self.memory.again);
        again.clear();
        for (i, pair) in pairs.iter().enumerate() {
            let Some((pair, z)) = pair.as_ref().zip(data.depth(i)) else {
                continue;
            };
            let p = last_from_now.transform(&data.camera.backproject(pair.now, z));
            if p.z <= 0.05 {
                continue;
            }
            if (pair.before - data.camera.project(&p)).norm() > f64::from(RECHECK_PX) {
                let raw = shutter.exposed(&p, before.as_ref());
                again.push((i, [raw.x as f32, raw.y as f32]));
            }
        }
        self.front_end.observer.flow_again(&again, pairs);
        self.memory.again = again;
        self.bring_to_stamps(data, pairs, &motion);
    }
}

impl Tracker {
    /// Adds to `rows` the static features of this frame that flow finds in the frame before, as exposed.
    pub(super) fn followed(
        &self,
        motion: &EgoMotion,
        verdicts: &[FeatureVerdict],
        rows: &mut Vec<RowPair>,
    ) {
        let data = &motion.data;
        let observer = &self.front_end.observer;
        let pair = |(i, pair): (usize, &Option<FlowPair>)| {
            let pair = pair.as_ref().filter(|_| !verdicts[i].dynamic)?;
            Some(RowPair {
                now: (observer.undistorted[i], f64::from(data.keypoints[i].y)),
                before: (pair.before_exposed, f64::from(pair.before_raw[1])),
                z: data.depth(i)?,
                sigma: libm::hypot(SIGMA_PX, pair.flow_sigma),
            })
        };
        rows.reserve(motion.pairs.len());
        rows.extend(motion.pairs.iter().enumerate().filter_map(pair));
    }

    /// Updates the readout estimate with the camera motion to this frame.
    pub(super) fn learn_readout(&mut self, solution: &mut Solution) {
        let newest = self.state.tracked().map(|last| Between {
            before_from_now: last.world_from_camera.inverse()
                * solution.camera_from_world.inverse(),
            seconds: self.front_end.clock.now() - last.time,
            pairs: if solution.followed.is_empty() {
                seen_twice(last, solution)
            } else {
                std::mem::take(&mut solution.followed)
            },
        });
        if let Some(rows) = self.front_end.learn(newest) {
            self.memory.rows.give(rows);
        }
    }
}

/// Landmarks seen in both frames, where no flow is available.
fn seen_twice(last: &LastFrame, solution: &Solution) -> Vec<RowPair> {
    let seen = last.matches.iter().enumerate();
    let features: BTreeMap<LandmarkId, usize> =
        seen.filter_map(|(i, id)| Some(((*id)?, i))).collect();
    let data = &solution.data;
    let pixel = |data: &KeyframeData, i: usize| {
        let k = &data.keypoints[i];
        let raw = Vec2::new(f64::from(k.x), f64::from(k.y));
        (data.camera.undistort(raw), raw.y)
    };
    let pair = |(i, id): (usize, &Option<LandmarkId>)| {
        let before = *features.get(&(*id)?)?;
        let sigmas = [data.sigma_px[i], last.data.sigma_px[before]].map(f64::from);
        Some(RowPair {
            now: pixel(data, i),
            before: pixel(&last.data, before),
            z: data.depth(i)?,
            // Keypoint deviations hold for arbitrary views; between consecutive frames they are half as large.
            sigma: 0.5 * libm::hypot(sigmas[0], sigmas[1]),
        })
    };
    let matches = solution.matches.iter().enumerate();
    matches.filter_map(pair).collect()
}

/// Standard deviation of a flow vector, px, from its forward-backward error. In blurred images, with few gradients,
/// both grow alike.
fn flow_sigma(forward_backward: f64) -> f64 {
    0.08 + 0.85 * libm::sqrt(forward_backward)
}

impl Observer {
    /// Searches features of this image in the last one. A hand accelerates, so all static predictions are off by about
    /// the same. Every [`SCOUT`]th feature is searched at all scales to measure that offset; the others are searched
    /// near their predictions, with and without it.
    pub(super) fn flow_to_previous(&mut self, guesses: &[Guess], pairs: &mut [Option<FlowPair>]) {
        let _span = tracing::info_span!("flow").entered();
        let mut memory = std::mem::take(&mut self.flow_memory);
        memory.sought.clear();
        memory.sought.extend(guesses.iter().step_by(SCOUT));
        self.find(Reach::Far, &mut memory, pairs);
        let [x, y] = memory.middle_off();
        let others = guesses.chunks(SCOUT).flat_map(|guesses| &guesses[1..]);
        memory.sought.clear();
        let corrected = others.clone().map(|(i, at)| (*i, [at[0] + x, at[1] + y]));
        memory.sought.extend(corrected);
        self.find(Reach::Near, &mut memory, pairs);
        memory.sought.clear();
        let lost = others.filter(|(i, _)| pairs[*i].is_none());
        memory.sought.extend(lost);
        self.find(Reach::Near, &mut memory, pairs);
        self.flow_memory = memory;
    }

    /// Searches some features again, each around a raw pixel, and accepts matches near it.
    fn flow_again(&mut self, features: &[Guess], pairs: &mut [Option<FlowPair>]) {
        let _span = tracing::info_span!("flow").entered();
        let mut memory = std::mem::take(&mut self.flow_memory);
        memory.sought.clear();
        memory.sought.extend(features);
        self.look_up(Reach::Near, &mut memory);
        let off = |[x, y]: [f32; 2], at: [f32; 2]| libm::hypotf(x - at[0], y - at[1]);
        for ((i, expected), found) in memory.sought.iter().zip(&memory.found) {
            if let Some(found) = found.filter(|f| off(f.position, *expected) < RECHECK_PX) {
                pairs[*i] = Some(pair(&self.camera, &found, &self.undistorted[*i]));
            }
        }
        self.flow_memory = memory;
    }

    /// Searches the pending features and stores the pairs found.
    fn find(&mut self, reach: Reach, memory: &mut FlowMemory, pairs: &mut [Option<FlowPair>]) {
        self.look_up(reach, memory);
        for ((i, _), found) in memory.sought.iter().zip(&memory.found) {
            pairs[*i] = found.map(|f| pair(&self.camera, &f, &self.undistorted[*i]));
        }
    }

    /// Searches the pending features in the last image.
    fn look_up(&mut self, reach: Reach, memory: &mut FlowMemory) {
        let keypoints = &self.features.keypoints;
        let FlowMemory {
            sought,
            points,
            expected,
            found,
            ..
        } = memory;
        points.clear();
        points.extend(
            sought
                .iter()
                .map(|(i, _)| [keypoints[*i].x, keypoints[*i].y]),
        );
        expected.clear();
        expected.extend(sought.iter().map(|(_, at)| *at));
        let (now, before) = (self.extractor.pyramid(), self.extractor.previous_pyramid());
        match reach {
            Reach::Far => self.flow.track(now, before, points, Some(expected), found),
            Reach::Near => self.flow.look(now, before, points, expected, found),
        }
    }
}

#[derive(Clone, Copy)]
enum Reach {
    /// All scales.
    Far,
    /// Finest scale only: within half a window.
    Near,
}

#[derive(Default)]
pub(super) struct FlowMemory {
    sought: Vec<Guess>,
    points: Vec<[f32; 2]>,
    expected: Vec<[f32; 2]>,
    found: Vec<Option<FlowMatch>>,
    off: Vec<f32>,
}

impl FlowMemory {
    /// Median offset of found features from their predictions, px; zero if none was found.
    fn middle_off(&mut self) -> [f32; 2] {
        [0, 1].map(|k| {
            let found = self.expected.iter().zip(&self.found);
            let off = found.filter_map(|(at, found)| Some(found.as_ref()?.position[k] - at[k]));
            self.off.clear();
            self.off.extend(off);
            let middle = self.off.len() / 2;
            if self.off.is_empty() {
                return 0.0;
            }
            *self.off.select_nth_unstable_by(middle, f32::total_cmp).1
        })
    }
}

/// Both ends as exposed.
fn pair(camera: &Camera, found: &FlowMatch, now: &Vec2) -> FlowPair {
    let before = camera.undistort(found.position.map(f64::from).into());
    FlowPair {
        before_raw: found.position,
        before_exposed: before,
        before,
        now: *now,
        flow_sigma: flow_sigma(f64::from(found.forward_backward)),
        shutter_sigma: 0.0,
    }
}

#[cfg(test)]
mod tests;
