//! The log likelihood ratios that tell whether two keyframes show one place.
//!
//! Two other explanations are weighed against it. Things that look alike may fit one motion by *chance*: then few landmarks are where they should be, other
//! keyframes disagree, many places look like it, and it may lie anywhere. An *equal place* looks the same in every respect and differs only in where it lies.
//! The ratios are added, so strong evidence of one kind makes up for weak evidence of another.

use super::recognise::By;
use crate::loop_evidence::log_sum;
use libm::{lgamma, log};
use std::f64::consts::{PI, TAU};
use stillpoint_geometry::Mat6;

/// Prior odds that a candidate with a motion is the same place and not alike by chance: one to ten for candidates by looks, one to two for those that the map
/// expects in sight. Lower than the share of true ones on simulated walks (decision 46), since other buildings hold more that looks alike.
const PRIOR_BY_LOOKS: f64 = 0.1;
/// The same odds for candidates that the map expects in sight. Chosen: one to two, as they also lie where they should.
const PRIOR_BY_MAP: f64 = 0.5;
/// Share of the landmarks that should be in sight and are found, as beta distributions. In the same place a quarter of them is found, since most are hidden or
/// were seen from another side; elsewhere 4 %, and hardly ever more than 12 % (decision 46).
const SHARE_SAME: [f64; 2] = [2.0, 6.0];
/// The same elsewhere, by chance (decision 46).
const SHARE_CHANCE: [f64; 2] = [2.0, 48.0];
/// Landmarks that fit any motion, a number: three points determine one.
const FITTED: u32 = 3;
/// Score of the place index that unrelated places reach (measured on simulated walks, decision 46). Looks change the odds by a factor of five at most: keyframes
/// of one room share words.
const COMMON_SCORE: f64 = 0.02;
/// Most that looks change the odds by, a factor, chosen: keyframes of one room share words.
const MOST_LOOKS: f64 = 5.0;
/// How much farther than their covariance says paths drift, as (factor, share of paths). The covariance leaves out errors that all features share; simulated
/// walks at 6 Hz drift up to five times as far (decision 46).
const WORSE: [(f64, f64); 3] = [(1.0, 0.5), (3.0, 0.45), (10.0, 0.05)];
/// Places lie up to this far outside the area that the keyframes cover, m. Chosen: a room in which cameras are held or worn (docs/constants.md).
const MARGIN_M: f64 = 1.0;
/// Cameras are held or worn within this height, m. Chosen: what hands and head of somebody who stands span (docs/constants.md).
const HEIGHT_M: f64 = 1.0;
/// Half of the side of the volume in which the search around an expected pose can find a place, m: its reach (`REACH_RAD`) at a depth of 2.5 m.
const REACH_M: f64 = 2.5 * super::revisit::REACH_RAD;

/// The log prior odds of a candidate.
pub(super) fn prior(by: By) -> f64 {
    log(match by {
        By::Words => PRIOR_BY_LOOKS,
        By::Pose => PRIOR_BY_MAP,
    })
}

/// Compares how alike both keyframes look with how alike the best place elsewhere looks. Zero for candidates that the map named: nobody asked for their looks.
pub(super) fn looks(score: f64, rival: f64, by: By) -> f64 {
    let unlike = score.max(COMMON_SCORE) / rival.max(COMMON_SCORE);
    match by {
        By::Words => log(unlike.clamp(1.0 / MOST_LOOKS, MOST_LOOKS)),
        By::Pose => 0.0,
    }
}

/// Weighs the landmarks that are found of those that should be in sight: the ratio of two beta-binomial distributions, whose common factor cancels.
pub(super) fn landmarks(found: u32, expected: u32) -> f64 {
    let found = found.min(expected).saturating_sub(FITTED);
    let missed = f64::from(expected.saturating_sub(FITTED).saturating_sub(found));
    let found = f64::from(found);
    let of = |[a, b]: [f64; 2]| log_beta(found + a, missed + b) - log_beta(a, b);
    of(SHARE_SAME) - of(SHARE_CHANCE)
}

/// Weighs the keyframes that agree on one motion, this one among them. How often an object that hangs in two places makes keyframes agree is not known; with a uniform
/// prior on that share, all of n agree with probability 1 / (n + 1) (Laplace's rule of succession).
pub(super) fn witnesses(agreeing: u32) -> f64 {
    log(f64::from(agreeing.max(1)))
}

/// Weighs where the place lies: the density at squared Mahalanobis distance `cost` under the drift's covariance, over the density of places that may lie anywhere
/// on a map whose keyframes are `spread` m from their middle (root mean square), or anywhere within reach of the search.
pub(super) fn place(cost: f64, covariance: &Mat6, spread: f64, by: By) -> f64 {
    let volume = match by {
        By::Words => {
            // A uniform disc with that root mean square distance.
            let radius = std::f64::consts::SQRT_2 * spread + MARGIN_M;
            PI * radius * radius * HEIGHT_M
        }
        By::Pose => 8.0 * REACH_M * REACH_M * REACH_M,
    };
    // Equal rooms are parallel, so rotation is no evidence for the place: it only adds to the cost.
    let of_translation = covariance.fixed_view::<3, 3>(0, 0).determinant();
    // Drift wider than the whole map is no evidence against a place.
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
