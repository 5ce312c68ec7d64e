//! Interpolates samples to a motion of the base.

use std::collections::VecDeque;
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{Se3, Vec3, Vec6, so3};
use stillpoint_imaging::OdometrySample;

/// Longest gap between samples that is bridged, s: chosen, two lost samples of a source of 10 Hz, and half a period for
/// its jitter.
const LONGEST_GAP: f64 = 0.35;
/// Longest extrapolation after the last sample, s: chosen, one period of a source of 10 Hz.
const LONGEST_HOLD: f64 = 0.1;
/// Unknown acceleration between samples and after the last one, m/s^2: chosen, that of an indoor base which stops from
/// 0.5 m/s within half a second.
const ACCELERATION: f64 = 1.0;
/// Unknown angular acceleration between samples and after the last one, rad/s^2: chosen, that of a base which stops
/// turning at 1 rad/s within half a second.
const TURNING: f64 = 2.0;

#[derive(Clone, Copy, Debug)]
pub(super) struct Stand {
    /// s.
    pub(super) stamp: f64,
    pub(super) odom_from_base: Se3,
    pub(super) sigmas: Option<[f64; 2]>,
}

impl Stand {
    /// `None` if it is not a valid pose.
    pub(super) fn of(sample: &OdometrySample, time_offset: f64) -> Option<Self> {
        sample.is_pose().then_some(())?;
        let [x, y, z, w] = sample.orientation;
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, x, y, z));
        Some(Self {
            stamp: sample.stamp + time_offset,
            odom_from_base: Se3::new(rotation, Vec3::from(sample.position)),
            sigmas: sample.sigmas,
        })
    }
}

#[derive(Clone, Copy, Debug)]
pub(super) struct Way {
    /// Maps later coordinates of the base to earlier ones.
    pub(super) earlier_from_later: Se3,
    /// Length of the path, m, and sum of the rotations, rad; back and forth counts twice.
    pub(super) length: f64,
    pub(super) turned: f64,
    /// Interpolation error at both ends: position, m, and rotation, rad.
    pub(super) ends: [f64; 2],
    /// Growth of the stated standard deviations: position, m, and rotation, rad.
    pub(super) stated: [f64; 2],
}

/// Interpolated pose at a time, with its uncertainty.
struct At {
    odom_from_base: Se3,
    open: [f64; 2],
    sigmas: Option<[f64; 2]>,
}

/// Motion of the base between two times, s, by samples in order of time. `None` if samples are missing.
pub(super) fn between(samples: &VecDeque<Stand>, [from, to]: [f64; 2]) -> Option<Way> {
    if to <= from {
        return None;
    }
    let (a, b) = (at(samples, from)?, at(samples, to)?);
    let first = samples.partition_point(|s| s.stamp <= from);
    let end = samples.partition_point(|s| s.stamp < to);
    let (mut length, mut turned, mut last) = (0.0, 0.0, a.odom_from_base);
    let inner = samples.range(first..end.max(first));
    for pose in inner.map(|s| s.odom_from_base).chain([b.odom_from_base]) {
        length += (pose.translation - last.translation).norm();
        turned += so3::log(&(last.rotation.inverse() * pose.rotation)).norm();
        last = pose;
    }
    let grown = |k: usize| {
        let [x, y] = [a.sigmas, b.sigmas].map(|s| s.map_or(0.0, |s| s[k]));
        (y * y - x * x).max(0.0).sqrt()
    };
    Some(Way {
        earlier_from_later: a.odom_from_base.inverse() * b.odom_from_base,
        length,
        turned,
        ends: [0, 1].map(|k| libm::hypot(a.open[k], b.open[k])),
        stated: [grown(0), grown(1)],
    })
}

