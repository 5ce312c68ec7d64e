//! Wheel odometry: motion of the camera between two times, with its uncertainty.
//!
//! Keeps the samples of the last seconds, and detects odometry that is stuck, noisy or badly calibrated, and slipping
//! wheels. (docs/algorithm.md, wheel odometry.)

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

/// Duration of kept samples, s: as long as a view may be blocked (30 s, `carry::WHEELED_S`), and the first frames of a
/// map are tracked again after three; the sum, with two to spare.
const KEPT_S: f64 = 35.0;
/// Maximum number of kept samples: [`KEPT_S`] of a source of 200 Hz are 7000, rounded up to a power of two. The rate is
/// chosen, above that of usual bases.
const KEPT: usize = 8192;
/// Minimum error of encoders, tyres and floor, m and rad: chosen, about an encoder's step and the play of its gear, at
/// a wheelbase of 1 m.
const FLOOR: f64 = 0.001;
/// Error of a given mount position, m: chosen, as a tape measure gives a position inside a housing to a centimetre.
const LEVER_SIGMA: f64 = 0.01;
/// Duration for which odometry is ignored after wheel slip, s: as long as the comparison in which slip is noticed
/// (`trust::SPAN_S`); chosen.
const SLIP_S: f64 = 0.5;
/// Motion between two compared poses below which a base stands still, m and rad: three times [`FLOOR`].
const IDLE: f64 = 0.003;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Motion {
    /// Maps camera coordinates at the earlier time to those at the later one.
    pub(crate) later_from_earlier: Se3,
    /// Standard deviations about and along each axis: rad and m.
    pub(crate) sigma_rad: f64,
    pub(crate) sigma_m: f64,
}

impl Motion {
    /// Whether the wheels stand still, or are stuck.
    pub(crate) fn is_idle(&self) -> bool {
        let moved = self.later_from_earlier;
        moved.translation.norm() < 1e-4 && moved.rotation.angle() < 1e-4
    }
}

#[derive(Clone, Debug)]
pub(crate) struct Odometry {
    model: OdometryModel,
    /// The newest ones, in order of time, with stamps on the camera's clock.
    samples: VecDeque<Stand>,
    taken: u64,
    jumps: Jumps,
    trust: Trust<Se3>,
    /// Consecutive failed comparisons while the wheels stood still.
    idle: u32,
    /// Time of the last detected slip, on the frames' clock, s.
    slipped_at: Option<f64>,
    slips: u32,
}

impl Odometry {
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

    /// The odometry for frames in reverse order, with stamps mirrored at `pivot`, s.
    pub(crate) fn mirrored(&self, pivot: f64) -> Self {
        let mirror = |s: &Stand| Stand {
            stamp: 2.0 * pivot - s.stamp,
            // Accumulated deviations would shrink in reverse; the model's noise is used instead.
            sigmas: None,
            ..*s
        };
        Self {
            samples: self.samples.iter().rev().map(mirror).collect(),
            slipped_at: self.slipped_at.map(|at| 2.0 * pivot - at),
            ..self.clone()
        }
    }

    /// Takes samples in order of time. Invalid poses and out-of-order samples are dropped.
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

    /// Drops all samples after the clock was set.
    pub(crate) fn forget_times(&mut self) {
        self.samples.clear();
        self.slipped_at = None;
        self.jumps = Jumps::default();
        self.trust.interrupt();
    }

    fn fault(&self) -> Option<OdometryFault> {
        if self.jumps.are_wild() {
            return Some(OdometryFault::Noisy);
        }
        self.trust.contradicts().then_some(match self.idle {
            0 => OdometryFault::Contradicts,
            _ => OdometryFault::Stuck,
        })
    }

    /// Whether it has agreed with the camera's motion and has no fault.
    pub(crate) fn is_confirmed(&self) -> bool {
        self.trust.is_confirmed() && self.fault().is_none()
    }

    /// Motion of the camera between two times on the frames' clock, s. `None` if samples are missing or not trusted,
    /// and during and shortly after wheel slip.
    pub(crate) fn motion(&self, from: f64, to: f64) -> Option<Motion> {
        let after = |at: f64| from >= at && to - at > SLIP_S;
        let held = self.slipped_at.is_none_or(|at| to < at || after(at));
        (held && self.fault().is_none()).then(|| self.measured(from, to))?
    }

    /// Likewise, regardless of trust.
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

    /// Standard deviations of the camera's position, m, and rotation, rad, after a path.
    fn sigmas(&self, way: &Way) -> [f64; 2] {
        let m = &self.model;
        let norm = |parts: &[f64]| parts.iter().map(|p| p * p).sum::<f64>().sqrt();
        let slip = norm(&[
            m.slip_per_radian * way.turned,
            m.turn_per_metre * way.length,
        ]);
        let turn = norm(&[FLOOR, way.ends[1], slip.max(way.stated[1])]);
        let slip = norm(&[m.slip_per_metre * way.length, 0.5 * turn * way.length]);
        let lever = m.base_from_camera.translation.norm();
        let mount = MOUNT_SIGMA * way.length + LEVER_SIGMA * way.turned;
        let place = [
            FLOOR,
            way.ends[0],
            slip.max(way.stated[0]),
            mount,
            lever * turn,
        ];
        [norm(&place), turn]
    }

    /// Learns from a pose at `time` that the map confirms. Without `can_refute`, because much of the scene moves, it
    /// cannot count against the odometry.
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

    /// Records wheel slip: the map confirms another motion.
    pub(crate) fn note_slip(&mut self, now: f64) {
        let goes_on = self.slipped_at.is_some_and(|at| now - at <= SLIP_S);
        self.slips += u32::from(!goes_on);
        self.slipped_at = Some(now);
    }

    /// Called when the camera's pose is unknown or not confirmed by the map.
    pub(crate) fn interrupt(&mut self) {
        self.trust.interrupt();
    }

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
