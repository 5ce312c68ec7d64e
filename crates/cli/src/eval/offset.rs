//! The offset between the clocks of ground truth and estimate: applied where the user gives it, searched where the user asks, and suggested where another one fits far better.

use crate::console;
use crate::failure::Failure;
use stillpoint::evaluation::{EvaluationError, TimedPose, find_offset};

/// The offset that fits best, s; says what it changes.
pub(super) fn best(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    with_scale: bool,
) -> Result<f64, Failure> {
    let found = find_offset(reference, estimate, with_scale).ok_or_else(|| {
        Failure::input(
            "--find-offset: expected a moving camera and trajectories of one time, found none with which an offset could be told; give it with --time-offset",
        )
    })?;
    let without = found.rmse_without.map_or_else(
        || "nothing overlaps".to_owned(),
        |rmse| format!("{:.1} mm", 1e3 * rmse),
    );
    console::info(&format!(
        "{:+.3} s are added to the stamps of the estimate: {:.1} mm; without them {without}",
        found.seconds,
        1e3 * found.rmse
    ));
    Ok(found.seconds)
}

/// Warns where another offset fits far better than the stamps, to which `applied` s were added. `option` is how one is applied.
pub(crate) fn remark(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    (with_scale, applied): (bool, f64),
    option: &str,
) {
    let found = find_offset(reference, estimate, with_scale);
    let Some(found) = found.filter(|f| f.is_far_better()) else {
        return;
    };
    let without = found.rmse_without.unwrap_or_default();
    console::warn(&format!(
        "the clocks of ground truth and estimate seem to be apart: with an offset of {:+.3} s the error is {:.1} mm instead of {:.1}; to apply it: {option} {:.3}",
        found.seconds,
        1e3 * found.rmse,
        1e3 * without,
        applied + found.seconds
    ));
}

/// What helps where too little of both belongs together, as the end of a message; empty where that is not known.
pub(super) fn hint(
    error: &EvaluationError,
    reference: &[TimedPose],
    estimate: &[TimedPose],
    (with_scale, applied): (bool, f64),
) -> String {
    let apart = matches!(
        error,
        EvaluationError::NoOverlap { .. } | EvaluationError::TooFewPairs { .. }
    );
    let found = apart.then(|| find_offset(reference, estimate, with_scale));
    found.flatten().map_or_else(String::new, |found| {
        format!(
            "; an offset of {:+.3} s between the clocks would fit, with an error of {:.1} mm: --time-offset {:.3}",
            found.seconds,
            1e3 * found.rmse,
            applied + found.seconds
        )
    })
}
