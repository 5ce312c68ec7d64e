//! Detects rest of the sensor, during which a gyroscope measures its bias.

use stillpoint_geometry::{ImuModel, Vec3};
use stillpoint_imaging::ImuSample;

/// Duration for which the values must spread no more than the noise, s: chosen, as the noise of a BMI055 (data sheet,
/// 0.014 deg/s/sqrt(Hz)) then leaves 0.35 mrad/s of the mean, well below [`SLOWEST`].
const STILL_S: f64 = 0.5;
/// Minimum number of samples: chosen, as a standard deviation of 20 values is known to 16 % (1 / sqrt(2 (n - 1)),
/// normal distribution), well within [`SPREAD`].
const LEAST: f64 = 20.0;
/// Factor by which values may spread more than the data sheet's noise, since tables vibrate.
const SPREAD: f64 = 2.0;
/// Rate below which a hand-held camera cannot stay, rad/s: a smaller mean may be a slow rotation, and is no more exact
/// than that. Chosen: 0.1 deg/s, a tenth of the offset of a BMI055 (data sheet, 1 deg/s).
const SLOWEST: f64 = 2e-3;

pub(super) struct Still {
    pub(super) rate: Vec3,
    pub(super) sigma: f64,
}

#[derive(Clone, Debug, Default)]
pub(super) struct Rest {
    since: Option<f64>,
    count: f64,
    rate: Vec3,
    rate_squares: f64,
    force: Vec3,
    force_squares: f64,
}

impl Rest {
    /// Adds a sample; at the end of an interval returns its mean if the sensor was at rest.
    pub(super) fn take(&mut self, sample: &ImuSample, model: &ImuModel) -> Option<Still> {
        let since = *self.since.get_or_insert(sample.stamp);
        let (rate, force) = (
            Vec3::from(sample.angular_rate),
            Vec3::from(sample.specific_force),
        );
        self.count += 1.0;
        self.rate += rate;
        self.rate_squares += rate.norm_squared();
        self.force += force;
        self.force_squares += force.norm_squared();
        let seconds = sample.stamp - since;
        if seconds < STILL_S {
            return None;
        }
        let stretch = std::mem::take(self);
        stretch.judge(seconds, model)
    }

    fn judge(&self, seconds: f64, model: &ImuModel) -> Option<Still> {
        let n = self.count;
        let spread = |sum: &Vec3, squares: f64| {
            ((squares / n - (sum / n).norm_squared()).max(0.0) / 3.0).sqrt()
        };
        let per_sample = (n / seconds).sqrt() * SPREAD;
        let still = spread(&self.rate, self.rate_squares) <= model.gyro_noise * per_sample
            && spread(&self.force, self.force_squares) <= model.accel_noise * per_sample;
        (n >= LEAST && still).then(|| Still {
            rate: self.rate / n,
            sigma: SLOWEST.max(model.gyro_noise / seconds.sqrt()),
        })
    }
}
