//! Pose optimisation, triangulation and bundle adjustment: arrays in, results out.
//!
//! Answers: which poses and points explain these observations best. Knows no keyframes, no landmarks and no map. Failing
//! to converge is a result, not an error. All sums are taken in a fixed order.

mod bundle;
mod linearise;
mod observation;
mod pose;
mod schur;
mod triangulate;

pub use bundle::{BundleObservation, BundleOptions, BundleProblem, BundleReport, adjust_bundle};
pub use linearise::{Linearised, linearise};
pub use observation::{Intrinsics, Measurement};
pub use pose::{PoseEstimate, PoseObservation, PoseOptions, optimise_pose};
pub use triangulate::{Triangulation, triangulate_midpoint};
