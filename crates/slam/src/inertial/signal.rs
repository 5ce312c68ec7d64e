//! Detects a stuck or noisy inertial sensor from its samples.

use super::report::SensorFault;
use stillpoint_geometry::Vec3;
use stillpoint_imaging::ImuSample;

/// Duration of identical values after which a sensor is stuck, s: chosen, six frames of 30 Hz, before which a stuck
/// sensor does little harm.
const STUCK_S: f64 = 0.2;
/// Minimum number of identical samples in a row of a stuck sensor: noise always changes the last digit of some of the
/// six values. Chosen: at 200 Hz the gyroscope's noise of a BMI055 is about ten of its digits (data sheet, 0.014
/// deg/s/sqrt(Hz), 65.6 LSB per deg/s).
const STUCK_COUNT: u32 = 10;
/// Number of samples over which the noise is averaged: chosen, a second of 200 Hz, in which the deviation of the noise
/// is known to some per cent.
const WINDOW: f64 = 200.0;
/// Noise per sample from which a sensor is useless, rad/s: 10 deg/s, and 50 times that of a cheap sensor (BMI055 at 200
/// Hz by its data sheet, 0.2 deg/s).
const USELESS: f64 = 0.17;

#[derive(Clone, Debug, Default)]
pub(super) struct Signal {
    last: Option<ImuSample>,
    /// Rates of the last two samples, rad/s.
    rates: [Option<Vec3>; 2],
    /// Number of repetitions of the last values, and the stamp of the first, s.
    same: u32,
    since: f64,
    /// Mean square of the second differences of the rates, (rad/s)^2, and the number of samples, up to [`WINDOW`].
    bends: f64,
    count: f64,
    period: f64,
}

impl Signal {
    pub(super) fn take(&mut self, sample: &ImuSample) {
        let rate = Vec3::from(sample.angular_rate);
        if let Some(last) = self.last {
            let values = |s: &ImuSample| (s.angular_rate, s.specific_force);
            if values(&last) == values(sample) {
                self.same += 1;
            } else {
                (self.same, self.since) = (0, sample.stamp);
            }
            self.period += ((sample.stamp - last.stamp) - self.period) / (self.count + 1.0);
        } else {
            self.since = sample.stamp;
        }
        if let [Some(a), Some(b)] = self.rates {
            let bend = (rate - b * 2.0 + a).norm_squared() / 3.0;
            self.bends += (bend - self.bends) / (self.count + 1.0);
            self.count = (self.count + 1.0).min(WINDOW);
        }
        self.rates = [self.rates[1], Some(rate)];
        self.last = Some(*sample);
    }

    /// Standard deviation of a rate's noise, rad/s: a second difference of independent values has six times their
    /// variance. Angular jerk adds to it, which errs on the safe side.
    pub(super) fn deviation(&self) -> f64 {
        (self.bends / 6.0).sqrt()
    }

    /// Noise density from the samples, rad/s/sqrt(Hz); 0 until there are enough.
    pub(super) fn density(&self) -> f64 {
        if self.count < 20.0 {
            return 0.0;
        }
        self.deviation() * self.period.max(0.0).sqrt()
    }

    pub(super) fn fault(&self) -> Option<SensorFault> {
        let now = self.last?.stamp;
        if self.same >= STUCK_COUNT && now - self.since >= STUCK_S {
            return Some(SensorFault::Constant);
        }
        (self.count >= 20.0 && self.deviation() > USELESS).then_some(SensorFault::Noisy)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn after(rates: impl Iterator<Item = f64>) -> Signal {
        let mut signal = Signal::default();
        for (k, x) in rates.enumerate() {
            signal.take(&ImuSample {
                stamp: 0.005 * k as f64,
                angular_rate: [x, 0.5 * x, -x],
                specific_force: [0.0, 0.0, 9.8],
            });
        }
        signal
    }

    /// Noise of deviation 1: a sum of twelve uniform deviates from a congruential generator.
    fn noise() -> impl Iterator<Item = f64> {
        let mut state = 1_u64;
        std::iter::repeat_with(move || {
            let mut unit = || {
                state = state
                    .wrapping_mul(6_364_136_223_846_793_005)
                    .wrapping_add(1);
                (state >> 11) as f64 / (1_u64 << 53) as f64
            };
            (0..12).map(|_| unit()).sum::<f64>() - 6.0
        })
    }

    #[test]
    fn noise_estimate_is_independent_of_rotation() {
        let turning = (0..400).map(|k| libm::sin(0.03 * f64::from(k)));
        let signal = after(turning.zip(noise()).map(|(x, n)| x + 0.01 * n));
        // The three axes have 1, 0.5 and 1 times this rate.
        let expected = 0.01 * (2.25_f64 / 3.0).sqrt();
        assert!((signal.deviation() / expected - 1.0).abs() < 0.2);
        assert!((signal.density() / (expected * 0.005_f64.sqrt()) - 1.0).abs() < 0.2);
        assert_eq!(signal.fault(), None);
    }

    #[test]
    fn stuck_and_noisy_sensors_are_detected() {
        let stuck = after(noise().take(50).chain(std::iter::repeat_n(0.3, 60)));
        assert_eq!(stuck.fault(), Some(SensorFault::Constant));
        let again = after(std::iter::repeat_n(0.3, 60).chain(noise().map(|n| 0.01 * n).take(300)));
        assert_eq!(again.fault(), None);
        let wild = after(noise().map(|n| 0.5 * n).take(100));
        assert_eq!(wild.fault(), Some(SensorFault::Noisy));
        // A coarsely quantised sensor at rest repeats some values.
        let coarse = after(noise().map(|n| 0.02 * n.round()).take(300));
        assert_eq!(coarse.fault(), None);
    }
}
