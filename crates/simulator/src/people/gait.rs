//! From actions to posture: steps, swinging arms, sitting, gestures.

use super::route::{Doing, Route};
use super::skeleton::{Arm, Posture, SIDES, length};
use stillpoint_geometry::{Se3, Vec3, so3};

pub(crate) struct Gait {
    pub(crate) route: Route,
    /// Size relative to 1.76 m.
    pub(crate) size: f64,
    /// Time of a left step, s, and phase of the gestures, rad.
    pub(crate) phase: f64,
    /// The load, held before the waist with both hands.
    pub(crate) load: Option<Load>,
}

#[derive(Clone, Copy)]
pub(crate) struct Load {
    pub(crate) class: &'static str,
    /// Half sides: to the front, to the left, up, m.
    pub(crate) half: [f64; 3],
    /// Amplitude of its motion about the holding position, m.
    pub(crate) wander: f64,
    /// Its initial place; `None` if it is carried from the start.
    pub(crate) stands: Option<Standing>,
}

/// Initial place of a load before it is lifted.
#[derive(Clone, Copy)]
pub(crate) struct Standing {
    pub(crate) at: [f64; 3],
    /// The direction of its front, rad.
    pub(crate) yaw: f64,
    /// Start of lifting, s.
    pub(crate) until: f64,
}

/// Duration of lifting, s.
const LIFT: f64 = 0.8;

/// Time from one step to the next, s.
const STEP: f64 = 0.55;
/// Time that a foot is in the air, s.
const SWING: f64 = 0.44;
/// Time that a foot stays on the floor, s.
const STANCE: f64 = 2.0 * STEP - SWING;
/// Lateral distance of the feet from the centre, m.
const TRACK: f64 = 0.095;
/// Height of the hip joints of a seated person, m.
const SEAT: f64 = 0.595;
/// Distance of the hips behind the feet's centre when sitting, m.
pub(crate) const SIT_BACK: f64 = 0.34;

fn smooth(x: f64) -> f64 {
    let x = x.clamp(0.0, 1.0);
    x * x * x * (x * (6.0 * x - 15.0) + 10.0)
}

fn wave(t: f64, hertz: f64, phase: f64) -> f64 {
    libm::sin(std::f64::consts::TAU * hertz * t + phase)
}

/// A foot flat on the floor: the point below its ankle, and its direction.
#[derive(Clone, Copy)]
struct Print {
    at: Vec3,
    yaw: f64,
}

impl Gait {
    /// The print of a foot that lands at `landing`: half way through its stance the body is above it.
    fn print(&self, side: usize, landing: f64) -> Print {
        let d = self.route.at(landing + 0.5 * STANCE);
        let aside = SIDES[side] * TRACK * self.size;
        let (c, s) = (libm::cos(d.yaw), libm::sin(d.yaw));
        Print {
            at: Vec3::new(d.x - s * aside, d.y + c * aside, 0.0),
            yaw: d.yaw + SIDES[side] * 0.1,
        }
    }

