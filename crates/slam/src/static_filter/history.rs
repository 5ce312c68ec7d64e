//! What the filter remembers of earlier frames: their coarse depth and where they were taken from.

use std::collections::VecDeque;
use std::sync::Arc;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{CoarseDepth, FrameId};
use stillpoint_map::{KeyframeId, MapView};

/// Frames are kept for comparison this long, s.
const SPAN: f64 = 3.2;

/// A frame kept for later comparison.
pub(super) struct Snapshot {
    pub(super) frame: FrameId,
    pub(super) stamp: f64,
    pub(super) grid: Arc<CoarseDepth>,
    /// Per cell, whether it was found to move.
    pub(super) moving: Vec<bool>,
    /// The reference keyframe of its time, and poses relative to it, so that they follow every correction of the map.
    reference: KeyframeId,
    reference_from_camera: Se3,
    camera_from_depth: Se3,
    /// For as long as no view of the map holds the reference keyframe.
    world_from_camera: Se3,
}

impl Snapshot {
    /// The camera's pose at the colour stamp, in a view of the map.
    pub(super) fn world_from_camera(&self, view: &MapView) -> Se3 {
        view.world_from_keyframe(self.reference)
            .map_or(self.world_from_camera, |w| w * self.reference_from_camera)
    }

    /// The camera's pose at the exposure of the depth image, in a view of the map.
    pub(super) fn world_from_depth(&self, view: &MapView) -> Se3 {
        self.world_from_camera(view) * self.camera_from_depth
    }
}

/// Where a frame was taken from, as tracking found it.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Place {
    /// The reference keyframe.
    pub(crate) reference: KeyframeId,
    /// The camera relative to it.
    pub(crate) reference_from_camera: Se3,
    /// The camera in the view of that time.
    pub(crate) world_from_camera: Se3,
    /// The camera's motion between the exposures of the depth and the colour image.
    pub(crate) camera_from_depth: Se3,
}

/// The frames of the last seconds, oldest first.
#[derive(Default)]
pub(super) struct History(VecDeque<Snapshot>);

impl History {
    pub(super) fn push(
        &mut self,
        frame: FrameId,
        stamp: f64,
        grid: Arc<CoarseDepth>,
        moving: Vec<bool>,
        place: &Place,
    ) {
        // A clock that jumps back makes everything remembered worthless for comparison by age.
        if self.0.back().is_some_and(|s| s.stamp >= stamp) {
            self.0.clear();
        }
        while self.0.front().is_some_and(|s| stamp - s.stamp > SPAN) {
            self.0.pop_front();
        }
        self.0.push_back(Snapshot {
            frame,
            stamp,
            grid,
            moving,
            reference: place.reference,
            reference_from_camera: place.reference_from_camera,
            camera_from_depth: place.camera_from_depth,
            world_from_camera: place.world_from_camera,
        });
    }

    /// The last frame.
    pub(super) fn last(&self) -> Option<&Snapshot> {
        self.0.back()
    }

    /// A frame by its id, while it is remembered.
    pub(super) fn get(&self, frame: FrameId) -> Option<&Snapshot> {
        let i = self.0.binary_search_by_key(&frame, |s| s.frame).ok()?;
        self.0.get(i)
    }

    /// The newest frames that are at least as old as each age (s, ascending) before `stamp`, without repetition.
    pub(super) fn at_ages(&self, stamp: f64, ages: &[f64]) -> Vec<&Snapshot> {
        let mut indices: Vec<usize> = ages
            .iter()
            .filter_map(|age| {
                self.0
                    .partition_point(|s| s.stamp <= stamp - age)
                    .checked_sub(1)
            })
            .collect();
        indices.dedup();
        indices.into_iter().map(|i| &self.0[i]).collect()
    }
}
