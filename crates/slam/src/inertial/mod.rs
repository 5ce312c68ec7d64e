//! The inertial sensor: rotation of the camera between two times, with its uncertainty.
//!
//! Keeps the samples of the last seconds, estimates gyroscope bias, mount and time offset from rest and tracked
//! rotations, and detects a sensor that is stuck, noisy or mounted otherwise. (docs/algorithm.md, the inertial sensor.)

mod calibration;
mod integrate;
mod report;
mod rest;
mod signal;

pub(crate) use calibration::MOUNT_SIGMA;
pub use report::{InertialReport, InertialState, SensorFault};

use crate::trust::{Comparison, POSES_SIGMA, Seen, Trust};
use calibration::{Calibration, Teaches, difference};
use integrate::Rotation;
use rest::Rest;
use signal::Signal;
use std::collections::VecDeque;
use stillpoint_geometry::nalgebra::UnitQuaternion;
use stillpoint_geometry::{ImuModel, Vec3};
use stillpoint_imaging::ImuSample;

/// Duration of kept samples, s: the sum of three for tracking the first frames of a map again (`retrace::MOST`) and
/// five for the longest propagation of a rotation (`carry::CARRIED_S`).
const KEPT_S: f64 = 8.0;
/// Maximum number of kept samples: [`KEPT_S`] of a sensor of 4 kHz are 32 000, rounded up to a power of two. The rate
/// is chosen, above that of usual sensors.
const KEPT: usize = 32_768;
/// Scale error of gyroscopes, as a share of the rotation: 1 % at most by data sheets.
const SCALE: f64 = 0.005;
/// Minimum number of frames over which specific force is summed to find the up direction: chosen, a second of 30 Hz, in
/// which accelerations of a hand average out.
const UP_FRAMES: f64 = 30.0;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Turn {
    /// Maps camera axes at the earlier time to those at the later one.
    pub(crate) later_from_earlier: UnitQuaternion<f64>,
    /// Standard deviation about each axis, rad.
    pub(crate) sigma: f64,
}

#[derive(Clone, Debug)]
pub(crate) struct Inertial {
    model: ImuModel,
    /// The newest ones, in order of time, with stamps on the camera's clock.
    samples: VecDeque<ImuSample>,
    known: Calibration,
    signal: Signal,
    rest: Rest,
    trust: Trust<UnitQuaternion<f64>>,
    /// Sum of specific forces in world axes, and the number of frames.
    force: (Vec3, f64),
}

impl Inertial {
    pub(crate) fn new(model: ImuModel) -> Self {
        Self {
            known: Calibration::new(&model),
            model,
            samples: VecDeque::new(),
            signal: Signal::default(),
            rest: Rest::default(),
            trust: Trust::default(),
            force: (Vec3::zeros(), 0.0),
        }
    }

    /// The sensor for frames in reverse order, with stamps mirrored at `pivot`, s: rotations are inverted.
    pub(crate) fn mirrored(&self, pivot: f64) -> Self {
        let mirror = |s: &ImuSample| ImuSample {
            stamp: 2.0 * pivot - s.stamp,
            angular_rate: s.angular_rate.map(|w| -w),
            specific_force: s.specific_force,
        };
        Self {
            samples: self.samples.iter().rev().map(mirror).collect(),
            known: self.known.mirrored(),
            ..self.clone()
        }
    }

    /// Takes samples in order of time. Non-finite and out-of-order samples are dropped.
    pub(crate) fn receive(&mut self, samples: &[ImuSample]) {
        for sample in samples.iter().filter(|s| s.is_finite()) {
            let sample = ImuSample {
                stamp: sample.stamp + self.model.time_offset,
                ..*sample
            };
            let before = self.samples.back().map(|s| s.stamp);
            if before.is_some_and(|before| sample.stamp <= before) {
                continue;
            }
            self.known.wait(before.map_or(0.0, |b| sample.stamp - b));
            self.signal.take(&sample);
            self.samples.push_back(sample);
            if let Some(still) = self.rest.take(&sample, &self.model) {
                // At rest the gyroscope measures its bias.
                self.known.measure_rest(&still.rate, still.sigma);
            }
            let is_old = |s: &ImuSample| sample.stamp - s.stamp > KEPT_S;
            while self.samples.len() > KEPT || self.samples.front().is_some_and(is_old) {
                self.samples.pop_front();
            }
        }
    }

    /// Drops all samples after the clock was set.
    pub(crate) fn forget_times(&mut self) {
        self.samples.clear();
        self.trust.interrupt();
        self.rest = Rest::default();
    }

    /// Resets after a change of the map's world frame.
    pub(crate) fn forget_world(&mut self) {
        self.trust.interrupt();
        self.force = (Vec3::zeros(), 0.0);
    }

    fn fault(&self) -> Option<SensorFault> {
        let contradicts = self.trust.contradicts().then_some(SensorFault::Contradicts);
        self.signal.fault().or(contradicts)
    }