    /// Position of an ankle, direction of its foot and lift of its heel (rad; negative lifts the toes).
    fn foot(&self, side: usize, t: f64) -> (Vec3, f64, f64) {
        let cycle = 2.0 * STEP;
        let offset = self.phase + side as f64 * STEP;
        let landing = offset + cycle * libm::floor((t - offset) / cycle);
        let since = t - landing;
        let (here, next) = (self.print(side, landing), self.print(side, landing + cycle));
        let big = |a: &Print, b: &Print| smooth((b.at - a.at).norm() / 0.8);
        let leave = big(&here, &next);
        let arrive = big(&self.print(side, landing - cycle), &here);
        let w = ((since - STANCE) / SWING).max(0.0);
        let share = smooth(w);
        let yaw = here.yaw + (next.yaw - here.yaw) * share;
        let at = here.at + (next.at - here.at) * share;
        let (rise, strike) = (0.45, 0.28);
        let heel = if w > 0.0 {
            leave * (rise * (1.0 - smooth(w / 0.7)) - strike * smooth((w - 0.5) / 0.5))
        } else {
            leave * rise * smooth((since / STANCE - 0.55) / 0.45)
                - arrive * strike * (1.0 - smooth(since / (0.2 * STANCE)))
        };
        let moved = (next.at - here.at).norm() + 0.1 * (next.yaw - here.yaw).abs();
        let height = 0.06 * smooth(moved / 0.4) * 16.0 * w * w * (1.0 - w) * (1.0 - w);
        // On the floor a foot rotates about its heel first and its toes later; in the air the pivot moves back.
        let on_toes = if since < 0.4 * STANCE {
            0.0
        } else {
            1.0 - smooth((w - 0.2) / 0.6)
        };
        let pivot = self.size * (length::TOE * on_toes - length::HEEL * (1.0 - on_toes));
        let foot = Se3::new(
            so3::exp(&(Vec3::z() * yaw)),
            at + Vec3::z() * height.max(0.0),
        );
        let lever = Vec3::new(-pivot, 0.0, self.size * length::ANKLE);
        let ankle = Vec3::new(pivot, 0.0, 0.0) + so3::exp(&(Vec3::y() * heel)) * lever;
        (foot.transform(&ankle), yaw, heel)
    }

    /// The posture at a time, s.
    pub(crate) fn posture(&self, t: f64) -> Posture {
        let doing = self.route.at(t);
        let speed = self.route.speed(t);
        let walking = speed * speed / (speed * speed + 0.16);
        let beat = std::f64::consts::PI * (t - self.phase) / STEP;
        let feet = [0, 1].map(|side| self.foot(side, t));
        let (c, s) = (libm::cos(doing.yaw), libm::sin(doing.yaw));
        let ahead = -SIT_BACK * doing.sitting;
        // The body sways over the standing foot.
        let aside = 0.018 * walking * libm::sin(beat);
        let mut hips = Vec3::new(
            doing.x + c * ahead - s * aside,
            doing.y + s * ahead + c * aside,
            0.0,
        );
        hips.z = self.hip_height(&hips, &doing, &feet.map(|f| f.0));
        // Half way up or down a person leans forward for balance.
        let rising = doing.sitting * (1.0 - doing.sitting);
        let breath = 0.012 * wave(t, 0.27, self.phase);
        let nod = 0.07 * doing.talking * wave(t, 0.43, 2.0 * self.phase);
        let look = (0.3 * wave(t, 0.13, 3.0 * self.phase) + 0.25 * wave(t, 0.31, self.phase))
            * (0.5 + 0.5 * doing.talking);
        Posture {
            hips,
            yaw: doing.yaw + 0.06 * walking * libm::cos(beat),
            spine: [
                0.03 * doing.talking * wave(t, 0.21, self.phase),
                0.05 * walking + 2.6 * rising + breath + 0.05 * doing.talking * wave(t, 0.17, 1.0),
                -0.16 * walking * libm::cos(beat) + 0.1 * doing.talking * wave(t, 0.19, self.phase),
            ],
            head: [
                0.05 * wave(t, 0.23, self.phase),
                0.05 + nod - 1.2 * rising,
                look,
            ],
            arms: self.arms(t, &doing, walking * libm::cos(beat), &hips),
            feet,
            size: self.size,
        }
    }

    /// Height of the hip joints: nearly straight legs within their length, or the seat's.
    fn hip_height(&self, hips: &Vec3, doing: &Doing, ankles: &[Vec3; 2]) -> f64 {
        let k = self.size;
        let most = k * (length::THIGH + length::SHANK) * 0.996;
        let mut high = k * (length::THIGH + length::SHANK + length::ANKLE) - 0.01;
        let (c, s) = (libm::cos(doing.yaw), libm::sin(doing.yaw));
        for (side, ankle) in ankles.iter().enumerate() {
            let aside = SIDES[side] * k * length::HIP;
            let (dx, dy) = (hips.x - s * aside - ankle.x, hips.y + c * aside - ankle.y);
            let up = (most * most - dx * dx - dy * dy).max(0.09).sqrt();
            high = smooth_min(high, ankle.z + up, 0.03);
        }
        high + (SEAT - high).min(0.0) * smooth(doing.sitting)
    }

