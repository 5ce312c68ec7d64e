//! Candidates of loops against the ground truth.

use stillpoint::geometry::Se3;
use stillpoint::slam::{LoopOutcome, LoopReport};

/// Within 10 cm and 5 degrees of the ground truth.
pub(super) fn is_true(with_from_keyframe: Se3, edge: Se3) -> bool {
    let off = with_from_keyframe.inverse() * edge;
    off.translation.norm() <= 0.1 && off.rotation.angle().to_degrees() <= 5.0
}

/// Prints a candidate; returns whether it was closed with an error above 10 cm or 5 degrees.
pub(super) fn tell_loop(with_from_keyframe: Se3, l: &LoopReport) -> bool {
    let error = l.edge.map(|edge| {
        let error = with_from_keyframe.inverse() * edge;
        (
            error.translation.norm(),
            error.rotation.angle().to_degrees(),
        )
    });
    let far = error.map_or_else(String::new, |(m, deg)| {
        format!(", edge off by {:.1} mm, {deg:.2} deg", m * 1e3)
    });
    let evidence = l.evidence.map_or_else(String::new, |e| {
        let odds = e.log_odds() / std::f64::consts::LN_10;
        format!("odds 10^{odds:.1} ({e:.1?})")
    });
    println!(
        "    {:>4} with {:>4}, {:.2} m apart: {}, score {:.3} ({:.3} elsewhere), {} + {} of {} inliers, {} agree, cost {:.2}, {evidence}, {} merged, moved {:.3} m{far}",
        l.keyframe.0,
        l.with.0,
        with_from_keyframe.translation.norm(),
        l.outcome,
        l.score,
        l.rival,
        l.rigid_inliers,
        l.inliers,
        l.expected,
        l.agreeing,
        l.cost,
        l.merges,
        l.moved_m,
    );
    l.outcome == LoopOutcome::Closed && !l.edge.is_some_and(|e| is_true(with_from_keyframe, e))
}
