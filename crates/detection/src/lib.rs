//! Object detectors behind one trait, and the objects they see, tracked through time.
//!
//! Answers: which things of which class are where in an image, and where each of them is now although the detector
//! missed it or answers late. Does not decide what is rejected (crate `slam`, static filter) and reads no files.

mod detections;

pub use detections::{BoundingBox, ClassId, Detection, Detections};
