//! Camera paths: exact poses at any time, smooth to the second derivative.
//!
//! World axes: z up, m; camera axes: x right, y down, z forward.

mod walk;

use crate::random::{Purpose, Stream};
use std::f64::consts::FRAC_PI_2;
use stillpoint_geometry::nalgebra::Matrix3;
use stillpoint_geometry::{Se3, Vec3, so3};
use walk::Walk;

pub(crate) struct Path {
    kind: Kind,
    /// Slow and fast tremor of the hand that holds the camera.
    tremor: Tremor,
    /// Additional distance from the desk, m.
    back: f64,
    /// Offset of the motion's start, s.
    ahead: f64,
    jolts: bool,
}

enum Kind {
    /// Translations along the axes, nearly without rotation, or with nodding.
    Xyz { nods: bool },
    /// Rotations about the axes, nearly without translation, at a multiple of the slowest speed.
    Rpy { pace: f64 },
    /// On half a sphere about the desk, looking at it; the elevation is divided by `flat`.
    Halfsphere { flat: f64 },
    /// Hand-held, static.
    Static,
    /// At one place, turning left by 60 degrees.
    Blocked { walks: bool },
    /// A walk along a closed curve.
    Loop(Walk),
    /// From a pose with a constant twist per second in camera coordinates.
    #[cfg(test)]
    Steady(Se3, stillpoint_geometry::Vec6),
}

/// Centre of the view in the small scenes, m.
const DESK_CENTRE: [f64; 3] = [0.0, -0.05, 0.8];

/// From 0 at 0 to 1 at 1, smooth to the second derivative.
fn smooth(share: f64) -> f64 {
    let share = share.clamp(0.0, 1.0);
    share * share * share * (share * (6.0 * share - 15.0) + 10.0)
}

/// Position of the camera with blocked view, m: it stands, or walks aside by 0.8 m within three seconds.
pub(crate) fn blocked_eye(t: f64, walks: bool) -> [f64; 2] {
    let aside = if walks { 0.8 } else { 0.0 };
    [(smooth((t - 3.0) / 3.0) - 0.5) * aside, -2.0]
}

/// Rotation of that camera to the left of the desk, rad: if it stands, 60 degrees within three seconds.
pub(crate) fn blocked_turn(t: f64, walks: bool) -> f64 {
    let turn = if walks { 0.0_f64 } else { 60.0 };
    (smooth((t - 3.0) / 3.0) - 0.5) * turn.to_radians()
}

/// Time at which a nodding camera turns fastest, s: just after the first second, in which trackers cannot know which regions move.
const NOD: f64 = 1.2;
/// Duration of the turn, s, and its angle, rad: at most 160 deg/s, about as fast as fr1_rpy turns.
const NOD_TIME: f64 = 0.4;
const NOD_BY: f64 = 0.6;

/// Upward pitch of a nodding camera, rad: it looks down at first and a little up after [`NOD`].
fn nod(t: f64) -> f64 {
    NOD_BY * (smooth((t - NOD) / NOD_TIME + 0.5) - 0.75)
}

fn wave(t: f64, hertz: f64, phase: f64) -> f64 {
    libm::sin(std::f64::consts::TAU * hertz * t + phase)
}

impl Path {
    fn of(kind: Kind, tremor: Tremor) -> Self {
        Self {
            kind,
            tremor,
            back: 0.0,
            ahead: 0.0,
            jolts: false,
        }
    }

    pub(crate) fn xyz(seed: u64) -> Self {
        Self::of(Kind::Xyz { nods: false }, Tremor::new(seed, 3.0))
    }

    /// The motion of [`Self::xyz`] with nodding.
    pub(crate) fn nodding(seed: u64) -> Self {
        Self {
            kind: Kind::Xyz { nods: true },
            ..Self::xyz(seed)
        }
    }

    pub(crate) fn rpy(seed: u64) -> Self {
        Self::rpy_at(seed, 1.0)
    }

