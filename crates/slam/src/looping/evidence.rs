//! Log likelihood ratios for two keyframes showing the same place.
//!
//! Two alternatives are considered. Similar objects may fit one motion by *chance*: then few expected landmarks are
//! found, other keyframes disagree, many places look alike, and the position is arbitrary. An *equal place* looks
//! identical in every respect and differs only in position. Ratios are added, so strong evidence of one kind
//! compensates for weak evidence of another.

use super::recognise::By;
use crate::loop_evidence::log_sum;
use libm::{lgamma, log};
use std::f64::consts::{PI, TAU};
use stillpoint_geometry::Mat6;

/// Prior odds that a candidate with a verified motion is the same place and not similar by chance: one to ten for
/// candidates by appearance, one to two for those expected in view by the map. Lower than the share of true ones on
/// simulated walks (decision 46), since other buildings contain more similar places.
const PRIOR_BY_LOOKS: f64 = 0.1;
/// Prior odds of candidates expected in view by the map. Chosen: one to two, as their position fits as well.
const PRIOR_BY_MAP: f64 = 0.5;
/// Beta distribution of the share of expected landmarks that are found at the same place: a quarter, since most are
/// occluded or were seen from another side; elsewhere 4 %, and hardly ever more than 12 % (decision 46).
const SHARE_SAME: [f64; 2] = [2.0, 6.0];
/// Beta distribution of that share elsewhere, by chance (decision 46).
const SHARE_CHANCE: [f64; 2] = [2.0, 48.0];
/// Number of landmarks that fit any motion: three points determine one.
const FITTED: u32 = 3;
/// Place-index score reached by unrelated places (measured on simulated walks, decision 46). Appearance changes the
/// odds by a factor of five at most: keyframes of one room share words.
const COMMON_SCORE: f64 = 0.02;
/// Largest factor of the appearance term, chosen: keyframes of one room share words.
const MOST_LOOKS: f64 = 5.0;
/// Underestimation of drift by the covariance, as (factor, share of paths). The covariance leaves out errors common to
/// all features; simulated walks at 6 Hz drift up to five times as far (decision 46).
const WORSE: [(f64, f64); 3] = [(1.0, 0.5), (3.0, 0.45), (10.0, 0.05)];
/// Margin around the area covered by keyframes in which places may lie, m. Chosen: a room in which cameras are held or
/// worn (docs/constants.md).
const MARGIN_M: f64 = 1.0;
/// Range of heights at which cameras are held or worn, m. Chosen: the span of hands and head of a standing person
/// (docs/constants.md).
const HEIGHT_M: f64 = 1.0;
/// Half of the side of the volume in which the search around an expected pose can find a place, m: its reach
/// (`REACH_RAD`) at a depth of 2.5 m.
const REACH_M: f64 = 2.5 * super::revisit::REACH_RAD;

pub(super) fn prior(by: By) -> f64 {
    log(match by {
        By::Words => PRIOR_BY_LOOKS,
        By::Pose => PRIOR_BY_MAP,
    })
}

/// Compares the similarity of both keyframes with that of the best place elsewhere. Zero for candidates from the map,
/// whose appearance was not compared.
pub(super) fn looks(score: f64, rival: f64, by: By) -> f64 {
    let unlike = score.max(COMMON_SCORE) / rival.max(COMMON_SCORE);
    match by {
        By::Words => log(unlike.clamp(1.0 / MOST_LOOKS, MOST_LOOKS)),
        By::Pose => 0.0,
    }
}

/// Evidence from the number of expected landmarks that are found: ratio of two beta-binomial distributions, whose
/// common factor cancels.
pub(super) fn landmarks(found: u32, expected: u32) -> f64 {
    let found = found.min(expected).saturating_sub(FITTED);
    let missed = f64::from(expected.saturating_sub(FITTED).saturating_sub(found));
    let found = f64::from(found);
    let of = |[a, b]: [f64; 2]| log_beta(found + a, missed + b) - log_beta(a, b);
    of(SHARE_SAME) - of(SHARE_CHANCE)
}

/// Evidence from the number of keyframes that agree on one motion, including this one. How often a repeated object
/// makes keyframes agree is unknown; with a uniform prior on that share, all of n agree with probability 1 / (n + 1)
/// (Laplace's rule of succession).
pub(super) fn witnesses(agreeing: u32) -> f64 {
    log(f64::from(agreeing.max(1)))
}

/// Evidence from the position: the density at squared Mahalanobis distance `cost` under the drift's covariance, over
/// the density of places anywhere in a map with root mean square radius `spread` (m), or anywhere within reach of the
/// search.
pub(super) fn place(cost: f64, covariance: &Mat6, spread: f64, by: By) -> f64 {
    let volume = match by {
        By::Words => {
            // A uniform disc with that root mean square radius.
            let radius = std::f64::consts::SQRT_2 * spread + MARGIN_M;
            PI * radius * radius * HEIGHT_M
        }
        By::Pose => 8.0 * REACH_M * REACH_M * REACH_M,
    };
    // Equal rooms are parallel, so rotation is no evidence for the place: it only adds to the cost.
    let of_translation = covariance.fixed_view::<3, 3>(0, 0).determinant();
    // Drift wider than the map is no evidence against a place.
    log_sum(WORSE.map(|(worse, share)| {
        let known = 3.0 * log(TAU * worse * worse) + log(of_translation.max(f64::MIN_POSITIVE));
        let best = (log(volume) - 0.5 * known).max(0.0);
        log(share) + best - 0.5 * cost / (worse * worse)
    }))
}

fn log_beta(a: f64, b: f64) -> f64 {
    lgamma(a) + lgamma(b) - lgamma(a + b)
}

#[cfg(test)]
mod tests;
