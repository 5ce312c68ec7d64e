//! Consistency of covariances: how often the truth lies within the predicted interval.

use crate::{TimedPose, is_fixed};
use stillpoint_geometry::{Mat6, Se3, Vec3, Vec6, align_umeyama, so3};

/// Standard deviations on either side that contain 90 % of a normal distribution.
const SIGMAS_90: f64 = 1.644_853_626_951_472_2;
/// Maximum time between poses for interpolation of the truth, s: several times the interval of ground truth at 10 Hz, chosen.
const MAX_GAP: f64 = 0.25;
/// Maximum difference of a motion's duration from the requested one, s: three intervals of 30 Hz, chosen.
const TOLERANCE: f64 = 0.1;

/// Fractions of the 90 % intervals that contain the truth, over all poses and axes.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Coverage {
    /// Number of poses, or of motions.
    pub count: usize,
    /// For the axes of position.
    pub place: f64,
    /// For the axes of rotation.
    pub direction: f64,
    /// Root of the mean squared error over its standard deviation, of position: 1 is consistent, more is overconfident.
    pub place_ratio: f64,
}

/// Coverage of single poses, each with its covariance `[translation; rotation]` in the axes of its camera: `truth = pose * exp(e)`. The
/// estimate is aligned to the truth by the motion that fits all positions best, as in evo, and rotations by the rotation that fits them
/// best: on a short path, positions hardly determine it. For a camera at rest, the means of both are aligned. `None` with fewer than three
/// pairs.
#[must_use]
pub fn coverage(
    truth: &[TimedPose],
    estimate: &[TimedPose],
    covariances: &[Mat6],
) -> Option<Coverage> {
    let pairs: Vec<(Se3, Se3, &Mat6)> = estimate
        .iter()
        .zip(covariances)
        .filter_map(|(e, c)| Some((at(truth, e.stamp)?, e.world_from_camera, c)))
        .collect();
    if pairs.len() < 3 {
        return None;
    }
    let places = |of: fn(&(Se3, Se3, &Mat6)) -> Vec3| pairs.iter().map(of).collect::<Vec<Vec3>>();
    let (real, found) = (places(|p| p.0.translation), places(|p| p.1.translation));
    let turn = mean_turn(pairs.iter().map(|p| p.0.rotation * p.1.rotation.inverse()));
    let aligned = if is_fixed(truth) {
        let mean = |all: &[Vec3]| all.iter().sum::<Vec3>() / all.len() as f64;
        Se3::new(turn, mean(&real) - turn * mean(&found))
    } else {
        align_umeyama(&found, &real, false).ok()?.target_from_source
    };
    Some(Coverage::of(pairs.iter().map(
        |(truth, pose, covariance)| {
            let back = (turn * pose.rotation).inverse();
            let by_place = back * (truth.translation - aligned.transform(&pose.translation));
            let by_direction = so3::log(&(back * truth.rotation));
            (six(&by_place, &by_direction), **covariance)
        },
    )))
}

/// Coverage of motions over about this many seconds: `covariance` returns that of the motion from one pose of the estimate to a later one,
/// in the axes of the later one. Nothing is aligned. `None` if no two poses are this far apart.
#[must_use]
pub fn motion_coverage(
    truth: &[TimedPose],
    estimate: &[TimedPose],
    seconds: f64,
    covariance: impl Fn(usize, usize, &Se3) -> Mat6,
) -> Option<Coverage> {
    let mut off = Vec::new();
    for (i, earlier) in estimate.iter().enumerate() {
        let then = earlier.stamp + seconds;
        let after = estimate.partition_point(|e| e.stamp < then);
        let near = [after.checked_sub(1), Some(after)].into_iter().flatten();
        let far = |j: &usize| (estimate[*j].stamp - then).abs();
        let near = near.filter(|j| *j > i && *j < estimate.len() && far(j) <= TOLERANCE);
        let Some(j) = near.min_by(|a, b| far(a).total_cmp(&far(b))) else {
            continue;
        };
        let later = &estimate[j];
        let (Some(a), Some(b)) = (at(truth, earlier.stamp), at(truth, later.stamp)) else {
            continue;
        };
        let motion = earlier.world_from_camera.inverse() * later.world_from_camera;
        let error = motion.inverse() * (a.inverse() * b);
        let error = six(&error.translation, &so3::log(&error.rotation));
        off.push((error, covariance(i, j, &motion)));
    }
    (!off.is_empty()).then(|| Coverage::of(off.into_iter()))
}

impl Coverage {
    fn of(errors: impl Iterator<Item = (Vec6, Mat6)>) -> Self {
        let (mut count, mut within, mut squares) = (0, [0.0, 0.0], 0.0);
        for (error, covariance) in errors {
            count += 1;
            for axis in 0..6 {
                let sigmas = error[axis].abs() / covariance[(axis, axis)].sqrt();
                within[axis / 3] += f64::from(u8::from(sigmas <= SIGMAS_90));
                squares += if axis < 3 { sigmas * sigmas } else { 0.0 };
            }
        }
        let axes = 3.0 * f64::from(count);
        Self {
            count: count as usize,
            place: within[0] / axes,
            direction: within[1] / axes,
            place_ratio: (squares / axes).sqrt(),
        }
    }
}

