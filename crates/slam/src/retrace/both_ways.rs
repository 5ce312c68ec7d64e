//! The motion that two ways over the same frames tell together.
//!
//! Each way errs by itself: it is led by whoever walks before the camera in some frame, and slips where people leave hardly a landmark. A camera that is carried
//! changes its velocity little from frame to frame, so of two motions that do not agree the one that goes with those before and after is believed.

use stillpoint_geometry::{Se3, Vec6};

/// Standard deviations of a velocity between two frames, m/s and rad/s: with those, a centimetre and a third of a degree within a frame of 30 Hz.
const SIGMAS: [f64; 2] = [0.3, 0.15];
/// How much the velocity of a hand changes within a frame of 30 Hz, m/s and rad/s.
const CHANGES: [f64; 2] = [0.15, 0.25];
/// Standard deviations from which a motion counts less: half at this many (a Cauchy distribution).
const CAUCHY: f64 = 2.0;
/// Inliers with which a pose counts in full.
const INLIERS: f64 = 250.0;
/// The way back knows who moves, and counts so much more where both jerk alike ...
const BACK: f64 = 3.0;
/// ... else times the third power of how much more the way there jerks, within these factors.
const FACTORS: [f64; 2] = [0.1, 100.0];
/// Of what no way tells anything this much is believed, for the sake of the sums.
const LEAST: f64 = 1e-6;
/// Times that the weights are found again.
const ROUNDS: usize = 15;
/// Time between two frames for which [`CHANGES`] are stated, s.
const FRAME: f64 = 1.0 / 30.0;

/// A frame on both ways, as seen from the turning point.
pub(super) struct Step {
    /// s.
    pub(super) stamp: f64,
    /// Its pose on the way there and on the way back, and how much each counts.
    pub(super) ways: [Option<(Se3, f64)>; 2],
}

/// How much a pose counts that so many inliers speak for.
pub(super) fn weight(inliers: u32) -> f64 {
    (f64::from(inliers) / INLIERS).min(1.0)
}

/// How much more the way back counts than the way there, on which the camera jerks so many times as much.
pub(super) fn trust(jerks: f64) -> f64 {
    let [least, most] = FACTORS;
    let factor = jerks * jerks * jerks;
    BACK * if factor.is_finite() {
        factor.clamp(least, most)
    } else {
        1.0
    }
}

/// What a way tells of the motion between two frames.
#[derive(Clone, Copy)]
struct Told {
    velocity: Vec6,
    weight: f64,
}

/// Where the frames are from the turning point, oldest first, but for the last one, whose pose `end` is fixed; the way back counts `trust` times as much as the way there.
pub(super) fn fused(steps: &[Step], end: &Se3, trust: f64) -> Vec<Se3> {
    let seconds: Vec<f64> = steps
        .windows(2)
        .map(|w| (w[1].stamp - w[0].stamp).max(1e-6))
        .collect();
    let told: Vec<[Option<Told>; 2]> = steps
        .windows(2)
        .zip(&seconds)
        .map(|(w, s)| [told(w, 0, 1.0, *s), told(w, 1, trust, *s)])
        .collect();
    let velocities = velocities(&told, &seconds);
    let mut pose = *end;
    let mut poses: Vec<Se3> = Vec::with_capacity(velocities.len());
    for (velocity, s) in velocities.iter().zip(&seconds).rev() {
        pose = (pose * Se3::exp(&(velocity * *s)).inverse()).normalized();
        poses.push(pose);
    }
    poses.reverse();
    poses
}

fn told(steps: &[Step], way: usize, trust: f64, seconds: f64) -> Option<Told> {
    let [(a, one), (b, other)] = [steps[0].ways[way]?, steps[1].ways[way]?];
    Some(Told {
        velocity: (a.inverse() * b).log() / seconds,
        weight: trust * one.min(other),
    })
}

