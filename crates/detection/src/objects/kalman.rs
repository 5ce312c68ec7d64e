//! Kalman filter with eight states and sequential scalar measurements.

use stillpoint_geometry::nalgebra::{SMatrix, SVector};

/// A state, or one row of a Jacobian.
pub(super) type Vec8 = SVector<f64, 8>;
pub(super) type Mat8 = SMatrix<f64, 8, 8>;

/// One scalar measurement, linearised at the mean before the update.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// Derivative of the measurement by the state.
    pub(super) jacobian: Vec8,
    /// Measured minus predicted.
    pub(super) residual: f64,
    pub(super) variance: f64,
}

/// A state entry and its rate, driven by white noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drive {
    pub(super) value: usize,
    /// Index of its rate; `None` for a random walk.
    pub(super) rate: Option<usize>,
    /// Variance added to the rate (or random walk) per second.
    pub(super) density: f64,
    /// Decay of the rate per second: without measurements it returns to zero. 0: constant.
    pub(super) decay: f64,
}

impl Drive {
    /// Per unit of rate, the rate and the change of the value after `dt` seconds, and the process noise (value, cross,
    /// rate): a velocity that decays to zero under white noise (Singer, "Estimating optimal tracking filter performance
    /// for manned maneuvering targets", 1970, with the velocity in place of the acceleration); without decay, constant
    /// velocity.
    fn over(&self, dt: f64) -> ([f64; 2], [f64; 3]) {
        let (k, q, span) = (self.decay, self.density, dt.abs());
        if k * span < 1e-4 {
            let noise = [q * span * span * span / 3.0, q * dt * span / 2.0, q * span];
            return ([1.0, dt], noise);
        }
        let (kept, way) = (libm::exp(-k * dt), -libm::expm1(-k * dt) / k);
        let both = -libm::expm1(-2.0 * k * dt) / (2.0 * k);
        let sign = dt.signum();
        let noise = [
            sign * q * (dt - 2.0 * way + both) / (k * k),
            sign * q * way * way / 2.0,
            sign * q * both,
        ];
        ([kept, way], noise)
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gaussian {
    pub(super) mean: Vec8,
    /// Covariance, symmetric.
    pub(super) covariance: Mat8,
}

impl Gaussian {
    /// Predicts the state `dt` seconds later, or earlier if negative with the same uncertainty.
    ///
    /// Constant rates under white noise integrate exactly (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-4), so that many
    /// small steps equal one large step.
    pub(super) fn propagate(&mut self, dt: f64, drives: &[Drive]) {
        let mut f = Mat8::identity();
        let mut q = Mat8::zeros();
        let span = dt.abs();
        for d in drives {
            let Some(rate) = d.rate else {
                q[(d.value, d.value)] = d.density * span;
                continue;
            };
            let ([kept, way], [value, cross, rates]) = d.over(dt);
            f[(d.value, rate)] = way;
            f[(rate, rate)] = kept;
            q[(d.value, d.value)] = value;
            q[(d.value, rate)] = cross;
            q[(rate, d.value)] = cross;
            q[(rate, rate)] = rates;
        }
        self.mean = f * self.mean;
        let p = f * self.covariance * f.transpose() + q;
        self.covariance = (p + p.transpose()) * 0.5;
    }

    /// Applies measurements with independent errors and returns their squared Mahalanobis distance: chi-square with
    /// `rows.len()` degrees of freedom when the model holds. Sequential updates equal a joint one, without an inverse.
    pub(super) fn update(&mut self, rows: &[Row]) -> f64 {
        let start = self.mean;
        let mut chi2 = 0.0;
        for row in rows {
            let ph = self.covariance * row.jacobian;
            let s = row.jacobian.dot(&ph) + row.variance;
            if s.is_nan() || s <= 0.0 {
                continue;
            }
            let innovation = row.residual - row.jacobian.dot(&(self.mean - start));
            chi2 += innovation * innovation / s;
            self.mean += ph * (innovation / s);
            self.covariance -= ph * ph.transpose() / s;
        }
        chi2
    }

    /// Applies nonlinear measurements: `rows` is linearised repeatedly at the latest mean (iterated filter, Bar-Shalom,
    /// Li, Kirubarajan 2001, section 10.5.2). After long coasting the first linearisation is poor.
    pub(super) fn update_iterated(&mut self, rounds: usize, rows: impl Fn(&Vec8) -> Vec<Row>) {
        let prior = self.clone();
        for _ in 0..rounds {
            let mut rows = rows(&self.mean);
            for row in &mut rows {
                row.residual += row.jacobian.dot(&(self.mean - prior.mean));
            }
            let mut next = prior.clone();
            next.update(&rows);
            *self = next;
        }
    }

    /// Variance of a quantity with this derivative by the state.
    pub(super) fn variance(&self, jacobian: &Vec8) -> f64 {
        jacobian.dot(&(self.covariance * jacobian))
    }

    pub(super) fn distance(&self, rows: &[Row]) -> f64 {
        self.clone().update(rows)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::nalgebra::{SMatrix, SVector};

    fn numbers(n: usize) -> impl Strategy<Value = Vec<f64>> {
        proptest::collection::vec(-1.0..1.0_f64, n)
    }

    fn gaussian(v: &[f64]) -> Gaussian {
        let root = Mat8::from_column_slice(&v[8..72]);
        Gaussian {
            mean: Vec8::from_column_slice(&v[..8]),
            covariance: root * root.transpose() + Mat8::identity() * 0.1,
        }
    }

    const DRIVES: [Drive; 3] = [
        Drive {
            value: 0,
            rate: Some(3),
            density: 1.3,
            decay: 0.6,
        },
        Drive {
            value: 1,
            rate: Some(4),
            density: 0.7,
            decay: 0.0,
        },
        Drive {
            value: 6,
            rate: None,
            density: 0.4,
            decay: 0.0,
        },
    ];

    proptest! {
        #[test]
        fn sequential_updates_equal_a_joint_update(v in numbers(72), h in numbers(40), z in numbers(5)) {
            let prior = gaussian(&v);
            let jacobian = SMatrix::<f64, 5, 8>::from_row_slice(&h);
            let residual = SVector::<f64, 5>::from_column_slice(&z);
            let rows: Vec<Row> = (0..5)
                .map(|i| Row {
                    jacobian: jacobian.row(i).transpose(),
                    residual: residual[i],
                    variance: 0.2 + 0.1 * i as f64,
                })
                .collect();
            let noise = SMatrix::<f64, 5, 5>::from_diagonal(&SVector::from_fn(|i, _| rows[i].variance));
            let s = (jacobian * prior.covariance * jacobian.transpose() + noise).try_inverse().unwrap();
            let gain = prior.covariance * jacobian.transpose() * s;
            let mut posterior = prior.clone();
            let chi2 = posterior.update(&rows);
            let mean = prior.mean + gain * residual;
            let covariance = (Mat8::identity() - gain * jacobian) * prior.covariance;
            prop_assert!((chi2 - residual.dot(&(s * residual))).abs() < 1e-9);
            prop_assert!((posterior.mean - mean).norm() < 1e-9);
            prop_assert!((posterior.covariance - covariance).norm() < 1e-9);
            prop_assert_eq!(prior.distance(&rows), chi2);
        }

        #[test]
        fn two_propagation_steps_equal_one(v in numbers(72), a in 0.0..1.0_f64, b in 0.0..1.0_f64, sign in prop::bool::ANY) {
            let s = if sign { 1.0 } else { -1.0 };
            let mut once = gaussian(&v);
            let mut twice = once.clone();
            once.propagate(s * (a + b), &DRIVES);
            twice.propagate(s * a, &DRIVES);
            twice.propagate(s * b, &DRIVES);
            prop_assert!((once.mean - twice.mean).norm() < 1e-9);
            prop_assert!((once.covariance - twice.covariance).norm() < 1e-9);
        }

        #[test]
        fn forward_and_back_keeps_the_mean_and_adds_covariance(v in numbers(72), dt in 0.01..1.0_f64) {
            let start = gaussian(&v);
            let mut end = start.clone();
            end.propagate(dt, &DRIVES);
            end.propagate(-dt, &DRIVES);
            prop_assert!((start.mean - end.mean).norm() < 1e-9);
            for i in 0..8 {
                prop_assert!(end.covariance[(i, i)] >= start.covariance[(i, i)] - 1e-9);
            }
        }
    }
}
