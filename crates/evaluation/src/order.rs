//! Detects quaternions in the other component order (w first or last).
//!
//! Answers: whether an estimate rotates like the ground truth only if the quaternions of one of them are read in the other order. Positions
//! and rotation angles do not depend on the order, so neither a file alone nor the absolute error reveals it; the rotation axes do.

use crate::rpe::{Delta, relative_error};
use crate::{DEFAULT_MAX_DT, TimedPose};
use stillpoint_geometry::Se3;
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};

/// Another order fits far better if the error of rotations over a second falls below this fraction: half, as for offsets between clocks.
const FAR_BETTER: f64 = 0.5;
/// Minimum decrease of the error, degrees: the rotations of tracked cameras are within 2 degrees a second of the ground truth
/// (`docs/benchmarks.md`).
const BY_AT_LEAST: f64 = 2.0;

/// Smaller differences of errors are ties, degrees: between trajectories of one frame of reference either may be read in the order of the
/// other, and the ground truth is then reported.
const SAME: f64 = 1e-3;

/// The trajectory whose quaternions are read in the other order.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OrderOf {
    /// The ground truth.
    Reference,
    /// The estimate.
    Estimate,
}

/// An order of quaternion components that fits far better than the one used for reading.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OtherOrder {
    /// The trajectory concerned.
    pub of: OrderOf,
    /// The order that fits: w is the first number (qw qx qy qz), else the last.
    pub w_first: bool,
    /// Median error of the rotations over a second with it, degrees.
    pub rotation_deg: f64,
    /// Likewise as read, degrees.
    pub rotation_deg_as_read: f64,
}

/// The order of quaternion components that fits far better than the one used for reading; `None` if both fit, neither does, or the camera
/// does not rotate. Stamps must ascend.
#[must_use]
pub fn find_other_order(reference: &[TimedPose], estimate: &[TimedPose]) -> Option<OtherOrder> {
    let error = |reference: &[TimedPose], estimate: &[TimedPose]| {
        let how = (Delta::default(), DEFAULT_MAX_DT, 1.0);
        Some(
            relative_error(reference, estimate, &[], how)?
                .rotation_deg
                .median,
        )
    };
    let as_read = error(reference, estimate)?;
    if as_read < BY_AT_LEAST {
        return None;
    }
    let mut best: Option<OtherOrder> = None;
    for (of, w_first) in [
        (OrderOf::Reference, true),
        (OrderOf::Reference, false),
        (OrderOf::Estimate, true),
        (OrderOf::Estimate, false),
    ] {
        let other = match of {
            OrderOf::Reference => error(&reordered(reference, w_first), estimate),
            OrderOf::Estimate => error(reference, &reordered(estimate, w_first)),
        };
        let is_better = |e: &f64| e + SAME < best.map_or(f64::INFINITY, |b| b.rotation_deg);
        if let Some(rotation_deg) = other.filter(is_better) {
            best = Some(OtherOrder {
                of,
                w_first,
                rotation_deg,
                rotation_deg_as_read: as_read,
            });
        }
    }
    best.filter(|b| b.rotation_deg < (FAR_BETTER * as_read).min(as_read - BY_AT_LEAST))
}

/// Poses with the numbers of each quaternion in the other order: `w_first` is the new order.
fn reordered(poses: &[TimedPose], w_first: bool) -> Vec<TimedPose> {
    let quaternion = |pose: &Se3| {
        let q = pose.rotation;
        let numbers = if w_first {
            // The file's numbers were read as x, y, z, w.
            Quaternion::new(q.i, q.j, q.k, q.w)
        } else {
            Quaternion::new(q.k, q.w, q.i, q.j)
        };
        UnitQuaternion::new_normalize(numbers)
    };
    let all = poses.iter().map(|p| TimedPose {
        world_from_camera: Se3::new(
            quaternion(&p.world_from_camera),
            p.world_from_camera.translation,
        ),
        ..*p
    });
    all.collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::{Vec3, so3};

    /// A hand that rotates the camera about all its axes, by this angle, rad.
    fn turned(by: f64) -> Vec<TimedPose> {
        let pose = |i: u32| {
            let t = f64::from(i) / 30.0;
            let turn = Vec3::new((1.7 * t).sin(), (1.1 * t).cos(), 0.5 * (0.9 * t).sin());
            TimedPose {
                stamp: t,
                world_from_camera: Se3::new(
                    so3::exp(&Vec3::new(0.4, -1.0, 0.7)) * so3::exp(&(by * turn)),
                    Vec3::new(t.sin(), 0.3 * t, t.cos()),
                ),
            }
        };
        (0..150).map(pose).collect()
    }

    /// The same rotations from another position, slightly wrong.
    fn estimated(truth: &[TimedPose]) -> Vec<TimedPose> {
        let world = Se3::new(
            so3::exp(&Vec3::new(0.2, 0.9, -0.3)),
            Vec3::new(1.0, 2.0, 3.0),
        );
        let off = |k: usize| {
            let off = so3::exp(&Vec3::new(0.004 * ((k % 7) as f64 - 3.0), 0.0, 0.002));
            Se3::new(off, Vec3::zeros())
        };
        let pose = |(k, p): (usize, &TimedPose)| TimedPose {
            world_from_camera: world * p.world_from_camera * off(k),
            ..*p
        };
        truth.iter().enumerate().map(pose).collect()
    }

    #[test]
    fn wrong_quaternion_order_is_found_in_either_trajectory() {
        let truth = turned(0.6);
        let estimate = estimated(&truth);
        assert_eq!(find_other_order(&truth, &estimate), None);
        for w_first in [true, false] {
            // Poses as read from numbers in the order `w_first`.
            let read = reordered(&truth, !w_first);
            let found = find_other_order(&read, &estimate).unwrap();
            assert_eq!((found.of, found.w_first), (OrderOf::Reference, w_first));
            assert!(
                found.rotation_deg < 2.0 && found.rotation_deg_as_read > 10.0,
                "{found:?}"
            );
            let read = reordered(&estimate, !w_first);
            let found = find_other_order(&truth, &read).unwrap();
            assert_eq!((found.of, found.w_first), (OrderOf::Estimate, w_first));
        }
    }

    #[test]
    fn ambiguous_quaternion_order_is_not_reported() {
        // A camera without rotation, another motion, and too little.
        let still = turned(0.0);
        assert_eq!(
            find_other_order(&reordered(&still, true), &estimated(&still)),
            None
        );
        let (truth, mut other) = (turned(0.6), turned(0.6));
        other
            .iter_mut()
            .zip(truth.iter().rev())
            .for_each(|(o, t)| o.world_from_camera = t.world_from_camera);
        assert_eq!(find_other_order(&truth, &other), None);
        assert_eq!(find_other_order(&truth[..9], &truth[..9]), None);
        assert_eq!(find_other_order(&[], &truth), None);
    }
}