    /// The rotations of [`Self::rpy`] at a multiple of their speed.
    pub(crate) fn rpy_at(seed: u64, pace: f64) -> Self {
        Self::of(Kind::Rpy { pace }, Tremor::new(seed, 2.0))
    }

    pub(crate) fn halfsphere(seed: u64) -> Self {
        Self::halfsphere_at(seed, 1.0)
    }

    /// The motion of [`Self::halfsphere`] with the elevation divided by `flat`, so that people are seen from the front.
    pub(crate) fn halfsphere_at(seed: u64, flat: f64) -> Self {
        Self::of(Kind::Halfsphere { flat }, Tremor::new(seed, 1.0))
    }

    pub(crate) fn still(seed: u64) -> Self {
        Self::of(Kind::Static, Tremor::new(seed, 0.6))
    }

    /// A rotation, or a walk, with a view that is blocked meanwhile.
    pub(crate) fn blocked(seed: u64, walks: bool) -> Self {
        Self::of(Kind::Blocked { walks }, Tremor::new(seed, 1.5))
    }

    /// Without tremor, from a pose with a constant twist per second in camera coordinates.
    #[cfg(test)]
    pub(crate) fn steady(start: Se3, twist: stillpoint_geometry::Vec6) -> Self {
        Self::of(Kind::Steady(start, twist), Tremor::new(0, 0.0))
    }

    /// A walk along a closed polygon of (x, y) corners, which are rounded.
    pub(crate) fn walk(seed: u64, corners: &[[f64; 2]]) -> Self {
        Self::of(Kind::Loop(Walk::new(corners)), Tremor::new(seed, 1.5))
    }

    /// A fast walk with constant looks to both sides.
    pub(crate) fn in_haste(mut self) -> Self {
        if let Kind::Loop(walk) = &mut self.kind {
            walk.hurry();
        }
        self
    }

    /// Ends a walk after this length of its polygon (m); other motions stay unchanged.
    pub(crate) fn for_length(mut self, length: f64) -> Self {
        if let Kind::Loop(walk) = &mut self.kind {
            walk.length = length;
        }
        self
    }

    /// Moves the camera `back` m away from the desk, so that people can pass in front of it.
    pub(crate) fn farther(self, back: f64) -> Self {
        Self { back, ..self }
    }

    /// Starts the motion at a later moment, s.
    pub(crate) fn starting_at(self, ahead: f64) -> Self {
        Self { ahead, ..self }
    }

    /// Adds jolts of up to 7 m/s^2 upwards and sideways, as on legs or on a rough floor.
    pub(crate) fn jolting(self) -> Self {
        Self {
            jolts: true,
            ..self
        }
    }

    pub(crate) fn duration(&self) -> f64 {
        match &self.kind {
            Kind::Loop(walk) => walk.duration(),
            Kind::Blocked { .. } => 9.0,
            _ => 10.0,
        }
    }

