//! Objects: what a detector sees, followed through time.
//!
//! Answers: where every object is in the image of any pose and stamp, how it moves, and whether it has been standing still. Bridges what the detector
//! misses or answers late. Does not decide which features are rejected. One module each for the filter with depth (`spatial`), the one without (`planar`),
//! what a detection measures (`measurement`, `depth`), the assignment (`associate`, `occlusion`), the life of an object (`track`, `tracker`, `duplicates`).

mod associate;
mod config;
mod depth;
mod duplicates;
mod kalman;
mod measurement;
mod occlusion;
mod planar;
mod rigidity;
mod spatial;
mod track;
mod tracker;
mod view;

pub use config::ObjectsConfig;
pub use rigidity::Motion;
pub use tracker::ObjectTracker;

use crate::{BoundingBox, ClassId};
use stillpoint_geometry::{Mat6, Vec3};

/// Number of an object; never used again.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct ObjectId(pub u32);

/// How sure it is that an object is there.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum ObjectState {
    /// Seen once: may be a false alarm, masks all the same.
    Tentative,
    /// Seen at least twice, and in the newest detections.
    Confirmed,
    /// Seen at least twice, but not in the newest detections.
    Coasting,
}

/// An object at a stamp, seen from a camera.
#[derive(Clone, Debug, PartialEq)]
pub struct Object {
    /// Which one.
    pub id: ObjectId,
    /// What it is.
    pub class: ClassId,
    /// Score of its last detection, 0 to 1.
    pub score: f32,
    /// How sure it is.
    pub state: ObjectState,
    /// Where it is expected in the raw image, px, cut to the image; without area when it is outside the view.
    pub bounds: BoundingBox,
    /// Standard deviation of the box's vertical and of its horizontal sides, px: how far the object may reach beyond the box. Zero behind the camera.
    pub bounds_sigma: [f64; 2],
    /// Nearest and farthest depth (camera z, m) of its surface, widened by the standard deviation of its predicted depth; `None` without depth or
    /// behind the camera.
    pub depth_range: Option<[f64; 2]>,
    /// Middle of its visible surface in the world, m; `None` while no depth of it was seen.
    pub position: Option<Vec3>,
    /// Velocity in the world, m/s; `None` with the position.
    pub velocity: Option<Vec3>,
    /// Covariance of position and velocity (m^2, m^2/s, m^2/s^2), in this order; `None` with the position.
    pub covariance: Option<Mat6>,
    /// Width and height, m; `None` with the position.
    pub size: Option<[f64; 2]>,
    /// Stamp of its last detection, s.
    pub last_seen: f64,
    /// Whether it moves.
    pub motion: Motion,
}
