//! The clock offset between ground truth and estimate: applied where given, searched on request, and suggested where another one fits far
//! better.

use crate::console;
use crate::failure::Failure;
use stillpoint::evaluation::{EvaluationError, TimedPose, find_offset};

/// The best offset, s; prints how it changes the fit.
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

/// Warns where another offset fits far better than the stamps with `applied` seconds added. `option` is the option that applies one.
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

/// Advice where too few poses associate, as the end of a message; empty if there is none.
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
