//! Integration of angular rates.

use std::collections::VecDeque;
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{Mat3, Vec3, so3};
use stillpoint_imaging::ImuSample;

/// Longest gap between samples that is bridged, s: chosen, half a period of a hand that trembles with 10 Hz, and ten
/// samples of 200 Hz.
const LONGEST_GAP: f64 = 0.05;
/// The rate is held constant for this long before the first and after the last sample, s: chosen, four samples of 200
/// Hz, and less than the time between two frames.
const LONGEST_HOLD: f64 = 0.02;

/// Rotation of the sensor between two times, in its own axes.
#[derive(Clone, Copy, Debug)]
pub(super) struct Rotation {
    /// Maps coordinates at the earlier time to those at the later one.
    pub(super) later_from_earlier: UnitQuaternion<f64>,
    /// Derivative by the subtracted bias: a left perturbation per rad/s.
    pub(super) by_bias: Mat3,
    /// Derivative by a shift of the samples' stamps: a left perturbation per second.
    pub(super) by_time: Vec3,
}

/// Integrates the rates between two times, s, less a bias, rad/s. Rates are interpolated linearly; each piece is
/// integrated to the fourth order (Magnus expansion: Iserles, Norsett, Phil. Trans. A 357, 1999). `None` if samples are
/// missing or `to` is not later.
pub(super) fn integrate(
    samples: &VecDeque<ImuSample>,
    bias: &Vec3,
    [from, to]: [f64; 2],
) -> Option<Rotation> {
    if to <= from {
        return None;
    }
    let first = samples.partition_point(|s| s.stamp <= from);
    let end = samples.partition_point(|s| s.stamp < to);
    let inner = samples.range(first..end.max(first)).map(|s| s.stamp);
    let mut moments = vec![from];
    moments.extend(inner);
    moments.push(to);
    let mut earlier_from_later = UnitQuaternion::identity();
    let mut by_bias = Mat3::zeros();
    let mut before = rate_at(samples, from)? - bias;
    let at_first = before;
    for pair in moments.windows(2) {
        let dt = pair[1] - pair[0];
        let after = rate_at(samples, pair[1])? - bias;
        let turn = (before + after) * (0.5 * dt) + before.cross(&after) * (dt * dt / 12.0);
        let step = so3::exp(&turn);
        earlier_from_later *= step;
        by_bias = step.inverse().to_rotation_matrix() * by_bias + Mat3::identity() * dt;
        before = after;
    }
    let later_from_earlier = earlier_from_later.inverse();
    Some(Rotation {
        later_from_earlier,
        by_bias,
        by_time: before - later_from_earlier * at_first,
    })
}

