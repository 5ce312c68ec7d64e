//! Pairs of image rows from which the readout is learned.

use super::ego_motion::EgoMotion;
use super::self_calibration::{Between, RowPair};
use super::state::LastFrame;
use super::{Solution, Tracker};
use crate::static_filter::{FeatureVerdict, FlowPair};
use std::collections::BTreeMap;
use stillpoint_geometry::Vec2;
use stillpoint_map::{KeyframeData, LandmarkId};

/// Minimum standard deviation of flow, px: errors of corners on edges, and of depths.
const SIGMA_PX: f64 = 0.5;

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
            sigma: libm::hypot(sigmas[0], sigmas[1]),
        })
    };
    let matches = solution.matches.iter().enumerate();
    matches.filter_map(pair).collect()
}

#[cfg(test)]
mod tests;