    fn arms(&self, t: f64, doing: &Doing, swing: f64, hips: &Vec3) -> [Arm; 2] {
        if let Some(load) = &self.load {
            let place = self.load_at(t, doing, hips);
            return SIDES.map(|side| {
                let grip = Vec3::new(-0.3 * load.half[0], side * (load.half[1] + 0.02), -0.02);
                let wrist = place.transform(&(grip - Vec3::new(0.13, 0.0, 0.0)));
                Arm::Reach(wrist)
            });
        }
        let (talk, sit) = (doing.talking, smooth(doing.sitting));
        [0, 1].map(|side| {
            let sign = SIDES[side];
            let phase = self.phase + 1.7 * side as f64;
            let rest = 0.05 * wave(t, 0.29, phase);
            let point = 0.5 + 0.5 * wave(t, 0.19 + 0.04 * side as f64, 2.0 * phase);
            let lift = talk * (0.3 + 0.5 * point + 0.12 * wave(t, 0.83, phase));
            Arm::Angles([
                -0.5 * sign * swing + 0.04 + rest + 0.75 * lift + 0.12 * sit,
                0.13 + 0.16 * talk + 0.08 * talk * wave(t, 0.47, phase),
                0.1 + talk * (0.15 + 0.2 * wave(t, 0.37, phase)) + 0.1 * sit,
                0.28 + 0.25 * (sign * -swing).max(0.0) * (sign * -swing).max(0.0)
                    + 1.0 * lift
                    + 0.75 * sit,
            ])
        })
    }

    /// Pose of a load in the hands.
    fn load_at(&self, t: f64, doing: &Doing, hips: &Vec3) -> Se3 {
        let load = self.load.unwrap_or(Load {
            class: "box",
            half: [0.0; 3],
            wander: 0.0,
            stands: None,
        });
        let wander = Vec3::new(
            0.3 * wave(t, 0.37, 0.0) - 0.3,
            wave(t, 0.29, 1.0),
            0.8 * wave(t, 0.41, 2.0),
        ) * load.wander;
        let yaw = so3::exp(&(Vec3::z() * doing.yaw));
        let ahead = Vec3::new(0.2 + load.half[0] + load.wander, 0.0, self.size * 0.22);
        let tilt = Vec3::new(
            0.5 * wave(t, 0.23, 0.0),
            0.5 * wave(t, 0.31, 0.5),
            0.8 * wave(t, 0.19, 1.0),
        ) * load.wander;
        Se3::new(yaw * so3::exp(&tilt), hips + yaw * (ahead + wander))
    }

    /// Pose of the load at a time, if there is one.
    pub(crate) fn load_pose(&self, t: f64) -> Option<Se3> {
        let load = self.load?;
        let held = self.load_at(t, &self.route.at(t), &self.posture(t).hips);
        let Some(standing) = load.stands else {
            return Some(held);
        };
        let turn = so3::exp(&(Vec3::z() * standing.yaw));
        let stood = Se3::new(turn, Vec3::from(standing.at));
        let share = smooth((t - standing.until) / LIFT);
        // Interpolation would round even before lifting.
        Some(if share > 0.0 {
            stood.interpolate(&held, share)
        } else {
            stood
        })
    }
}

/// A smooth minimum, below the smaller number where they differ by less than `k`.
fn smooth_min(a: f64, b: f64, k: f64) -> f64 {
    let h = (k - (a - b).abs()).max(0.0) / k;
    a.min(b) - 0.25 * h * h * k
}
