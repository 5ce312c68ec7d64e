//! Kalman filter of eight numbers with measurements that arrive one scalar at a time.

use stillpoint_geometry::nalgebra::{SMatrix, SVector};

/// Eight numbers: the state of an object, or one row of a Jacobian.
pub(super) type Vec8 = SVector<f64, 8>;
/// Covariance of a state.
pub(super) type Mat8 = SMatrix<f64, 8, 8>;

/// One scalar measurement, linearised at the mean before the update.
#[derive(Clone, Copy, Debug)]
pub(super) struct Row {
    /// Derivative of the measured number by the state.
    pub(super) jacobian: Vec8,
    /// Measured minus predicted.
    pub(super) residual: f64,
    /// Variance of the measurement.
    pub(super) variance: f64,
}

/// Two entries of the state of which one is the rate of the other, driven by white noise.
#[derive(Clone, Copy, Debug)]
pub(super) struct Drive {
    /// Index of the value.
    pub(super) value: usize,
    /// Index of its rate; `None` for a random walk.
    pub(super) rate: Option<usize>,
    /// Variance that the rate (or the walking value) gains per second.
    pub(super) density: f64,
}

/// A normal distribution of a state.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Gaussian {
    /// Mean.
    pub(super) mean: Vec8,
    /// Covariance, symmetric.
    pub(super) covariance: Mat8,
}

impl Gaussian {
    /// The state `dt` seconds later; earlier if negative, where it is just as uncertain.
    ///
    /// Constant rates under white noise integrate exactly (Bar-Shalom, Li, Kirubarajan 2001, eq. 6.2.2-4), so that many small steps are one large step.
    pub(super) fn propagate(&mut self, dt: f64, drives: &[Drive]) {
        let mut f = Mat8::identity();
        let mut q = Mat8::zeros();
        let span = dt.abs();
        for d in drives {
            let Some(rate) = d.rate else {
                q[(d.value, d.value)] = d.density * span;
                continue;
            };
            f[(d.value, rate)] = dt;
            let cross = d.density * dt * span / 2.0;
            q[(d.value, d.value)] = d.density * span * span * span / 3.0;
            q[(d.value, rate)] = cross;
            q[(rate, d.value)] = cross;
            q[(rate, rate)] = d.density * span;
        }
        self.mean = f * self.mean;
        let p = f * self.covariance * f.transpose() + q;
        self.covariance = (p + p.transpose()) * 0.5;
    }

    /// Takes in measurements with independent errors and returns their squared Mahalanobis distance: chi-square with `rows.len()` degrees of freedom
    /// when the model holds. One after the other is the same as all at once, and needs no inverse.
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

    /// What [`Self::update`] would return.
    pub(super) fn distance(&self, rows: &[Row]) -> f64 {
        self.clone().update(rows)
    }
}