/// Angular rate at a time, interpolated between samples, or `None` if they are too far away.
pub(super) fn rate_at(samples: &VecDeque<ImuSample>, at: f64) -> Option<Vec3> {
    let next = samples.partition_point(|s| s.stamp < at);
    let after = samples.get(next);
    let before = next.checked_sub(1).and_then(|i| samples.get(i));
    let rate = |s: &ImuSample| Vec3::from(s.angular_rate);
    match (before, after) {
        (Some(a), Some(b)) => {
            let gap = b.stamp - a.stamp;
            let share = (at - a.stamp) / gap;
            (gap <= LONGEST_GAP).then(|| rate(a) + (rate(b) - rate(a)) * share)
        }
        (Some(one), None) | (None, Some(one)) => {
            ((one.stamp - at).abs() <= LONGEST_HOLD).then(|| rate(one))
        }
        (None, None) => None,
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A rotation known in closed form: about one axis, then about another that rotates with the first. Body rate of
    /// `exp(a t) exp(b t)`: `exp(-b t) a + b`.
    struct Turning {
        a: Vec3,
        b: Vec3,
    }

    impl Turning {
        fn world_from_body(&self, t: f64) -> UnitQuaternion<f64> {
            so3::exp(&(self.a * t)) * so3::exp(&(self.b * t))
        }

        fn samples(&self, rate: f64, jitter: f64) -> VecDeque<ImuSample> {
            let stamp = |k: u32| f64::from(k) / rate + jitter * f64::from(k % 3) / rate;
            let sample = |k: u32| ImuSample {
                stamp: stamp(k),
                angular_rate: (so3::exp(&(self.b * -stamp(k))) * self.a + self.b).into(),
                ..ImuSample::default()
            };
            (0..=(rate as u32)).map(sample).collect()
        }

        fn error(&self, samples: &VecDeque<ImuSample>, span: [f64; 2]) -> f64 {
            let found = integrate(samples, &Vec3::zeros(), span).unwrap();
            let [from, to] = span.map(|t| self.world_from_body(t));
            found.later_from_earlier.angle_to(&(to.inverse() * from))
        }
    }

    fn vector(size: f64) -> impl Strategy<Value = Vec3> {
        [-size..size, -size..size, -size..size].prop_map(Vec3::from)
    }

    proptest! {
        #[test]
        fn rotation_about_changing_axes_is_integrated_accurately(a in vector(2.5), b in vector(2.5), from in 0.01..0.4f64, span in 0.02..0.5f64, jitter in 0.0..0.3f64) {
            let turning = Turning { a, b };
            let span = [from, from + span];
            // Up to 250 deg/s about each axis, axes that turn as fast, 200 Hz.
            prop_assert!(turning.error(&turning.samples(200.0, jitter), span) < 3e-4);
            // The error comes from linear interpolation: it falls by four with each halved step and nearly vanishes at
            // 2 kHz.
            prop_assert!(turning.error(&turning.samples(2000.0, jitter), span) < 3e-6);
        }

        #[test]
        fn bias_derivative_matches_the_integrated_difference(a in vector(2.0), b in vector(2.0), bias in vector(0.01), span in 0.05..0.9f64) {
            let samples = Turning { a, b }.samples(200.0, 0.0);
            let [with, without] = [bias, Vec3::zeros()].map(|bias| integrate(&samples, &bias, [0.05, 0.05 + span]).unwrap());
            let moved = so3::log(&(with.later_from_earlier * without.later_from_earlier.inverse()));
            prop_assert!((moved - without.by_bias * bias).norm() < 1e-3 * span * bias.norm() + 2e-4 * span);
        }

        #[test]
        fn time_offset_derivative_matches_integrated_difference(a in vector(2.0), b in vector(2.0), offset in 1e-4..1e-3f64, from in 0.1..0.4f64, span in 0.05..0.5f64) {
            let samples = Turning { a, b }.samples(2000.0, 0.0);
            let [with, without] = [offset, 0.0].map(|o| integrate(&samples, &Vec3::zeros(), [from - o, from + span - o]).unwrap());
            let moved = so3::log(&(with.later_from_earlier * without.later_from_earlier.inverse()));
            prop_assert!((moved - without.by_time * offset).norm() < 20.0 * offset * offset + 1e-6);
        }

        #[test]
        fn integration_is_additive_over_intervals(a in vector(2.0), b in vector(2.0), cut in 0.1..0.8f64) {
            let samples = Turning { a, b }.samples(200.0, 0.0);
            let turn = |from, to| integrate(&samples, &Vec3::zeros(), [from, to]).unwrap().later_from_earlier;
            prop_assert!(turn(0.05, 0.9).angle_to(&(turn(cut, 0.9) * turn(0.05, cut))) < 1e-6);
        }
    }

    #[test]
    fn missing_samples_give_no_rotation() {
        let turning = Turning {
            a: Vec3::x(),
            b: Vec3::zeros(),
        };
        let mut samples = turning.samples(200.0, 0.0);
        let known = |samples: &VecDeque<ImuSample>, span| {
            integrate(samples, &Vec3::zeros(), span).is_some()
        };
        assert!(known(&samples, [0.0, 1.015]) && !known(&samples, [0.5, 1.03]));
        assert!(!known(&samples, [-0.03, 0.5]) && !known(&samples, [0.5, 0.5]));
        samples.retain(|s| !(0.4..0.46).contains(&s.stamp));
        assert!(!known(&samples, [0.3, 0.5]) && known(&samples, [0.5, 0.9]));
        assert!(!known(&VecDeque::new(), [0.0, 1.0]));
    }
}
