//! What measures the camera's motion beside images: a gyroscope on the camera, and odometry of the base that carries it.

use super::Tracker;
use super::carry::Carried;
use super::known::PastPoses;
use crate::inertial::Inertial;
use crate::odometry::Odometry;
use stillpoint_geometry::{ImuModel, OdometryModel, Vec3};
use stillpoint_imaging::{ImuSample, OdometrySample};

/// The sensors, and what is known by them.
#[derive(Default)]
pub(super) struct Sensors {
    /// The inertial sensor, where there is one.
    pub(super) inertial: Option<Inertial>,
    /// Odometry of the base that carries the camera, where there is any.
    pub(super) odometry: Option<Odometry>,
    /// Poses that were taken, to compare with what these say.
    pub(super) past_poses: PastPoses,
    /// Set while the camera is carried by them.
    pub(super) carried: Option<Carried>,
    /// When it was carried last, by the frames' clock, s.
    pub(super) blind_at: Option<f64>,
}

impl Tracker {
    /// The tracker with an inertial sensor on the camera.
    #[must_use]
    pub fn with_imu(mut self, model: ImuModel) -> Self {
        self.sensors.inertial = Some(Inertial::new(model));
        self
    }

    /// Takes samples of the inertial sensor, in order of time. Without a sensor ([`Tracker::with_imu`]) they mean nothing.
    pub fn receive_inertial(&mut self, samples: &[ImuSample]) {
        if let Some(inertial) = &mut self.sensors.inertial {
            inertial.receive(samples);
        }
    }

    /// Whether there is an inertial sensor.
    #[must_use]
    pub fn has_imu(&self) -> bool {
        self.sensors.inertial.is_some()
    }

    /// How fast the camera turned at the last pose and turns now, as the angular parts of twists of `camera_later_from_camera_earlier`, rad/s.
    pub(super) fn turning(&self) -> Option<[Vec3; 2]> {
        let inertial = self
            .sensors
            .inertial
            .as_ref()
            .filter(|i| i.is_confirmed())?;
        let last = self.state.tracked()?;
        let before = inertial.rate(last.time)?;
        let now = inertial.rate(self.front_end.clock.now())?;
        // What the camera sees turns the other way.
        Some([-before, -now])
    }

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
