//! Whether samples are those of a sensor that works: not stuck, and not much noisier than it should be.

use super::report::SensorFault;
use stillpoint_geometry::Vec3;
use stillpoint_imaging::ImuSample;

/// A sensor is stuck only if its values stay the same for this time, s: chosen, six frames of 30 Hz, before which a stuck sensor does little harm.
const STUCK_S: f64 = 0.2;
/// A sensor is stuck only if its values repeat at least this many times in a row: noise always changes the last digit of some of the six values.
/// Chosen: at 200 Hz the gyroscope's noise of a BMI055 is about ten of its digits (data sheet, 0.014 deg/s/sqrt(Hz), 65.6 LSB per deg/s).
const STUCK_COUNT: u32 = 10;
/// Samples that the noise is taken over, a number: chosen, a second of 200 Hz, in which the deviation of the noise is known to some per cent.
const WINDOW: f64 = 200.0;
/// Noise of this deviation from sample to sample is no use, rad/s: 10 deg/s, and 50 times that of a cheap sensor (BMI055 at 200 Hz by its data sheet,
/// 0.2 deg/s).
const USELESS: f64 = 0.17;

/// What the samples look like, one after the other.
#[derive(Clone, Debug, Default)]
pub(super) struct Signal {
    last: Option<ImuSample>,
    /// Rates of the last two samples, rad/s.
    rates: [Option<Vec3>; 2],
    /// How often the last values came in a row, and since when, s.
    same: u32,
    since: f64,
    /// Mean square of the second differences of the rates, (rad/s)^2, and of how many samples, up to [`WINDOW`].
    bends: f64,
    count: f64,
    /// Mean time between samples, s.
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

    /// The deviation of a rate's noise, rad/s: a second difference of independent values has six times their variance. Where the turning itself changes within two
    /// samples that counts as well, and what is concluded is less certain for it.
    pub(super) fn deviation(&self) -> f64 {
        (self.bends / 6.0).sqrt()
    }

    /// The density of the noise by the samples, rad/s/sqrt(Hz); 0 before there are enough.
    pub(super) fn density(&self) -> f64 {
        if self.count < 20.0 {
            return 0.0;
        }
        self.deviation() * self.period.max(0.0).sqrt()
    }

    /// What is wrong with them.
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

    /// Noise of deviation 1: a sum of twelve equal deviates, from a congruential generator.
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
    fn the_noise_is_measured_whatever_the_turning() {
        let turning = (0..400).map(|k| libm::sin(0.03 * f64::from(k)));
        let signal = after(turning.zip(noise()).map(|(x, n)| x + 0.01 * n));
        // The three axes have 1, 0.5 and 1 of it.
        let expected = 0.01 * (2.25_f64 / 3.0).sqrt();
        assert!((signal.deviation() / expected - 1.0).abs() < 0.2);
        assert!((signal.density() / (expected * 0.005_f64.sqrt()) - 1.0).abs() < 0.2);
        assert_eq!(signal.fault(), None);
    }

    #[test]
    fn a_stuck_sensor_and_a_wild_one_are_noticed() {
        let stuck = after(noise().take(50).chain(std::iter::repeat_n(0.3, 60)));
        assert_eq!(stuck.fault(), Some(SensorFault::Constant));
        let again = after(std::iter::repeat_n(0.3, 60).chain(noise().map(|n| 0.01 * n).take(300)));
        assert_eq!(again.fault(), None);
        let wild = after(noise().map(|n| 0.5 * n).take(100));
        assert_eq!(wild.fault(), Some(SensorFault::Noisy));
        // Steps of a coarse sensor at rest: some values in a row are the same.
        let coarse = after(noise().map(|n| 0.02 * n.round()).take(300));
        assert_eq!(coarse.fault(), None);
    }
}
