//! Estimates the vertical from the cameras' orientations.

use stillpoint_geometry::nalgebra::SymmetricEigen;
use stillpoint_geometry::{Mat3, Se3, Vec3};

/// Standard deviation of a camera's roll, rad: hands hold it level, and so do robots.
const ROLL: f64 = 0.2;
/// Standard deviation of a camera's pitch, rad: at a desk, or at the floor before a robot.
const PITCH: f64 = 0.45;
/// Weight of the first camera's roll, a number of cameras: a run is begun with some care, and a slow roll afterwards is
/// real. Measured: with 1 real people have more ghosts.
const FIRST: f64 = 100.0;

/// Maximum-likelihood vertical: the direction most nearly perpendicular to the cameras' x axes and, with lower weight,
/// z axes. A single camera is taken as level; one that looks down and turns reveals the true vertical. As in panorama
/// straightening (Brown and Lowe, "Automatic Panoramic Image Stitching using Invariant Features", 2007, section 5).
#[derive(Clone, Debug, Default, PartialEq)]
pub(super) struct Vertical {
    information: Mat3,
    /// Sum of the cameras' y axes, for the sign.
    y: Vec3,
    down: Option<Vec3>,
}

impl Vertical {
    pub(super) fn observe(&mut self, world_from_camera: &Se3) -> Vec3 {
        let [x, y, z] = [Vec3::x(), Vec3::y(), Vec3::z()].map(|a| world_from_camera.rotation * a);
        let weight = if self.down.is_none() { FIRST } else { 1.0 };
        self.information +=
            x * x.transpose() * (weight / (ROLL * ROLL)) + z * z.transpose() / (PITCH * PITCH);
        self.y += y;
        let eigen = SymmetricEigen::new(self.information);
        let found: Vec3 = eigen.eigenvectors.column(eigen.eigenvalues.imin()).into();
        let down = if found.dot(&self.y) < 0.0 {
            -found
        } else {
            found
        };
        self.down = Some(down);
        down
    }

    /// The vertical, pointing down, once a camera was added.
    pub(super) fn down(&self) -> Option<Vec3> {
        self.down
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::so3;

    /// Angle between the estimate and the truth, the world's y axis, for cameras rotated by yaw, pitch, roll, rad.
    fn error(cameras: impl Iterator<Item = [f64; 3]>) -> f64 {
        let mut vertical = Vertical::default();
        let turn = |axis: Vec3, angle: f64| so3::exp(&(axis * angle));
        let cameras = cameras.map(|[yaw, pitch, roll]| {
            turn(Vec3::y(), yaw) * turn(Vec3::x(), pitch) * turn(Vec3::z(), roll)
        });
        for rotation in cameras {
            vertical.observe(&Se3::new(rotation, Vec3::zeros()));
        }
        libm::acos(vertical.down().unwrap().y.min(1.0))
    }

    #[test]
    fn single_pose_is_assumed_level() {
        let mut vertical = Vertical::default();
        let pose = Se3::new(so3::exp(&Vec3::new(0.3, 0.2, -0.1)), Vec3::x());
        assert!((vertical.observe(&pose) - pose.rotation * Vec3::y()).norm() < 1e-9);
    }

    #[test]
    fn turning_tilted_camera_reveals_the_vertical() {
        let turned = |degrees: f64| {
            let span = degrees.to_radians();
            error((0..100).map(|i| [span * (f64::from(i) / 99.0 - 0.5), -0.35, 0.0]))
        };
        assert!((turned(0.0) - 0.35).abs() < 1e-6);
        assert!(turned(120.0) < 0.15, "{}", turned(120.0));
        assert!(turned(360.0) < 0.01, "{}", turned(360.0));
    }

    #[test]
    fn alternating_rolls_cancel_out() {
        let swing = |i: i32, pace: f64| 0.5 * libm::sin(f64::from(i) * pace);
        let rolls = error((0..300).map(|i| [0.0, 0.0, swing(i, 0.2)]));
        let all = error((0..300).map(|i| [swing(i, 0.11), swing(i, 0.17), swing(i, 0.2)]));
        assert!(rolls < 0.02 && all < 0.05, "{rolls} {all}");
    }
}
