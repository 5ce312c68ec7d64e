//! Flow: where each feature was in the frame before, and how the camera moved since.

use super::Tracker;
use super::frame::Observer;
use crate::static_filter::FlowPair;
use stillpoint_features::FlowMatch;
use stillpoint_geometry::{Se3, Vec2};
use stillpoint_map::KeyframeData;

/// Features farther than this from where a static scene would have them are looked at again, px.
const RECHECK_PX: f64 = 1.5;
/// A feature and where it is expected, raw px.
pub(super) type Guess = (usize, [f32; 2]);

/// Depth taken for a feature that has none, m, where only a guess depends on it.
const TYPICAL_DEPTH: f64 = 2.0;

impl Tracker {
    /// Finds the features of the frame in the one before. The guess is that the scene stands still and the camera moves to
    /// `camera_from_world`. Where the filter has no use for features without depth, these are not looked for: they are returned
    /// with their guesses.
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
        let guess = |i: usize| {
            let k = &data.keypoints[i];
            let z = data.depth(i).unwrap_or(TYPICAL_DEPTH);
            let p = last_from_now.transform(&data.camera.backproject(data.position(i), z));
            if p.z <= 0.05 {
                // So near, a small error of the motion throws the projection far off: the feature's own place is the better guess.
                return (i, [k.x, k.y]);
            }
            // The keypoint's own lens and shutter effects are taken to be the same in both frames.
            let shift = data.camera.project(&p) - data.position(i);
            (i, [k.x + shift.x as f32, k.y + shift.y as f32])
        };
        let all = !self.filter.measures_flow_by_depth();
        let (wanted, rest): (Vec<Guess>, Vec<Guess>) = (0..data.len())
            .map(guess)
            .partition(|(i, _)| all || data.depth(*i).is_some());
        let mut pairs = vec![None; data.len()];
        self.front_end
            .observer
            .flow_to_previous(&wanted, &mut pairs);
        (pairs, rest)
    }

    /// Looks again at features that seem to move, from where a static scene would have them: on a keyboard or a shirt one key or
    /// check looks like the next. What is found there stands still.
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
        let mut again = Vec::new();
        for (i, pair) in pairs.iter().enumerate() {
            let Some((pair, z)) = pair.as_ref().zip(data.depth(i)) else {
                continue;
            };
            let p = last_from_now.transform(&data.camera.backproject(pair.now, z));
            if p.z <= 0.05 {
                continue;
            }
            let expected = data.camera.project(&p);
            if (pair.before - expected).norm() > RECHECK_PX {
                again.push((i, data.camera.distort(expected)));
            }
        }
        for ((i, expected), found) in again.iter().zip(self.front_end.observer.flow_again(&again)) {
            if let Some(found) = found.filter(|f| (f.1 - expected).norm() < RECHECK_PX) {
                pairs[*i] = Some(found.0);
            }
        }
    }
}

impl Observer {
    /// Finds some features of the last image in the one before.
    pub(super) fn flow_to_previous(&mut self, guesses: &[Guess], pairs: &mut [Option<FlowPair>]) {
        let _span = tracing::info_span!("flow").entered();
        let keypoints = &self.features.keypoints;
        let point = |(i, _): &Guess| [keypoints[*i].x, keypoints[*i].y];
        let points: Vec<[f32; 2]> = guesses.iter().map(point).collect();
        let expected: Vec<[f32; 2]> = guesses.iter().map(|(_, at)| *at).collect();
        let mut found = Vec::with_capacity(points.len());
        let (now, before) = (self.extractor.pyramid(), self.extractor.previous_pyramid());
        self.flow
            .track(now, before, &points, Some(&expected), &mut found);
        for ((i, _), found) in guesses.iter().zip(found) {
            pairs[*i] = found.map(|f| self.pair(&f, &self.undistorted[*i]).0);
        }
    }

    /// The same for some features, from a raw pixel each; with what is found the raw pixel.
    fn flow_again(&mut self, features: &[(usize, Vec2)]) -> Vec<Option<(FlowPair, Vec2)>> {
        let raw = |f: &(usize, Vec2)| {
            let k = &self.features.keypoints[f.0];
            ([k.x, k.y], [f.1.x as f32, f.1.y as f32])
        };
        let (points, guesses): (Vec<_>, Vec<_>) = features.iter().map(raw).unzip();
        let _span = tracing::info_span!("flow").entered();
        let mut found = Vec::with_capacity(points.len());
        let (now, before) = (self.extractor.pyramid(), self.extractor.previous_pyramid());
        self.flow.look(now, before, &points, &guesses, &mut found);
        let pair = |(found, f): (Option<FlowMatch>, &(usize, Vec2))| {
            Some(self.pair(&found?, &self.undistorted[f.0]))
        };
        found.into_iter().zip(features).map(pair).collect()
    }

    fn pair(&self, found: &FlowMatch, now: &Vec2) -> (FlowPair, Vec2) {
        let before_raw = found.position;
        let raw = Vec2::from(before_raw.map(f64::from));
        let pair = FlowPair {
            before_raw,
            before: self.camera.undistort(raw),
            now: *now,
        };
        (pair, raw)
    }
}
