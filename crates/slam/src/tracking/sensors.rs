//! Motion sensors other than the camera: a gyroscope on the camera, and odometry of its base.

use super::Tracker;
use super::carry::Carried;
use super::known::PastPoses;
use crate::inertial::Inertial;
use crate::odometry::Odometry;
use stillpoint_geometry::{ImuModel, OdometryModel, Vec3};
use stillpoint_imaging::{ImuSample, OdometrySample};

#[derive(Default)]
pub(super) struct Sensors {
    pub(super) inertial: Option<Inertial>,
    /// Odometry of the base that carries the camera, if any.
    pub(super) odometry: Option<Odometry>,
    /// Recent poses for comparison with the sensors.
    pub(super) past_poses: PastPoses,
    /// Set while the pose is propagated by sensors.
    pub(super) carried: Option<Carried>,
    /// Time of the last propagated pose, on the frames' clock, s.
    pub(super) blind_at: Option<f64>,
}

impl Tracker {
    /// Adds an inertial sensor on the camera.
    #[must_use]
    pub fn with_imu(mut self, model: ImuModel) -> Self {
        self.sensors.inertial = Some(Inertial::new(model));
        self
    }

    /// Takes samples of the inertial sensor, in order of time. Ignored without a sensor ([`Tracker::with_imu`]).
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

    /// Angular velocity at the last pose and at the current frame, as the angular parts of twists of
    /// `camera_later_from_camera_earlier`, rad/s.
    pub(super) fn turning(&self) -> Option<[Vec3; 2]> {
        let inertial = self
            .sensors
            .inertial
            .as_ref()
            .filter(|i| i.is_confirmed())?;
        let last = self.state.tracked()?;
        let before = inertial.rate(last.time)?;
        let now = inertial.rate(self.front_end.clock.now())?;
        // The scene rotates opposite to the camera.
        Some([-before, -now])
    }

    /// Adds odometry of the base that carries the camera.
    #[must_use]
    pub fn with_odometry(mut self, model: OdometryModel) -> Self {
        self.sensors.odometry = Some(Odometry::new(model));
        self
    }

    /// Takes odometry samples, in order of time. Ignored without odometry ([`Tracker::with_odometry`]).
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
