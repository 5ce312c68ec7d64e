//! Landmarks.

use crate::{KeyframeId, LandmarkId};
use stillpoint_features::Descriptor;
use stillpoint_geometry::Vec3;

/// Distances (m) from which a landmark can be recognised; outside, its image is too large or small for the pyramid.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleRange {
    /// Distance at which it appears on the coarsest level.
    pub min_distance: f32,
    /// Distance at which it appears on the finest level.
    pub max_distance: f32,
}

/// A static point.
#[derive(Clone, Debug)]
pub struct Landmark {
    /// The keyframe that carries it: pose corrections of this keyframe move the landmark. Always an observer.
    pub anchor: KeyframeId,
    /// Position in the anchor's camera coordinates, m.
    pub position_in_anchor: Vec3,
    /// Mean viewing direction (from camera to landmark, unit length), in the anchor's axes.
    pub direction_in_anchor: Vec3,
    /// Distances from which it can be recognised.
    pub scale_range: ScaleRange,
    /// Medoid of the descriptors of its observations.
    pub descriptor: Descriptor,
    /// Number of keyframes that observe it.
    pub observers: u32,
    /// Of these, the ones with a measured depth.
    pub depth_observers: u32,
    /// The keyframe that created it.
    pub created_at: KeyframeId,
    /// Frames in which it was expected to be visible.
    pub visible: u32,
    /// Frames in which it was found.
    pub found: u32,
    /// Log odds of being static: raised by every frame in which it was found, lowered by every frame in which the
    /// camera saw through its position.
    pub static_odds: f32,
}

#[derive(Clone, Copy, Debug)]
pub(crate) enum LandmarkSlot<'a> {
    Live(&'a Landmark),
    Merged(LandmarkId),
    Culled,
}
