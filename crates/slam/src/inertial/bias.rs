//! The gyroscope's bias: what it measures where nothing turns.

use stillpoint_geometry::{Mat3, Vec3};

/// A measurement farther off than this is not of the same bias: 99.9 % of chi-square with three degrees of freedom.
const GATE: f64 = 16.27;

/// The bias and its covariance, by a Kalman filter: it walks, and rest and tracked rotations measure it.
#[derive(Clone, Copy, Debug)]
pub(super) struct GyroBias {
    /// In the axes of the sensor, rad/s.
    pub(super) value: Vec3,
    covariance: Mat3,
    walk: f64,
}

impl GyroBias {
    /// Of a sensor that was switched on: nought, give or take `sigma`, rad/s. It walks by `walk`, rad/s/sqrt(s).
    pub(super) fn new(sigma: f64, walk: f64) -> Self {
        Self {
            value: Vec3::zeros(),
            covariance: Mat3::identity() * (sigma * sigma),
            walk,
        }
    }

    /// Time goes by, s.
    pub(super) fn wait(&mut self, seconds: f64) {
        self.covariance += Mat3::identity() * (self.walk * self.walk * seconds.max(0.0));
    }

    /// What the bias leaves open of a rotation that changes with it by `by_bias`: one standard deviation about an axis, rad.
    pub(super) fn sigma_of(&self, by_bias: &Mat3) -> f64 {
        let of = by_bias * self.covariance * by_bias.transpose();
        (of.trace() / 3.0).max(0.0).sqrt()
    }

    /// Its own standard deviation, the mean of the three axes, rad/s.
    pub(super) fn sigma(&self) -> f64 {
        self.sigma_of(&Mat3::identity())
    }

    /// Takes a measurement: `offset` is by how much the bias's effect `by_bias` times what is wrong with it was seen, give or take `sigma` about each axis.
    /// False, and nothing changes, where that cannot be.
    pub(super) fn measure(&mut self, offset: &Vec3, by_bias: &Mat3, sigma: f64) -> bool {
        let spread =
            by_bias * self.covariance * by_bias.transpose() + Mat3::identity() * (sigma * sigma);
        let Some(inverse) = spread.try_inverse() else {
            return false;
        };
        if offset.dot(&(inverse * offset)) > GATE {
            return false;
        }
        let gain = self.covariance * by_bias.transpose() * inverse;
        self.value += gain * offset;
        let left = Mat3::identity() - gain * by_bias;
        // Joseph's form stays symmetric and positive.
        self.covariance =
            left * self.covariance * left.transpose() + gain * gain.transpose() * (sigma * sigma);
        true
    }

    /// Of a sensor whose time runs backwards.
    pub(super) fn mirrored(&self) -> Self {
        Self {
            value: -self.value,
            ..*self
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Exact measurements over spans of a second find any bias within what the sensor may have.
        #[test]
        fn measurements_find_the_bias(x in -0.03..0.03f64, y in -0.03..0.03f64, z in -0.03..0.03f64, span in 0.3..2.0f64) {
            let truth = Vec3::new(x, y, z);
            let mut bias = GyroBias::new(0.02, 1e-5);
            let by_bias = Mat3::identity() * span;
            for _ in 0..20 {
                bias.wait(span);
                let offset = by_bias * (truth - bias.value);
                prop_assert!(bias.measure(&offset, &by_bias, 0.002));
            }
            prop_assert!((bias.value - truth).norm() < 0.002, "{} {truth}", bias.value);
            prop_assert!(bias.sigma() < 0.002);
        }
    }

    #[test]
    fn what_no_bias_can_be_changes_nothing() {
        let mut bias = GyroBias::new(0.02, 1e-5);
        let before = bias.value;
        assert!(!bias.measure(&Vec3::new(0.0, 0.5, 0.0), &Mat3::identity(), 0.002));
        assert_eq!(bias.value, before);
    }

    #[test]
    fn what_is_not_measured_becomes_less_certain() {
        let mut bias = GyroBias::new(0.02, 1e-3);
        bias.measure(&Vec3::zeros(), &Mat3::identity(), 1e-4);
        let before = bias.sigma();
        bias.wait(100.0);
        assert!(before < 2e-4 && (bias.sigma() - 0.01).abs() < 1e-3);
    }
}
