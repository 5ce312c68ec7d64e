//! Odometry of the base that carries the camera: how the camera moved between two moments by its wheels, and whether they can be believed.
//!
//! Answers: the camera's motion by the wheels, with what it may be wrong by. Keeps the samples of the last seconds, and notices odometry that is stuck, noisy or of a base on which the camera
//! stands otherwise, and wheels that slip. Does not know images; what the motion is used for is the tracker's business. (docs/algorithm.md, wheel odometry.)

mod jumps;
mod path;
mod report;

pub use report::{OdometryFault, OdometryReport, OdometryState};

use crate::inertial::MOUNT_SIGMA;
use crate::trust::{Comparison, Seen, SensorState, Trust};
use jumps::Jumps;
use path::{Stand, Way};
use std::collections::VecDeque;
use stillpoint_geometry::{OdometryModel, Se3, so3};
use stillpoint_imaging::OdometrySample;

/// Samples are kept for so long, s: as long as a view may be blocked (30 s, `carry::WHEELED_S`), and the first frames of a map are tracked again
/// after three; the sum, with two to spare.
const KEPT_S: f64 = 35.0;
/// Largest number of samples that are kept: enough for [`KEPT_S`] of a source of 200 Hz, which are 7000, up to the next power of two. The rate is
/// chosen, above that of usual bases.
const KEPT: usize = 8192;
/// What encoders, tyres and floor err by in place however short the way, m: chosen, of the size of an encoder's step and the play of its gear.
const FLOOR_M: f64 = 0.001;
/// What they err by in direction, rad: chosen, [`FLOOR_M`] at a wheelbase of 1 m.
const FLOOR_RAD: f64 = 0.001;
/// What the place of a mount that is stated is off by, m: chosen, as a tape measure tells a place inside a housing to a centimetre.
const LEVER_SIGMA: f64 = 0.01;
/// After wheels were seen to slip they are not listened to for so long, s: as long as a comparison lasts in which slip is noticed (`trust::SPAN_S`);
/// chosen.
const SLIP_S: f64 = 0.5;
/// A base that moves by less than this between two poses that are compared stands still, m and rad: three times [`FLOOR_M`] and [`FLOOR_RAD`].
const IDLE: f64 = 0.003;

/// A motion of the camera.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    /// Maps coordinates of the camera at the earlier moment to those at the later one.
    pub(crate) later_from_earlier: Se3,
    /// Standard deviations about and along each axis: rad and m.
    pub(crate) sigma_rad: f64,
    pub(crate) sigma_m: f64,
}

impl Motion {
    /// Whether the wheels stand still: so do those that are stuck.
    pub(crate) fn is_idle(&self) -> bool {
        let moved = self.later_from_earlier;
        moved.translation.norm() < 1e-4 && moved.rotation.angle() < 1e-4
    }
}

/// The odometry and what is known of it.
#[derive(Clone, Debug)]
pub(crate) struct Odometry {
    model: OdometryModel,
    /// The newest ones, in order of time, with stamps on the camera's clock.
    samples: VecDeque<Stand>,
    taken: u64,
    jumps: Jumps,
    trust: Trust<Se3>,
    /// Comparisons in a row that failed while the wheels stood still.
    idle: u32,
    /// When wheels were seen to slip last, by the frames' clock, s.
    slipped_at: Option<f64>,
    slips: u32,
}

impl Odometry {
    /// Of a base that nothing is known of yet.
    pub(crate) fn new(model: OdometryModel) -> Self {
        Self {
            model,
            samples: VecDeque::new(),
            taken: 0,
            jumps: Jumps::default(),
            trust: Trust::default(),
            idle: 0,
            slipped_at: None,
            slips: 0,
        }
    }

    /// The same for frames whose stamps are mirrored at `pivot`, s.
    pub(crate) fn mirrored(&self, pivot: f64) -> Self {
        let mirror = |s: &Stand| Stand {
            stamp: 2.0 * pivot - s.stamp,
            // Counted from now on what is stated would shrink: the odometry's own figures must do.
            sigmas: None,
            ..*s
        };
        Self {
            samples: self.samples.iter().rev().map(mirror).collect(),
            slipped_at: self.slipped_at.map(|at| 2.0 * pivot - at),
            ..self.clone()
        }
    }

    /// Takes samples, in order of time. What is no pose, or not later than the one before, is left out.
    pub(crate) fn receive(&mut self, samples: &[OdometrySample]) {
        let offset = self.model.time_offset;
        for sample in samples.iter().filter_map(|s| Stand::of(s, offset)) {
            if self.samples.back().is_some_and(|b| sample.stamp <= b.stamp) {
                continue;
            }
            self.taken += 1;
            self.jumps.take(&sample);
            self.samples.push_back(sample);
            let is_old = |s: &Stand| sample.stamp - s.stamp > KEPT_S;
            while self.samples.len() > KEPT || self.samples.front().is_some_and(is_old) {
                self.samples.pop_front();
            }
        }
    }