/// Interpolates along a screw motion; extrapolates the last velocity.
fn at(samples: &VecDeque<Stand>, time: f64) -> Option<At> {
    let next = samples.partition_point(|s| s.stamp < time);
    let before = |k: usize| next.checked_sub(k).and_then(|i| samples.get(i));
    let (a, b, hold) = match (before(1), samples.get(next)) {
        (Some(a), Some(b)) => (a, b, 0.0),
        (None, Some(b)) if b.stamp == time => (b, b, 0.0),
        (Some(b), None) => (before(2)?, b, time - b.stamp),
        _ => return None,
    };
    let gap = b.stamp - a.stamp;
    if gap > LONGEST_GAP || hold > LONGEST_HOLD {
        return None;
    }
    let share = if gap > 0.0 {
        (time - a.stamp) / gap
    } else {
        0.0
    };
    let twist: Vec6 = (a.odom_from_base.inverse() * b.odom_from_base).log();
    // Position error of an unknown acceleration: largest in the middle between samples, and growing with extrapolation
    // time.
    let left = share.clamp(0.0, 1.0);
    let bend = 0.5 * left * (1.0 - left) * gap * gap + 0.5 * hold * (hold + gap);
    Some(At {
        odom_from_base: a.odom_from_base * Se3::exp(&(twist * share)),
        open: [ACCELERATION * bend, TURNING * bend],
        sigmas: a
            .sigmas
            .zip(b.sigmas)
            .map(|(x, y)| [0, 1].map(|k| x[k] + (y[k] - x[k]) * left)),
    })
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn track(rate: f64, pose: impl Fn(f64) -> Se3) -> VecDeque<Stand> {
        let sample = |k: u32| Stand {
            stamp: f64::from(k) / rate,
            odom_from_base: pose(f64::from(k) / rate),
            sigmas: Some([0.01 * f64::from(k), 0.0]),
        };
        (0..=(rate as u32)).map(sample).collect()
    }

    proptest! {
        #[test]
        fn constant_twist_is_interpolated_exactly(v in -1.0..1.0f64, w in -2.0..2.0f64, from in 0.05..0.4f64, span in 0.02..0.5f64) {
            let twist = Vec6::new(v, 0.0, 0.0, 0.0, 0.0, w);
            let samples = track(20.0, |t| Se3::exp(&(twist * t)));
            let way = between(&samples, [from, from + span]).unwrap();
            let off = way.earlier_from_later.inverse() * Se3::exp(&(twist * span));
            prop_assert!(off.log().norm() < 1e-9);
            prop_assert!((way.turned - w.abs() * span).abs() < 1e-9);
            prop_assert!(way.length <= v.abs() * span + 1e-9 && way.length > 0.95 * v.abs() * span);
            prop_assert!(way.ends[0] < ACCELERATION * 0.05 * 0.05 / 4.0);
            // The stated deviations are proportional to time: from 0.2 from to 0.2 (from + span).
            let grown = 0.2 * ((from + span) * (from + span) - from * from).sqrt();
            prop_assert!((way.stated[0] - grown).abs() < 1e-9 && way.stated[1] == 0.0);
        }
    }

    #[test]
    fn path_length_counts_reversals_and_gaps_are_refused() {
        let samples = track(50.0, |t| {
            Se3::new(so3::exp(&Vec3::zeros()), Vec3::x() * libm::sin(6.3 * t))
        });
        let way = between(&samples, [0.0, 1.0]).unwrap();
        assert!(way.earlier_from_later.translation.norm() < 0.03 && way.length > 3.9);
        let beyond = between(&samples, [0.5, 1.05]).unwrap();
        assert!(beyond.ends[0] > 1e-3 && between(&samples, [0.5, 1.2]).is_none());
        assert!(between(&samples, [-0.1, 0.5]).is_none());
        assert!(between(&samples, [0.5, 0.5]).is_none());
        let gap: VecDeque<_> = samples
            .into_iter()
            .filter(|s| !(0.3..0.7).contains(&s.stamp))
            .collect();
        assert!(between(&gap, [0.1, 0.5]).is_none() && between(&gap, [0.1, 0.8]).is_some());
        assert!(between(&VecDeque::new(), [0.0, 1.0]).is_none());
    }
}
