//! Keyframes.

use crate::{KeyframeId, LandmarkId, SubmapId};
use std::sync::Arc;
use stillpoint_features::{Descriptor, FeatureGrid, Keypoint, Searched};
use stillpoint_geometry::{Camera, Se3, Vec2, Vec3};

/// Features of a frame. Immutable after extraction, so frames, keyframes and views share them.
#[derive(Clone, Debug)]
pub struct KeyframeData {
    /// Stamp of the colour image, s.
    pub stamp: f64,
    /// The camera; positions are undistorted with it.
    pub camera: Camera,
    /// Keypoints in the raw image.
    pub keypoints: Vec<Keypoint>,
    /// Undistorted positions, px.
    pub positions: Vec<[f32; 2]>,
    /// Standard deviation of each position, px.
    pub sigma_px: Vec<f32>,
    /// Depths, m; 0 where unknown.
    pub depths: Vec<f32>,
    /// Standard deviation of each depth, m; 0 where unknown.
    pub depth_sigmas: Vec<f32>,
    /// Descriptors, shared with place recognition.
    pub descriptors: Arc<Vec<Descriptor>>,
    /// Whether each feature may observe or become a landmark: false on movable objects and where motion was detected
    /// later ([`crate::Map::disown`]).
    pub mappable: Vec<bool>,
    /// Buckets over `positions`, within [`KeyframeData::grid_bounds`] of the camera.
    pub grid: FeatureGrid,
}

impl KeyframeData {
    /// Bounds of `grid`, px: min x, min y, max x, max y. Map files do not store the grid and rely on these bounds.
    #[must_use]
    pub fn grid_bounds(camera: &Camera) -> [f32; 4] {
        camera.undistorted_bounds().map(|b| b as f32)
    }

    /// Number of features.
    #[must_use]
    pub fn len(&self) -> usize {
        self.keypoints.len()
    }

    /// True when there is no feature.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.keypoints.is_empty()
    }

    /// A deep copy with minimal allocations.
    #[must_use]
    pub fn copied(&self) -> Self {
        Self {
            descriptors: Arc::new(self.descriptors.to_vec()),
            ..self.clone()
        }
    }

    /// Median of the known depths, m; `None` if there are none. `memory` is a reusable sort buffer.
    #[must_use]
    pub fn median_depth(&self, memory: &mut Vec<f32>) -> Option<f64> {
        memory.clear();
        memory.reserve(self.depths.len());
        memory.extend(self.depths.iter().filter(|z| **z > 0.0));
        let middle = memory.len() / 2;
        (!memory.is_empty()).then(|| {
            let (_, median, _) = memory.select_nth_unstable_by(middle, f32::total_cmp);
            f64::from(*median)
        })
    }

    /// The features, for searches.
    #[must_use]
    pub fn searched(&self) -> Searched<'_> {
        Searched {
            grid: &self.grid,
            positions: &self.positions,
            descriptors: &self.descriptors,
        }
    }

    /// Undistorted pixel of a feature.
    #[must_use]
    pub fn position(&self, index: usize) -> Vec2 {
        let [x, y] = self.positions[index];
        Vec2::new(f64::from(x), f64::from(y))
    }

    /// Depth of a feature, m.
    #[must_use]
    pub fn depth(&self, index: usize) -> Option<f64> {
        let z = self.depths[index];
        (z > 0.0).then_some(f64::from(z))
    }

    /// The point (m, camera coordinates) that a feature with depth sees.
    #[must_use]
    pub fn point_in_camera(&self, index: usize) -> Option<Vec3> {
        let z = self.depth(index)?;
        Some(self.camera.backproject(self.position(index), z))
    }
}

/// A frame kept in the map.
#[derive(Clone, Debug)]
pub struct Keyframe {
    /// Number of its frame.
    pub id: KeyframeId,
    /// Its features.
    pub data: Arc<KeyframeData>,
    /// Its pose.
    pub world_from_camera: Se3,
    /// The landmark that each feature observes.
    pub matches: Vec<Option<LandmarkId>>,
    /// Covisible keyframes with the number of shared landmarks, in descending order; ties by id.
    pub covisible: Vec<(KeyframeId, u32)>,
    /// The keyframe it was tracked from; `None` for the first of a submap.
    pub parent: Option<KeyframeId>,
    /// Its submap, whose frame of reference its pose is in.
    pub submap: SubmapId,
}

impl Keyframe {
    /// Centre of the camera, m, world coordinates.
    #[must_use]
    pub fn centre(&self) -> Vec3 {
        self.world_from_camera.translation
    }
}

/// State of a keyframe id.
#[derive(Clone, Debug, Default)]
pub enum KeyframeSlot {
    /// The frame did not become a keyframe.
    #[default]
    Empty,
    /// A keyframe of the map.
    Live(Arc<Keyframe>),
    /// Removed as redundant: its pose is stored relative to another keyframe.
    Culled {
        /// The reference keyframe.
        parent: KeyframeId,
        /// Its pose relative to that keyframe.
        parent_from_this: Se3,
    },
}
