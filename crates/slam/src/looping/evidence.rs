//! How sure it is that two keyframes show one place: what speaks for it and against it, as logarithms of odds, added up.
//!
//! Two other explanations are weighed against it. Some things look alike and fit one motion by *chance*: then few landmarks are where they should be, others tell
//! otherwise, looks are common, and the place lies anywhere. An *equal place* looks the same in all of this, and only where it lies tells it apart. A kind of evidence
//! that is weak, or that cannot be had, is made up for by another.

use super::recognise::By;
use crate::loop_evidence::log_sum;
use libm::{lgamma, log};
use std::f64::consts::{PI, TAU};
use stillpoint_geometry::Mat6;

/// Odds before any evidence that a candidate with a motion is the same place and not alike by chance: of ten that look alike one is, and half of those that the map says
/// are in sight. On simulated walks more are (decision 46).
const PRIOR_BY_LOOKS: f64 = 0.1;
const PRIOR_BY_MAP: f64 = 0.5;
/// Share of landmarks that are found of those that should be in sight, as a beta distribution: a quarter of them in the same place, as most are hidden
/// or were seen from another side; 4 % elsewhere, and hardly ever more than 12 % (decision 46).
const SHARE_SAME: [f64; 2] = [2.0, 6.0];
const SHARE_CHANCE: [f64; 2] = [2.0, 48.0];
/// Landmarks that any motion fits: three determine it.
const FITTED: u32 = 3;
/// Looks that are shared with any place, and the most that they are trusted with: a factor of five.
const COMMON_SCORE: f64 = 0.02;
const MOST_LOOKS: f64 = 5.0;
/// How many times as far as its ties tell a path may have drifted, and which share of paths is taken to: ties know nothing of what all features have in common, and simulated
/// walks at 6 Hz come to five times as far (decision 46).
const WORSE: [(f64, f64); 3] = [(1.0, 0.5), (3.0, 0.45), (10.0, 0.05)];
/// How far beside the keyframes a place may lie, and how far above or below each other cameras are, m.
const MARGIN_M: f64 = 1.0;
const HEIGHT_M: f64 = 1.0;
/// Within what a place that the map names can be found at all, m to both sides: things 2.5 m away move by the reach of the search.
const REACH_M: f64 = 2.5 * super::revisit::REACH_RAD;

/// Before anything is known of a candidate.
pub(super) fn prior(by: By) -> f64 {
    log(match by {
        By::Words => PRIOR_BY_LOOKS,
        By::Pose => PRIOR_BY_MAP,
    })
}

/// By how alike both keyframes look and how alike the best place elsewhere is. Nothing where it was not asked for.
pub(super) fn looks(score: f64, rival: f64, by: By) -> f64 {
    let unlike = score.max(COMMON_SCORE) / rival.max(COMMON_SCORE);
    match by {
        By::Words => log(unlike.clamp(1.0 / MOST_LOOKS, MOST_LOOKS)),
        By::Pose => 0.0,
    }
}

/// By the landmarks that are found, of those that should be in sight: how often a share that is not known gives this count, in the same place and elsewhere
/// (beta-binomial distributions, whose common factor is left out).
pub(super) fn landmarks(found: u32, expected: u32) -> f64 {
    let found = found.min(expected).saturating_sub(FITTED);
    let missed = f64::from(expected.saturating_sub(FITTED).saturating_sub(found));
    let found = f64::from(found);
    let of = |[a, b]: [f64; 2]| log_beta(found + a, missed + b) - log_beta(a, b);
    of(SHARE_SAME) - of(SHARE_CHANCE)
}

/// By the keyframes that tell the same, the one that is asked among them. How often a thing that hangs in two places tells the same in keyframe after keyframe is not
/// known: all shares being as likely, all of n do with 1 / (n + 1) (Laplace's rule of succession).
pub(super) fn witnesses(agreeing: u32) -> f64 {
    log(f64::from(agreeing.max(1)))
}

/// By the squared distance `cost` between the motion and the map's, for a covariance that allows for drift: the density there, compared with that of places anywhere
/// on a map whose keyframes are `spread` m from their middle (root mean square), or anywhere within reach of the search.
pub(super) fn place(cost: f64, covariance: &Mat6, spread: f64, by: By) -> f64 {
    let volume = match by {
        By::Words => {
            // A disc whose points are as far from its middle.
            let radius = std::f64::consts::SQRT_2 * spread + MARGIN_M;
            PI * radius * radius * HEIGHT_M
        }
        By::Pose => 8.0 * REACH_M * REACH_M * REACH_M,
    };
    // Equal rooms are parallel: what a turn should be says nothing for the place, and only costs.
    let of_translation = covariance.fixed_view::<3, 3>(0, 0).determinant();
    // A path that allows for more than there is does not make a place less likely.
    log_sum(WORSE.map(|(worse, share)| {
        let known = 3.0 * log(TAU * worse * worse) + log(of_translation.max(f64::MIN_POSITIVE));
        let best = (log(volume) - 0.5 * known).max(0.0);
        log(share) + best - 0.5 * cost / (worse * worse)
    }))
}

/// Logarithm of the beta function.
fn log_beta(a: f64, b: f64) -> f64 {
    lgamma(a) + lgamma(b) - lgamma(a + b)
}

#[cfg(test)]
mod tests;