    /// The pose at a stamp (s).
    pub(crate) fn world_from_camera(&self, t: f64) -> Se3 {
        let centre = Vec3::from(DESK_CENTRE);
        let t = t + self.ahead;
        let base = match &self.kind {
            Kind::Xyz { nods } => {
                let offset = Vec3::new(
                    0.24 * wave(t, 0.21, 0.0),
                    0.16 * wave(t, 0.14, 1.0),
                    0.13 * wave(t, 0.17, 2.0),
                );
                let at = centre + Vec3::new(-0.05, -1.0 - self.back, 0.5) + offset;
                let level = look_at(at, centre + offset + Vec3::new(-0.05, 0.0, 0.0));
                if *nods {
                    level * Se3::new(so3::exp(&(Vec3::x() * nod(t))), Vec3::zeros())
                } else {
                    level
                }
            }
            Kind::Rpy { pace } => {
                let t = t * pace;
                let at = centre + Vec3::new(0.0, -1.1 - self.back, 0.5);
                // The three axes alternate, with smooth changes.
                let share = |k: f64| 0.5 + 0.5 * wave(t, 0.1, 2.1 * k);
                let turn = Vec3::new(
                    0.22 * share(0.0) * wave(t, 0.37, 0.5),
                    0.6 * share(1.0) * wave(t, 0.26, 0.0),
                    0.5 * share(2.0) * wave(t, 0.31, 1.0),
                );
                look_at(at, centre) * Se3::new(so3::exp(&turn), Vec3::zeros())
            }
            Kind::Halfsphere { flat } => {
                let radius = 1.0 + self.back + 0.12 * wave(t, 0.11, 0.0);
                let azimuth = 0.9 * wave(t, 0.1, -0.6);
                // A larger sphere is flatter, to stay below the ceiling.
                let elevation =
                    (0.7 + 0.33 * wave(t, 0.17, 0.8)) / ((1.0 + 0.55 * self.back) * flat);
                let ground = radius * libm::cos(elevation);
                let out = Vec3::new(
                    ground * libm::sin(azimuth),
                    -ground * libm::cos(azimuth),
                    radius * libm::sin(elevation),
                );
                look_at(centre + out, centre)
            }
            Kind::Static => look_at(centre + Vec3::new(-0.1, -1.1 - self.back, 0.55), centre),
            Kind::Blocked { walks } => {
                let [x, y] = blocked_eye(t, *walks);
                let eye = Vec3::new(x, y, 1.35);
                // Before, it glances to both sides, as hand-held cameras do.
                let glance = 0.14 * wave(t, 0.5, 0.0) * (1.0 - smooth(t - 1.5));
                let angle = FRAC_PI_2 + blocked_turn(t, *walks) + glance;
                let ahead = Vec3::new(libm::cos(angle), libm::sin(angle), -0.3);
                look_at(eye, eye + ahead)
            }
            Kind::Loop(walk) => walk.pose(t),
            #[cfg(test)]
            Kind::Steady(start, twist) => *start * Se3::exp(&(twist * t)),
        };
        let mut pose = base * self.tremor.at(t);
        if self.jolts {
            pose.translation.x += 0.015 * wave(t, 3.4, 0.7);
            pose.translation.z += 0.025 * wave(t, 2.7, 0.0);
        }
        pose
    }
}

/// The pose at `eye` with the optical axis through `target` and the horizon level.
fn look_at(eye: Vec3, target: Vec3) -> Se3 {
    let forward = (target - eye).normalize();
    let right = forward.cross(&Vec3::z()).normalize();
    let down = forward.cross(&right);
    Se3::from_matrix(&Matrix3::from_columns(&[right, down, forward]), eye)
}

/// Sums of sines with random phases: 2 mm and 0.15 degrees at size 1.
struct Tremor {
    /// Per axis: amplitude (m or rad), frequency (Hz), phase.
    waves: [[[f64; 3]; 3]; 6],
}

impl Tremor {
    fn new(seed: u64, size: f64) -> Self {
        let mut rng = Stream::new(seed, Purpose::Path, 0);
        let mut waves = [[[0.0; 3]; 3]; 6];
        for (axis, of_axis) in waves.iter_mut().enumerate() {
            let amplitude = size * if axis < 3 { 0.002 } else { 0.0026 };
            for (share, [low, high], w) in [
                (1.5, [0.3, 0.5], 0),
                (0.5, [1.2, 1.9], 1),
                (0.15, [3.5, 5.5], 2),
            ] {
                of_axis[w] = [
                    amplitude * share,
                    rng.range(low, high),
                    rng.range(0.0, std::f64::consts::TAU),
                ];
            }
        }
        Self { waves }
    }

    fn at(&self, t: f64) -> Se3 {
        let sum = |axis: usize| {
            self.waves[axis]
                .iter()
                .map(|[a, f, p]| a * wave(t, *f, *p))
                .sum::<f64>()
        };
        Se3::new(
            so3::exp(&Vec3::new(sum(3), sum(4), sum(5))),
            Vec3::new(sum(0), sum(1), sum(2)),
        )
    }
}
