//! Errors of the comparison of two trajectories.

/// Error: two trajectories cannot be compared.
#[derive(Clone, Debug, PartialEq, thiserror::Error)]
#[non_exhaustive]
pub enum EvaluationError {
    /// A trajectory has no pose.
    #[error("the {which} holds no pose: expected at least 3")]
    Empty {
        /// `"ground truth"` or `"estimate"`.
        which: &'static str,
    },
    /// The stamps of a trajectory do not ascend, or a number in it is not finite.
    #[error(
        "the {which} is broken at pose {index} (from 0): expected finite numbers and stamps that ascend"
    )]
    Broken {
        /// `"ground truth"` or `"estimate"`.
        which: &'static str,
        /// Index of the pose, from 0.
        index: usize,
    },
    /// No stamps of the two trajectories are close to each other.
    #[error(
        "no overlap in time: the ground truth covers {:.3} to {:.3} s, the estimate {:.3} to {:.3} s, and no stamps are within {max_dt} s of each other; check that both use the same clock and belong to the same sequence",
        reference.0, reference.1, estimate.0, estimate.1
    )]
    NoOverlap {
        /// First and last stamp of the ground truth, s.
        reference: (f64, f64),
        /// First and last stamp of the estimate, s.
        estimate: (f64, f64),
        /// Maximum difference, s.
        max_dt: f64,
    },
    /// Alignment needs three pairs.
    #[error(
        "only {pairs} poses have ground truth within {max_dt} s: expected at least 3 to align the trajectories"
    )]
    TooFewPairs {
        /// Number of pairs.
        pairs: usize,
        /// Maximum difference, s.
        max_dt: f64,
    },
    /// The camera does not move in the ground truth, so alignment is not defined.
    #[error(
        "the camera stands still in the ground truth (it stays within {extent:.6} m), so that nothing fixes the alignment; use the drift from the first pose instead of the ATE"
    )]
    FixedReference {
        /// Largest distance from the first pose, m.
        extent: f64,
    },
    /// All poses of the estimate are at one position.
    #[error(
        "the estimate stays at one place while the ground truth moves: nothing fixes the alignment"
    )]
    FixedEstimate,
}
