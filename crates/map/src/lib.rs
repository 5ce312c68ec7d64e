//! Keyframes, landmarks, covisibility, and immutable views of them.
//!
//! Answers: what stands still, where it is, who saw it. [`Map`] is owned by the mapper alone and is the only thing that
//! changes; everybody else holds an [`MapView`], a version that never changes and costs microseconds to publish. A map becomes
//! the bytes of a [`MapFile`] and back. Does not know images, tracking, optimisation or disks.

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