    /// The clock was set: samples from before mean nothing any more.
    pub(crate) fn forget_times(&mut self) {
        self.samples.clear();
        self.slipped_at = None;
        self.jumps = Jumps::default();
        self.trust.interrupt();
    }

    /// What is wrong with it.
    fn fault(&self) -> Option<OdometryFault> {
        if self.jumps.are_wild() {
            return Some(OdometryFault::Noisy);
        }
        self.trust.contradicts().then_some(match self.idle {
            0 => OdometryFault::Contradicts,
            _ => OdometryFault::Stuck,
        })
    }

    /// Whether it has moved as the camera did, and is believed.
    pub(crate) fn is_confirmed(&self) -> bool {
        self.trust.is_confirmed() && self.fault().is_none()
    }

    /// How the camera moved between two moments on the frames' clock, s. None where samples are missing or are not believed, and where wheels slipped meanwhile or a moment ago.
    pub(crate) fn motion(&self, from: f64, to: f64) -> Option<Motion> {
        let after = |at: f64| from >= at && to - at > SLIP_S;
        let held = self.slipped_at.is_none_or(|at| to < at || after(at));
        (held && self.fault().is_none()).then(|| self.measured(from, to))?
    }

    /// The same whether it is believed or not.
    fn measured(&self, from: f64, to: f64) -> Option<Motion> {
        let way = path::between(&self.samples, [from, to])?;
        let earlier_from_later = self.model.camera_motion(&way.earlier_from_later);
        let [sigma_m, sigma_rad] = self.sigmas(&way);
        Some(Motion {
            later_from_earlier: earlier_from_later.inverse(),
            sigma_rad,
            sigma_m,
        })
    }

    /// Standard deviations of the camera's place, m, and direction, rad, after a way.
    fn sigmas(&self, way: &Way) -> [f64; 2] {
        let m = &self.model;
        let norm = |parts: &[f64]| parts.iter().map(|p| p * p).sum::<f64>().sqrt();
        let slip = norm(&[
            m.slip_per_radian * way.turned,
            m.turn_per_metre * way.length,
        ]);
        let turn = norm(&[FLOOR_RAD, way.ends[1], slip.max(way.stated[1])]);
        let slip = norm(&[m.slip_per_metre * way.length, 0.5 * turn * way.length]);
        let lever = m.base_from_camera.translation.norm();
        let mount = MOUNT_SIGMA * way.length + LEVER_SIGMA * way.turned;
        let place = [
            FLOOR_M,
            way.ends[0],
            slip.max(way.stated[0]),
            mount,
            lever * turn,
        ];
        [norm(&place), turn]
    }

    /// Learns from a pose at `time` that the map bears out. Where much moves beside it, it `can_refute` nothing.
    pub(crate) fn learn(&mut self, time: f64, world_from_camera: &Se3, can_refute: bool) {
        let seen = Seen {
            time,
            world_from_camera: *world_from_camera,
        };
        let Some(from) = self.trust.follow(seen) else {
            return;
        };
        let Some(way) = path::between(&self.samples, [from.time, time]) else {
            return;
        };
        let camera = from.world_from_camera.inverse() * *world_from_camera;
        let off = self.model.camera_motion(&way.earlier_from_later).inverse() * camera;
        let compared = Comparison::of_motion(
            camera.rotation.angle(),
            &so3::log(&off.rotation),
            camera.translation.norm(),
            off.translation.norm(),
        );
        let is_idle = way.length < IDLE && way.turned < IDLE;
        if self.trust.compare(compared, can_refute) {
            self.idle = 0;
        } else if can_refute {
            self.idle = if is_idle { self.idle + 1 } else { 0 };
        }
    }

    /// Wheels were seen to slip: the map bears another motion out.
    pub(crate) fn note_slip(&mut self, now: f64) {
        let goes_on = self.slipped_at.is_some_and(|at| now - at <= SLIP_S);
        self.slips += u32::from(!goes_on);
        self.slipped_at = Some(now);
    }

    /// Nothing is known of the camera's pose, or the map does not bear it out.
    pub(crate) fn interrupt(&mut self) {
        self.trust.interrupt();
    }

    /// What is to be said of it.
    pub(crate) fn report(&self) -> OdometryReport {
        let state = match self.fault() {
            Some(fault) => SensorState::Ignored(fault),
            None if self.trust.is_confirmed() => SensorState::Confirmed,
            None => SensorState::Unconfirmed,
        };
        OdometryReport {
            state,
            samples: self.taken,
            slips: self.slips,
        }
    }
}

#[cfg(test)]
mod tests;
