//! Object detectors behind one trait, and the objects they see, tracked through time.
//!
//! Answers: which things of which class are where in an image, and where each of them is now although the detector
//! missed it or answers late. Does not decide what is rejected (crate `slam`, static filter) and reads no files.

mod classes;
mod detections;
mod detector;
mod hash;
mod objects;
mod scripted;
mod weights;

pub use detections::{BoundingBox, ClassId, Detection, Detections};
pub use detector::{DetectError, Detector, DetectorInfo, DetectorKind, NoDetector};
pub use objects::{
    MOST_DETECTIONS, Motion, Object, ObjectId, ObjectInCamera, ObjectState, ObjectTracker,
    ObjectsConfig,
};
pub use scripted::{
    SCRIPT_HEADER, ScriptError, ScriptRow, ScriptUse, ScriptedDetector, format_script, parse_script,
};
pub use weights::{MotionWeights, WeightError};
