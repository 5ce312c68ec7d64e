//! ATE, RPE, timing statistics and plots of trajectories; scores of tracked objects.
//!
//! Answers: the error of an estimated trajectory against the truth (Sturm et al., "A benchmark for the evaluation of RGB-D SLAM systems",
//! IROS 2012), and run times. Knows trajectories only, not their origin or files. [`score`] does everything; [`evaluate`], [`drift`] and
//! [`associate`] are its parts. [`coverage`] judges covariances. [`objects`] scores tracked boxes.

mod associate;
mod ate;
mod coverage;
mod error;
pub mod objects;
mod offset;
mod order;
pub mod plot;
mod report;
mod rpe;
mod score;
mod statistics;
pub mod timing;

pub use associate::{DEFAULT_MAX_DT, associate};
pub use ate::{Ate, PairError, absolute_error};
pub use coverage::{Coverage, coverage, motion_coverage};
pub use error::EvaluationError;
pub use offset::{Offset, find_offset};
pub use order::{OrderOf, OtherOrder, find_other_order};
pub use report::{Align, Table};
pub use rpe::{Delta, RelativeError, Rpe, relative_error};
pub use score::{Drift, EvalOptions, Evaluation, Score, drift, evaluate, is_fixed, score};
pub use statistics::Statistics;

use stillpoint_geometry::Se3;

/// A camera pose at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TimedPose {
    /// Time, s.
    pub stamp: f64,
    /// Pose: maps camera coordinates to world coordinates, m.
    pub world_from_camera: Se3,
}