/// The velocities between the frames that agree best with what is told and change least: weighted least squares, with weights that fall with the distance from
/// the last solution.
fn velocities(told: &[[Option<Told>; 2]], seconds: &[f64]) -> Vec<Vec6> {
    let sigma = |i: usize| SIGMAS[i / 3];
    let far = |told: &Told, v: &Vec6| {
        let d = told.velocity - v;
        (0..6)
            .map(|i| (d[i] / sigma(i)) * (d[i] / sigma(i)))
            .sum::<f64>()
    };
    let mut found: Vec<Vec6> = vec![Vec6::zeros(); told.len()];
    for round in 0..ROUNDS {
        let weigh = |(told, v): (&[Option<Told>; 2], &Vec6)| {
            told.map(|t| {
                t.map_or(0.0, |t| match round {
                    0 => t.weight,
                    _ => t.weight / (1.0 + far(&t, v) / (CAUCHY * CAUCHY)),
                })
            })
        };
        let weights: Vec<[f64; 2]> = told.iter().zip(&found).map(weigh).collect();
        for i in 0..6 {
            let (s, change) = (sigma(i), CHANGES[i / 3]);
            let own = |(told, w): (&[Option<Told>; 2], &[f64; 2])| {
                let sum = told
                    .iter()
                    .zip(w)
                    .filter_map(|(t, w)| Some((t.as_ref()?, w)));
                let (weight, vector) = sum.fold((LEAST, 0.0), |(a, b), (t, w)| {
                    (a + w, b + w * t.velocity[i])
                });
                (weight / (s * s), vector / (s * s))
            };
            let rows: Vec<(f64, f64)> = told.iter().zip(&weights).map(own).collect();
            let stiff = |w: &[f64]| 2.0 * FRAME / ((w[0] + w[1]) * change * change);
            let links: Vec<f64> = seconds.windows(2).map(stiff).collect();
            for (v, x) in found.iter_mut().zip(chained(&rows, &links)) {
                v[i] = x;
            }
        }
    }
    found
}