    /// Whether the sensor has agreed with the camera's rotation and has no fault.
    pub(crate) fn is_confirmed(&self) -> bool {
        self.trust.is_confirmed() && self.fault().is_none()
    }

    /// Rotation of the camera between two times on the frames' clock, s. `None` if samples are missing or the sensor is
    /// not trusted.
    pub(crate) fn turn(&self, from: f64, to: f64) -> Option<Turn> {
        self.fault().is_none().then(|| self.measured(from, to))?
    }

    /// Likewise, regardless of trust.
    fn measured(&self, from: f64, to: f64) -> Option<Turn> {
        let rotation = self.rotation(from, to)?;
        let mount = &self.known.camera_from_imu;
        let later_from_earlier = mount * rotation.later_from_earlier * mount.inverse();
        let white = self.model.gyro_noise.max(self.signal.density()) * (to - from).sqrt();
        let known = self.known.sigma_of(&rotation);
        let scale = SCALE * later_from_earlier.angle();
        let sigma = (white * white + known * known + scale * scale).sqrt();
        Some(Turn {
            later_from_earlier,
            sigma,
        })
    }

    /// Rotation of the sensor between two times on the frames' clock, s.
    fn rotation(&self, from: f64, to: f64) -> Option<Rotation> {
        let span = [from, to].map(|t| t - self.known.offset);
        integrate::integrate(&self.samples, &self.known.bias, span)
    }

    /// Angular rate of the camera, in its own axes, rad/s. `None` if unknown or not trusted.
    pub(crate) fn rate(&self, at: f64) -> Option<Vec3> {
        self.fault().is_none().then_some(())?;
        let rate = integrate::rate_at(&self.samples, at - self.known.offset)? - self.known.bias;
        Some(self.known.camera_from_imu * rate)
    }

    /// Learns from a pose at `time` that the map confirms. Without `can_refute`, because much of the scene moves, it
    /// cannot count against the sensor.
    pub(crate) fn learn(
        &mut self,
        time: f64,
        world_from_camera: &UnitQuaternion<f64>,
        can_refute: bool,
    ) {
        self.sum_force(time, world_from_camera);
        let seen = Seen {
            time,
            world_from_camera: *world_from_camera,
        };
        let Some(from) = self.trust.follow(seen) else {
            return;
        };
        let Some(rotation) = self.rotation(from.time, time) else {
            return;
        };
        let camera = world_from_camera.inverse() * from.world_from_camera;
        let seen = self.known.in_sensor(&camera);
        let offset = difference(&rotation, &seen);
        let unknown = self.known.sigma_of(&rotation);
        let compared = Comparison::of_turn(camera.angle(), &offset, unknown);
        if self.trust.compare(compared, can_refute) {
            let scale = SCALE * camera.angle();
            let sigma = (POSES_SIGMA * POSES_SIGMA + scale * scale).sqrt();
            let teaches = if can_refute {
                Teaches::Everything
            } else {
                Teaches::Bias
            };
            self.known.measure_turn(&rotation, &seen, sigma, teaches);
        }
    }

    /// Called when the camera's pose is unknown or not confirmed by the map.
    pub(crate) fn interrupt(&mut self) {
        self.trust.interrupt();
    }

    /// Records that most of the image rotates otherwise.
    pub(crate) fn stand_against(&mut self) {
        self.trust.stand_against();
    }

    /// Over some seconds accelerations of a hand cancel out, and the mean specific force points up.
    fn sum_force(&mut self, time: f64, world_from_camera: &UnitQuaternion<f64>) {
        let time = time - self.known.offset;
        let near = self.samples.partition_point(|s| s.stamp < time);
        if let Some(sample) = self.samples.get(near) {
            let force = self.known.camera_from_imu * Vec3::from(sample.specific_force);
            self.force.0 += world_from_camera * force;
            self.force.1 += 1.0;
        }
    }

    pub(crate) fn report(&self) -> InertialReport {
        let state = match self.fault() {
            Some(fault) => InertialState::Ignored(fault),
            None if self.trust.is_confirmed() => InertialState::Confirmed,
            None => InertialState::Unconfirmed,
        };
        let (force, frames) = self.force;
        let norm = force.norm();
        let told = frames >= UP_FRAMES && norm > 0.5 * frames && state == InertialState::Confirmed;
        InertialReport {
            state,
            gyro_bias: self.known.bias.into(),
            gyro_bias_sigma: self.known.bias_sigma(),
            camera_from_imu: self.known.camera_from_imu,
            mount_error: self
                .known
                .camera_from_imu
                .angle_to(&self.model.camera_from_imu.rotation),
            mount_sigma: self.known.mount_sigma(),
            time_offset: self.model.time_offset + self.known.offset,
            time_offset_error: self.known.offset,
            time_offset_sigma: self.known.offset_sigma(),
            up: told.then(|| (force / norm).into()),
        }
    }
}

#[cfg(test)]
mod tests;
