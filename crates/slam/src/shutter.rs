//! Rolling-shutter model: rows are exposed one after the other while the camera moves.
//!
//! First order: within a readout the camera moves by millimetres and fractions of a degree.

use crate::timing::Timing;
use stillpoint_geometry::{Camera, Vec2, Vec3, Vec6};

/// Depth assumed where features have none, or to compare rotations with translations, m. Chosen: that of things in a
/// room (docs/constants.md).
pub(crate) const TYPICAL_DEPTH: f64 = 2.0;

#[derive(Clone, Copy, Debug)]
pub(crate) struct Shutter<'a> {
    camera: &'a Camera,
    readout: f64,
    /// Root mean square of the possible readout times, s.
    reach: f64,
}

impl<'a> Shutter<'a> {
    pub(crate) fn new(camera: &'a Camera, timing: &Timing) -> Self {
        Self {
            camera,
            readout: timing.readout,
            reach: libm::hypot(timing.readout, timing.readout_sigma),
        }
    }

    /// Whether the readout time is nonzero.
    pub(crate) fn rolls(&self) -> bool {
        self.readout != 0.0
    }

    /// Standard deviation of a pixel's displacement, px, when the angular velocity is uncertain by `unsteady` rad/s.
    pub(crate) fn sigma_px(&self, raw_y: f64, unsteady: f64) -> f64 {
        (Self::row_share(self.camera, raw_y) * unsteady).abs() * self.reach * self.camera.fx
    }

    /// Exposure time of a raw pixel's row relative to the stamp, as a share of the readout time (-0.5 to 0.5).
    pub(crate) fn row_share(camera: &Camera, raw_y: f64) -> f64 {
        raw_y / f64::from(camera.height) - 0.5
    }

    /// Position at the stamp (camera coordinates, m) of a point observed at an undistorted pixel with depth `z` (m), in
    /// the row of its raw pixel. Uncorrected if it would lie behind the camera.
    pub(crate) fn at_stamp(
        &self,
        undistorted: Vec2,
        raw_y: f64,
        z: f64,
        velocity: Option<&Vec6>,
    ) -> Vec3 {
        let seen = self.camera.backproject(undistorted, z);
        let Some(v) = velocity.filter(|_| self.readout != 0.0) else {
            return seen;
        };
        let there = seen - point_velocity(v, &seen) * self.late(raw_y);
        if there.z > 0.0 { there } else { seen }
    }

    /// Depth (m) at the exposure of a raw row, of a point that is `there` at the stamp.
    pub(crate) fn depth_exposed(&self, there: &Vec3, raw_y: f64, velocity: &Vec6) -> f64 {
        there.z + point_velocity(velocity, there).z * self.late(raw_y)
    }

    /// Raw pixel at which a point `p` (m, in camera coordinates at the stamp) is exposed.
    pub(crate) fn exposed(&self, p: &Vec3, velocity: Option<&Vec6>) -> Vec2 {
        let raw = self.camera.project_distorted(p);
        let Some(v) = velocity.filter(|_| self.readout != 0.0) else {
            return raw;
        };
        let there = p + point_velocity(v, p) * self.late(raw.y);
        if there.z > 0.0 {
            self.camera.project_distorted(&there)
        } else {
            raw
        }
    }

    /// Approximate largest displacement of pixels in the first and last row by a change of velocity, px.
    pub(crate) fn reach_px(&self, change: &Vec6) -> f64 {
        let shift: Vec3 = change.fixed_rows::<3>(0).into();
        let turn: Vec3 = change.fixed_rows::<3>(3).into();
        let moved = shift.norm() / TYPICAL_DEPTH + turn.norm();
        0.5 * self.readout * moved * self.camera.fx
    }

    fn late(&self, raw_y: f64) -> f64 {
        Self::row_share(self.camera, raw_y) * self.readout
    }
}