fn six(translation: &Vec3, rotation: &Vec3) -> Vec6 {
    let (t, r) = (translation, rotation);
    Vec6::new(t.x, t.y, t.z, r.x, r.y, r.z)
}

fn at(truth: &[TimedPose], stamp: f64) -> Option<Se3> {
    let after = truth.partition_point(|p| p.stamp < stamp);
    let b = truth.get(after)?;
    if (b.stamp - stamp).abs() < 1e-6 {
        return Some(b.world_from_camera);
    }
    let a = &truth[after.checked_sub(1)?];
    let gap = b.stamp - a.stamp;
    let share = (stamp - a.stamp) / gap;
    (gap <= MAX_GAP).then(|| a.world_from_camera.interpolate(&b.world_from_camera, share))
}

type Turn = stillpoint_geometry::nalgebra::UnitQuaternion<f64>;

fn mean_turn(turns: impl Iterator<Item = Turn> + Clone) -> Turn {
    let mut mean = turns.clone().next().unwrap_or_else(Turn::identity);
    // Each round reduces the error to third order.
    for _ in 0..5 {
        let (mut sum, mut count) = (Vec3::zeros(), 0.0);
        for turn in turns.clone() {
            sum += so3::log(&(turn * mean.inverse()));
            count += 1.0;
        }
        mean = so3::exp(&(sum / f64::max(count, 1.0))) * mean;
    }
    mean
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Reproducible samples of a normal distribution.
    fn normal(seed: &mut u64) -> f64 {
        let mut uniform = || {
            *seed = seed
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            (*seed >> 11) as f64 / (1_u64 << 53) as f64
        };
        (0..12).map(|_| uniform()).sum::<f64>() - 6.0
    }

    /// A camera on a circle, and its estimate from another origin: each pose is off by centimetres and centiradians.
    fn walk() -> (Vec<TimedPose>, Vec<TimedPose>) {
        let mut seed = 1;
        let other = Se3::exp(&Vec6::new(1.0, 2.0, 3.0, 0.3, -0.5, 0.2));
        let pose = |i: usize| {
            let angle = i as f64 * 0.05;
            let centre = Vec3::new(angle.cos(), angle.sin(), 0.2 * (3.0 * angle).sin());
            Se3::new(so3::exp(&Vec3::new(0.0, angle, 0.1)), centre)
        };
        let timed = |i: usize, world_from_camera: Se3| TimedPose {
            stamp: i as f64 * 0.1,
            world_from_camera,
        };
        let truth = (0..600).map(|i| timed(i, pose(i))).collect();
        let found = (0..600).map(|i| {
            let error = Vec6::from_fn(|_, _| 0.01 * normal(&mut seed));
            timed(i, other * pose(i) * Se3::exp(&error).inverse())
        });
        (truth, found.collect())
    }

    #[test]
    fn coverage_matches_the_stated_deviation() {
        let (truth, found) = walk();
        let with = |sigma: f64| {
            let covariance = Mat6::identity() * (sigma * sigma);
            let single = coverage(&truth, &found, &vec![covariance; 600]).unwrap();
            let motion = |_: usize, _: usize, by: &Se3| {
                let by = by.inverse().adjoint();
                by * covariance * by.transpose() + covariance
            };
            (
                single,
                motion_coverage(&truth, &found, 1.0, motion).unwrap(),
            )
        };
        let (single, motion) = with(0.01);
        assert!(single.count == 600 && motion.count >= 590, "{motion:?}");
        for of in [single, motion] {
            assert!((0.88..0.92).contains(&of.place), "{of:?}");
            assert!((0.88..0.92).contains(&of.direction), "{of:?}");
            assert!((of.place_ratio - 1.0).abs() < 0.05, "{of:?}");
        }
        let (single, motion) = with(0.005);
        for of in [single, motion] {
            assert!(
                (0.55..0.63).contains(&of.place) && (of.place_ratio - 2.0).abs() < 0.1,
                "{of:?}"
            );
        }
    }

    #[test]
    fn static_camera_is_scored_about_its_mean() {
        let still = |at: &dyn Fn(usize) -> Se3| -> Vec<TimedPose> {
            (0..50)
                .map(|i| TimedPose {
                    stamp: i as f64,
                    world_from_camera: at(i),
                })
                .collect()
        };
        let truth = still(&|_| Se3::identity());
        let found = still(&|i| {
            Se3::exp(&Vec6::new(
                1.0 + 0.001 * (i % 2) as f64,
                0.0,
                0.0,
                0.0,
                0.4,
                0.0,
            ))
        });
        let of = |sigma: f64| {
            coverage(
                &truth,
                &found,
                &vec![Mat6::identity() * (sigma * sigma); 50],
            )
        };
        // Half a millimetre to either side of the mean, along one axis of three.
        assert!(of(0.001).unwrap().place == 1.0);
        assert!((of(0.0001).unwrap().place - 2.0 / 3.0).abs() < 1e-9);
        assert!(coverage(&truth[..2], &found[..2], &[Mat6::identity(); 2]).is_none());
    }
}
