//! The inertial sensor beside the camera: how the camera turned between two moments, and whether the sensor can be believed.
//!
//! Answers: the camera's turn by the gyroscope, with what it may be wrong by. Keeps the samples of the last seconds, estimates the gyroscope's bias from rest and
//! from tracked rotations, and from these how the sensor is mounted and how its clock is off, and notices a sensor that is stuck, noisy or mounted otherwise. Does not know images; what the turn is used for is the tracker's business.
//! (docs/algorithm.md, the inertial sensor.)

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

/// Samples are kept for so long, s: the first frames of a map are tracked again after three (`retrace::MOST`), and five are the longest time that a
/// direction is carried (`carry::CARRIED_S`); this is the sum.
const KEPT_S: f64 = 8.0;
/// Largest number of samples that are kept: enough for [`KEPT_S`] of a sensor of 4 kHz, which are 32 000, up to the next power of two. The rate is
/// chosen, above that of usual sensors.
const KEPT: usize = 32_768;
/// By how much gyroscopes err in scale, as a share of the turn: 1 % at most by data sheets.
const SCALE: f64 = 0.005;
/// Specific force is summed up over so many frames at least before it tells which way is up, a number: chosen, a second of 30 Hz, in which what a
/// hand accelerates averages out.
const UP_FRAMES: f64 = 30.0;

/// A turn of the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Turn {
    /// Maps coordinates of the camera at the earlier moment to those at the later one, as far as they turn.
    pub(crate) later_from_earlier: UnitQuaternion<f64>,
    /// Standard deviation about each axis, rad.
    pub(crate) sigma: f64,
}

/// The sensor and what is known of it.
#[derive(Clone, Debug)]
pub(crate) struct Inertial {
    model: ImuModel,
    /// The newest ones, in order of time, with stamps on the camera's clock.
    samples: VecDeque<ImuSample>,
    known: Calibration,
    signal: Signal,
    rest: Rest,
    trust: Trust<UnitQuaternion<f64>>,
    /// Sum of specific forces in the world, and of how many frames.
    force: (Vec3, f64),
}

impl Inertial {
    /// A sensor that was just switched on.
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

    /// The same sensor for frames whose stamps are mirrored at `pivot`, s: what turned to the left turns to the right.
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

    /// Takes samples, in order of time. What is no number, or not later than the one before, is left out.
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
                // What a sensor at rest measures is its bias.
                self.known.measure_rest(&still.rate, still.sigma);
            }
            let is_old = |s: &ImuSample| sample.stamp - s.stamp > KEPT_S;
            while self.samples.len() > KEPT || self.samples.front().is_some_and(is_old) {
                self.samples.pop_front();
            }
        }
    }

    /// The clock was set: samples from before mean nothing any more.
    pub(crate) fn forget_times(&mut self) {
        self.samples.clear();
        self.trust.interrupt();
        self.rest = Rest::default();
    }

    /// The world of the map is another one now.
    pub(crate) fn forget_world(&mut self) {
        self.trust.interrupt();
        self.force = (Vec3::zeros(), 0.0);
    }

    /// What is wrong with the sensor.
    fn fault(&self) -> Option<SensorFault> {
        let contradicts = self.trust.contradicts().then_some(SensorFault::Contradicts);
        self.signal.fault().or(contradicts)
    }

    /// Whether it has turned as the camera did, and is believed.
    pub(crate) fn is_confirmed(&self) -> bool {
        self.trust.is_confirmed() && self.fault().is_none()
    }

    /// How the camera turned between two moments on the frames' clock, s. None where samples are missing or are not believed.
    pub(crate) fn turn(&self, from: f64, to: f64) -> Option<Turn> {
        self.fault().is_none().then(|| self.measured(from, to))?
    }

    /// The same whether it is believed or not.
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

    /// How the sensor turned between two moments on the frames' clock, s.
    fn rotation(&self, from: f64, to: f64) -> Option<Rotation> {
        let span = [from, to].map(|t| t - self.known.offset);
        integrate::integrate(&self.samples, &self.known.bias, span)
    }

    /// How fast the camera turns at a moment, in its own axes, rad/s. None where it is not known, or not believed.
    pub(crate) fn rate(&self, at: f64) -> Option<Vec3> {
        self.fault().is_none().then_some(())?;
        let rate = integrate::rate_at(&self.samples, at - self.known.offset)? - self.known.bias;
        Some(self.known.camera_from_imu * rate)
    }

    /// Learns from a pose at `time` that the map bears out. Where much moves beside it, it `can_refute` nothing.
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

    /// Nothing is known of the camera's pose, or the map does not bear it out.
    pub(crate) fn interrupt(&mut self) {
        self.trust.interrupt();
    }

    /// Most of what is seen turns otherwise.
    pub(crate) fn stand_against(&mut self) {
        self.trust.stand_against();
    }

    /// Over some seconds a hand's accelerations cancel out, and what is left of the specific force is what carries the sensor: upwards.
    fn sum_force(&mut self, time: f64, world_from_camera: &UnitQuaternion<f64>) {
        let time = time - self.known.offset;
        let near = self.samples.partition_point(|s| s.stamp < time);
        if let Some(sample) = self.samples.get(near) {
            let force = self.known.camera_from_imu * Vec3::from(sample.specific_force);
            self.force.0 += world_from_camera * force;
            self.force.1 += 1.0;
        }
    }

    /// What is to be said of it.
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