/// Velocity (m/s, camera coordinates) of a static point while the camera moves by the twist `v` per second.
pub(crate) fn point_velocity(v: &Vec6, p: &Vec3) -> Vec3 {
    let phi: Vec3 = v.fixed_rows::<3>(3).into();
    v.fixed_rows::<3>(0) + phi.cross(p)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::BrownConrady;

    fn camera() -> Camera {
        Camera {
            distortion: BrownConrady {
                k1: 0.2,
                k2: -0.4,
                ..BrownConrady::default()
            },
            ..Camera::pinhole(640, 480, [520.0, 520.0, 319.5, 239.5])
        }
    }

    const TIMING: Timing = Timing {
        readout: 0.02,
        readout_sigma: 0.0,
        depth_delay: 0.0,
    };

    fn velocity() -> Vec6 {
        Vec6::new(0.1, -0.2, 0.1, 0.4, 1.5, -0.6)
    }

    #[test]
    fn exposure_correction_round_trips() {
        let camera = camera();
        let (shutter, v) = (Shutter::new(&camera, &TIMING), velocity());
        for p in [[0.3, 0.4, 1.2], [-0.6, -0.5, 2.0], [0.1, 0.0, 4.0]] {
            let p = Vec3::from(p);
            let raw = shutter.exposed(&p, Some(&v));
            let back = shutter.at_stamp(camera.undistort(raw), raw.y, p.z, Some(&v));
            let error = (camera.project(&back) - camera.project(&p)).norm();
            // First-order accuracy: uncorrected pixels are up to 7 px off.
            assert!(error < 0.5, "{error}");
        }
    }

    #[test]
    fn row_depth_is_the_stamp_depth_moved_by_velocity() {
        let camera = camera();
        let (shutter, v) = (Shutter::new(&camera, &TIMING), velocity());
        for (pixel, raw_y, z) in [([500.0, 40.0], 40.0, 1.5), ([90.0, 430.0], 430.0, 3.0)] {
            let there = shutter.at_stamp(Vec2::from(pixel), raw_y, z, Some(&v));
            assert!((there.z - z).abs() > 2e-3);
            assert!((shutter.depth_exposed(&there, raw_y, &v) - z).abs() < 1e-3);
        }
    }

    #[test]
    fn middle_row_and_global_shutter_need_no_correction() {
        let camera = Camera::pinhole(640, 480, [520.0, 520.0, 319.5, 239.5]);
        let (rolling, v) = (Shutter::new(&camera, &TIMING), velocity());
        let global = Shutter::new(&camera, &Timing::default());
        let pixel = Vec2::new(500.0, 240.0);
        let seen = camera.backproject(pixel, 2.0);
        assert!((rolling.at_stamp(pixel, 240.0, 2.0, Some(&v)) - seen).norm() < 1e-12);
        assert!((rolling.at_stamp(pixel, 480.0, 2.0, Some(&v)) - seen).norm() > 0.01);
        assert!((rolling.at_stamp(pixel, 480.0, 2.0, None) - seen).norm() < 1e-12);
        assert!((global.at_stamp(pixel, 480.0, 2.0, Some(&v)) - seen).norm() < 1e-12);
        assert_eq!(global.exposed(&seen, Some(&v)), global.exposed(&seen, None));
    }

    #[test]
    fn pixel_sigma_includes_the_readout_uncertainty() {
        let camera = camera();
        let known = Shutter::new(&camera, &TIMING);
        let nothing = Timing {
            readout_sigma: 0.02,
            ..Timing::default()
        };
        let unknown = Shutter::new(&camera, &nothing);
        // 0.02 s at 1 rad/s, of which the last row gets half.
        for shutter in [known, unknown] {
            assert!((shutter.sigma_px(480.0, 1.0) - 5.2).abs() < 1e-9);
            assert!(shutter.sigma_px(240.0, 1.0).abs() < 1e-9);
        }
        assert!((known.reach_px(&Vec6::new(0.0, 0.0, 0.0, 0.0, 1.0, 0.0)) - 5.2).abs() < 1e-9);
    }
}
