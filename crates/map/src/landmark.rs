//! Landmarks.

use crate::{KeyframeId, LandmarkId};
use stillpoint_features::Descriptor;
use stillpoint_geometry::Vec3;

/// Distances (m) from which a landmark can be recognised: outside, its image is too large or small for the pyramid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleRange {
    /// Distance at which it would appear on the coarsest level.
    pub min_distance: f32,
    /// Distance at which it would appear on the finest level.
    pub max_distance: f32,
}

/// A point that stands still.
#[derive(Clone, Debug)]
pub struct Landmark {
    /// The keyframe that carries it: the landmark moves when its pose is corrected. Always one that observes it.
    pub anchor: KeyframeId,
    /// Position in the anchor's camera coordinates, m.
    pub position_in_anchor: Vec3,
    /// Mean direction from which it was seen (from camera to landmark, unit length), in the anchor's axes.
    pub direction_in_anchor: Vec3,
    /// Distances from which it can be recognised.
    pub scale_range: ScaleRange,
    /// Medoid of the descriptors of its observations.
    pub descriptor: Descriptor,
    /// Number of keyframes that observe it.
    pub observers: u32,
    /// Of these, the ones that measured its depth.
    pub depth_observers: u32,
    /// The keyframe at which it was made.
    pub created_at: KeyframeId,
    /// Frames in which it was expected to be seen.
    pub visible: u32,
    /// Frames in which it was found.
    pub found: u32,
    /// How likely it is to stand still, in log odds: grows with every frame in which it was found, falls with every one in
    /// which the camera saw through its place.
    pub static_odds: f32,
}

/// What a landmark id stands for.
#[derive(Clone, Copy, Debug)]
pub(crate) enum LandmarkSlot<'a> {
    /// A landmark of the map.
    Live(&'a Landmark),
    /// The same as another: follow that one.
    Merged(LandmarkId),
    /// Removed.
    Culled,
}