/// Solves for values of which each is told with a weight (weight, weight times value) and neighbours are linked: a tridiagonal system, positive definite.
fn chained(rows: &[(f64, f64)], links: &[f64]) -> Vec<f64> {
    let link = |i: usize| links.get(i).copied().unwrap_or(0.0);
    let mut diagonal: Vec<f64> = Vec::with_capacity(rows.len());
    let mut values: Vec<f64> = Vec::with_capacity(rows.len());
    for (i, (weight, vector)) in rows.iter().enumerate() {
        let before = i.checked_sub(1).map_or(0.0, link);
        let (mut d, mut x) = (weight + before + link(i), *vector);
        if let Some(k) = i.checked_sub(1) {
            let factor = before / diagonal[k];
            d -= factor * before;
            x += factor * values[k];
        }
        diagonal.push(d);
        values.push(x);
    }
    for i in (0..rows.len()).rev() {
        let after = values.get(i + 1).copied().unwrap_or(0.0);
        values[i] = (values[i] + link(i) * after) / diagonal[i];
    }
    values
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RATE: f64 = 30.0;

    /// A camera that turns faster and faster and moves to the side.
    fn truth(frame: usize) -> Se3 {
        let t = frame as f64 / RATE;
        let turn = 0.8 * t + 0.7 * t * t;
        Se3::exp(&Vec6::new(
            0.1 * t,
            0.0,
            0.05 * t * t,
            0.0,
            turn,
            0.1 * turn,
        ))
    }

    /// A camera that is carried aside by `by` at some intervals, and stays there.
    fn carried(frames: usize, at: &[usize], by: &Vec6) -> Vec<Se3> {
        let mut poses = vec![truth(frames - 1)];
        for i in (0..frames - 1).rev() {
            let moved = truth(i + 1).inverse() * truth(i);
            let aside = if at.contains(&i) {
                Se3::exp(by)
            } else {
                Se3::identity()
            };
            let last = poses[poses.len() - 1];
            poses.push(last * aside * moved);
        }
        poses.reverse();
        poses
    }

    fn steps(there: &[Se3], back: &[Se3], inliers: [u32; 2]) -> Vec<Step> {
        let step = |(i, (a, b)): (usize, (&Se3, &Se3))| Step {
            stamp: i as f64 / RATE,
            ways: [(a, inliers[0]), (b, inliers[1])].map(|(p, n)| Some((*p, weight(n)))),
        };
        there.iter().zip(back).enumerate().map(step).collect()
    }

    fn worst(poses: &[Se3]) -> f64 {
        let off = |(i, p): (usize, &Se3)| (p.translation - truth(i).translation).norm();
        poses.iter().enumerate().map(off).fold(0.0, f64::max)
    }

    #[test]
    fn what_both_tell_is_kept() {
        let way = carried(40, &[], &Vec6::zeros());
        let poses = fused(&steps(&way, &way, [150; 2]), &truth(39), BACK);
        assert_eq!(poses.len(), 39);
        assert!(worst(&poses) < 2e-3, "{}", worst(&poses));
    }

    /// Each way slips at frames of its own. Control: each alone is off by as much as it slipped.
    #[test]
    fn of_two_that_slip_at_other_frames_neither_slip_stays() {
        let slip = Vec6::new(0.06, 0.0, 0.0, 0.0, 0.02, 0.0);
        let there = carried(40, &[5, 6, 24], &slip);
        let back = carried(40, &[13, 30], &-slip);
        assert!(worst(&there) > 0.15 && worst(&back) > 0.1);
        let poses = fused(&steps(&there, &back, [150; 2]), &truth(39), BACK);
        assert!(worst(&poses) < 0.03, "{}", worst(&poses));
    }

    #[test]
    fn who_has_more_inliers_is_believed_more() {
        let drift = Vec6::new(0.01, 0.0, 0.0, 0.0, 0.0, 0.0);
        let all: Vec<usize> = (0..39).collect();
        let (there, back) = (carried(40, &[], &drift), carried(40, &all, &drift));
        let off = |inliers| worst(&fused(&steps(&there, &back, inliers), &truth(39), BACK));
        assert!(off([200, 30]) < 0.5 * off([30, 200]));
    }

    #[test]
    fn the_way_that_jerks_less_is_believed_more() {
        assert!(trust(2.0) > 5.0 * trust(1.0) && trust(0.5) < 0.2 * trust(1.0));
        for strange in [0.0, f64::INFINITY, f64::NAN] {
            assert!(trust(strange) > 0.0 && trust(strange).is_finite());
        }
    }

    #[test]
    fn a_frame_that_one_way_has_not_is_where_the_other_says() {
        let way = carried(40, &[], &Vec6::zeros());
        let mut steps = steps(&way, &way, [150; 2]);
        for (i, step) in steps.iter_mut().enumerate() {
            step.ways[1] = step.ways[1].filter(|_| !(10..20).contains(&i));
            step.ways[0] = step.ways[0].filter(|_| !(15..18).contains(&i));
        }
        let poses = fused(&steps, &truth(39), BACK);
        // Three frames that nobody saw are on a steady way between those before and after.
        assert!(worst(&poses) < 0.02, "{}", worst(&poses));
    }

    proptest! {
        #[test]
        fn a_chain_solves_its_system(
            rows in prop::collection::vec((0.01..10.0_f64, -5.0..5.0_f64), 1..20),
            link in 0.0..50.0_f64,
        ) {
            let links = vec![link; rows.len() - 1];
            let x = chained(&rows, &links);
            for (i, (weight, vector)) in rows.iter().enumerate() {
                let mut left = weight * x[i];
                for k in [i.checked_sub(1), (i + 1 < rows.len()).then_some(i + 1)].into_iter().flatten() {
                    left += link * (x[i] - x[k]);
                }
                prop_assert!((left - vector).abs() < 1e-8);
            }
        }
    }
}
