//! Odometry of the base that carries the camera.

use super::Tracker;
use crate::odometry::Odometry;
use stillpoint_geometry::OdometryModel;
use stillpoint_imaging::OdometrySample;

impl Tracker {
    /// The tracker with odometry of the base that carries the camera.
    #[must_use]
    pub fn with_odometry(mut self, model: OdometryModel) -> Self {
        self.sensors.odometry = Some(Odometry::new(model));
        self
    }

    /// Takes samples of the odometry, in order of time. Without any ([`Tracker::with_odometry`]) they mean nothing.
    pub fn receive_odometry(&mut self, samples: &[OdometrySample]) {
        if let Some(odometry) = &mut self.sensors.odometry {
            odometry.receive(samples);
        }
    }

    /// Whether there is odometry.
    #[must_use]
    pub fn has_odometry(&self) -> bool {
        self.sensors.odometry.is_some()
    }
}
