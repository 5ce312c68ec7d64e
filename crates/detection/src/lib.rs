//! Object detectors behind one trait, and tracking of the detected objects.
//!
//! Tracked objects are predicted where detections are missed or arrive late. The decision on rejected features is in
//! crate `slam` (static filter); no files are read here.

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
