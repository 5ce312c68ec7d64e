//! Inputs other than images: samples of an inertial sensor, of odometry, and pose priors.

use crate::arguments::value;
use crate::{inertial, odometry};
use pyo3::prelude::*;
use std::sync::{Mutex, PoisonError};
use stillpoint::geometry::{ImuModel, OdometryModel};
use stillpoint::imaging::{ImuSample, OdometrySample};

#[derive(Clone, Copy, Default)]
pub(crate) struct Models {
    pub(crate) imu: Option<ImuModel>,
    /// Odometry of the base, or of the camera itself for pose priors.
    pub(crate) odometry: Option<OdometryModel>,
    pub(crate) has_prior: bool,
}

pub(crate) struct Sensors {
    models: Models,
    /// Variances summed over all motions of priors, m^2 and rad^2.
    sum: Mutex<[f64; 2]>,
}

/// Sensor arguments of a frame.
pub(crate) struct Beside<'a, 'py> {
    pub(crate) imu: Option<&'a Bound<'py, PyAny>>,
    pub(crate) odometry: Option<&'a Bound<'py, PyAny>>,
    pub(crate) prior: Option<&'a Bound<'py, PyAny>>,
}

pub(crate) struct Samples {
    pub(crate) inertial: Vec<ImuSample>,
    odometry: Vec<OdometrySample>,
    prior: Option<odometry::Known>,
}

impl Sensors {
    pub(crate) fn new(models: Models) -> Self {
        Self {
            models,
            sum: Mutex::default(),
        }
    }

    pub(crate) fn check(&self, beside: &Beside<'_, '_>) -> PyResult<Samples> {
        let inertial = beside
            .imu
            .map(inertial::samples)
            .transpose()?
            .unwrap_or_default();
        if !inertial.is_empty() && self.models.imu.is_none() {
            return Err(value(
                "imu",
                "expected samples only where it is known how the sensor is mounted, found some; begin with Slam(..., imu=camera_from_imu)",
            ));
        }
        let odometry = beside
            .odometry
            .map(odometry::samples)
            .transpose()?
            .unwrap_or_default();
        if !odometry.is_empty() && (self.models.odometry.is_none() || self.models.has_prior) {
            return Err(value(
                "odometry",
                "expected samples only where it is known how the camera stands on the base, found some; begin with Slam(..., odometry=base_from_camera)",
            ));
        }
        if beside.prior.is_some() && !self.models.has_prior {
            return Err(value(
                "prior",
                "expected a pose only in a run that was begun with priors, found one; begin with Slam(..., prior=True)",
            ));
        }
        Ok(Samples {
            inertial,
            odometry,
            prior: beside.prior.map(odometry::Known::of).transpose()?,
        })
    }

    /// The odometry samples for a frame with this stamp, s.
    pub(crate) fn odometry(&self, samples: &mut Samples, stamp: f64) -> Vec<OdometrySample> {
        let mut all = std::mem::take(&mut samples.odometry);
        if let Some(known) = &samples.prior {
            let mut sum = self.sum.lock().unwrap_or_else(PoisonError::into_inner);
            all.push(known.sample(stamp, &mut sum));
        }
        all
    }
}
