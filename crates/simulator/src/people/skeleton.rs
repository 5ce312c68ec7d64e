//! Bones and joints: from a posture to the pose of every rigid part.
//!
//! A body's axes: x forward, y to its left, z up; bones of limbs extend along -z from their joint.

use stillpoint_geometry::nalgebra::Matrix3;
use stillpoint_geometry::{Se3, Vec3, so3};

/// Lengths of an adult of 1.76 m, m; scaled by the person's size.
pub(crate) mod length {
    /// Hip to knee.
    pub(crate) const THIGH: f64 = 0.43;
    /// Knee to ankle.
    pub(crate) const SHANK: f64 = 0.42;
    /// Ankle to sole.
    pub(crate) const ANKLE: f64 = 0.085;
    /// Ankle back to the end of the heel.
    pub(crate) const HEEL: f64 = 0.075;
    /// Ankle forward to the tip of the toes.
    pub(crate) const TOE: f64 = 0.185;
    /// Middle to hip joint.
    pub(crate) const HIP: f64 = 0.09;
    /// Hips up to waist.
    pub(crate) const WAIST: f64 = 0.10;
    /// Middle to shoulder joint.
    pub(crate) const SHOULDER: f64 = 0.185;
    /// Waist up to the shoulder joints.
    pub(crate) const CHEST: f64 = 0.385;
    /// Waist up to the root of the neck.
    pub(crate) const NECK: f64 = 0.45;
    /// Shoulder to elbow.
    pub(crate) const UPPER_ARM: f64 = 0.29;
    /// Elbow to wrist.
    pub(crate) const FOREARM: f64 = 0.25;
}

/// Left and right, as factors of y.
pub(crate) const SIDES: [f64; 2] = [1.0, -1.0];

#[derive(Clone, Copy)]
pub(crate) enum Arm {
    /// Angles, rad: forward at the shoulder, away from the body, inward about the upper arm, and bent at the elbow.
    Angles([f64; 4]),
    /// The wrist's position in the world, m.
    Reach(Vec3),
}

/// The independent variables of a pose.
pub(crate) struct Posture {
    /// Midpoint between the hip joints, m, and heading, rad.
    pub(crate) hips: Vec3,
    pub(crate) yaw: f64,
    /// Rotation of the chest relative to the hips: to the side, forward, about the spine, rad.
    pub(crate) spine: [f64; 3],
    /// Rotation of the head relative to the chest, as `spine`.
    pub(crate) head: [f64; 3],
    /// Left and right.
    pub(crate) arms: [Arm; 2],
    /// Position of the ankles in the world, m, with the direction of the foot and its heel's lift, rad.
    pub(crate) feet: [(Vec3, f64, f64); 2],
    /// Size relative to 1.76 m.
    pub(crate) size: f64,
}

/// World poses of the rigid parts.
pub(crate) struct Skeleton {
    pub(crate) hips: Se3,
    pub(crate) chest: Se3,
    pub(crate) head: Se3,
    pub(crate) arms: [[Se3; 3]; 2],
    pub(crate) legs: [[Se3; 3]; 2],
}

fn turn(x: f64, y: f64, z: f64) -> Se3 {
    let about = |v: Vec3| Se3::new(so3::exp(&v), Vec3::zeros());
    about(Vec3::z() * z) * about(Vec3::x() * x) * about(Vec3::y() * y)
}

fn shift(x: f64, y: f64, z: f64) -> Se3 {
    Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(x, y, z))
}

impl Skeleton {
    pub(crate) fn new(p: &Posture) -> Self {
        let k = p.size;
        let [lean, bow, twist] = p.spine;
        let hips = Se3::new(so3::exp(&(Vec3::z() * p.yaw)), p.hips);
        let chest = hips * shift(0.0, 0.0, k * length::WAIST) * turn(lean, bow, twist);
        let [tilt, nod, look] = p.head;
        let head = chest * shift(0.0, 0.0, k * length::NECK) * turn(tilt, nod, look);
        let forward = hips.rotation * Vec3::x();
        Self {
            hips,
            chest,
            head,
            arms: [0, 1].map(|side| arm(p.arms[side], &chest, SIDES[side], k)),
            legs: [0, 1].map(|side| {
                let joint = hips.transform(&Vec3::new(0.0, SIDES[side] * k * length::HIP, 0.0));
                let (ankle, yaw, lift) = p.feet[side];
                let foot = Se3::new(so3::exp(&(Vec3::z() * yaw)), Vec3::zeros());
                // Knees point in the mean direction of feet and hips.
                let pole = forward + foot.rotation * Vec3::x();
                let reach = [length::THIGH * k, length::SHANK * k];
                let [thigh, shank] = two_bones(&joint, &ankle, &pole, reach);
                let end = shank.transform(&Vec3::new(0.0, 0.0, -reach[1]));
                [
                    thigh,
                    shank,
                    Se3::new(foot.rotation * so3::exp(&(Vec3::y() * lift)), end),
                ]
            }),
        }
    }
}

fn arm(arm: Arm, chest: &Se3, side: f64, k: f64) -> [Se3; 3] {
    let shoulder = *chest * shift(0.0, side * k * length::SHOULDER, k * length::CHEST);
    let [upper, fore] = match arm {
        Arm::Angles([forward, away, inward, bend]) => {
            let upper =
                shoulder * turn(side * away, -forward, 0.0) * turn(0.0, 0.0, -side * inward);
            let fore = upper * shift(0.0, 0.0, -k * length::UPPER_ARM) * turn(0.0, -bend, 0.0);
            [upper, fore]
        }
        Arm::Reach(wrist) => {
            // Elbows point down, outward and a little back; `two_bones` bends towards its pole.
            let pole = chest.rotation * Vec3::new(-0.4, side * 0.7, -1.0);
            let reach = [length::UPPER_ARM * k, length::FOREARM * k];
            two_bones(&shoulder.translation, &wrist, &pole, reach)
        }
    };
    [
        upper,
        fore,
        fore * shift(0.0, 0.0, -k * length::FOREARM) * turn(0.0, -0.15, 0.0),
    ]
}

/// Two bones of given lengths from `joint` to `end`, bent towards `pole`; straight towards an end out of reach.
fn two_bones(joint: &Vec3, end: &Vec3, pole: &Vec3, [first, second]: [f64; 2]) -> [Se3; 2] {
    let to = end - joint;
    let far = to.norm().clamp(
        (first - second).abs() + 1e-3,
        (first + second) * (1.0 - 1e-6),
    );
    let along = to.normalize();
    let out = (pole - along * pole.dot(&along)).normalize();
    let cosine =
        ((first * first + far * far - second * second) / (2.0 * first * far)).clamp(-1.0, 1.0);
    let sine = (1.0 - cosine * cosine).sqrt();
    let middle = joint + (along * cosine + out * sine) * first;
    let goal = joint + along * far;
    [bone(joint, &middle, &out), bone(&middle, &goal, &out)]
}

/// The frame at `from` whose -z points to `to` and whose x is closest to `front`.
fn bone(from: &Vec3, to: &Vec3, front: &Vec3) -> Se3 {
    let z = (from - to).normalize();
    let y = z.cross(front).normalize();
    let x = y.cross(&z);
    Se3::from_matrix(&Matrix3::from_columns(&[x, y, z]), *from)
}
