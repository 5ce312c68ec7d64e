//! Keyframes, landmarks, covisibility, and immutable views of them.
//!
//! [`Map`] is mutable and owned by the mapper alone; other threads hold a [`MapView`], an immutable version that costs
//! microseconds to publish. A map is converted to the bytes of a [`MapFile`] and back. Independent of images, tracking,
//! optimisation and disks.

mod append;
mod check;
mod correction;
mod file;
mod ids;
mod keyframe;
mod landmark;
mod loops;
mod map;
mod observations;
mod revoke;
mod sparse;
mod view;

pub use append::AppendError;
pub use check::Violation;
pub use correction::{Applied, Correction, Join, LandmarkCorrection, PoseCorrection};
pub use file::{Extension, MapFile, MapFileError};
pub use ids::{KeyframeId, LandmarkId, SubmapId};
pub use keyframe::{Keyframe, KeyframeData, KeyframeSlot};
pub use landmark::{Landmark, ScaleRange};
pub use loops::LoopEdge;
pub use map::Map;
pub use observations::NewLandmark;
pub use view::MapView;
