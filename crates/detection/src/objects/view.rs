//! A camera at a pose, and boxes in its raw and undistorted image.

use crate::BoundingBox;
use stillpoint_geometry::{Camera, Mat3, Se3, Vec2, Vec3};

/// Sides of a box in undistorted pixels: left, top, right, bottom.
pub(super) type Sides = [f64; 4];

/// Minimum depth of projected points, m. Chosen: no depth sensor sees as near.
pub(super) const NEAREST: f64 = 0.1;

#[derive(Clone, Debug)]
pub(super) struct View<'a> {
    pub(super) camera: &'a Camera,
    pub(super) world_from_camera: Se3,
    /// Rotation of `camera_from_world`.
    pub(super) rotation: Mat3,
    /// Squares of cosine and sine of the angle between the image's y axis and the vertical in the image.
    pub(super) roll: [f64; 2],
    down: Vec3,
    /// Undistorted bounds of the raw image: see [`Camera::undistorted_bounds`].
    limits: [f64; 4],
}

impl<'a> View<'a> {
    /// `down` is the world's vertical, `limits` the camera's undistorted bounds.
    pub(super) fn new(
        camera: &'a Camera,
        limits: [f64; 4],
        world_from_camera: &Se3,
        down: &Vec3,
    ) -> Self {
        let rotation = world_from_camera.rotation_matrix().transpose();
        let seen = rotation * down;
        let flat = seen.x * seen.x + seen.y * seen.y;
        // Looking along the vertical, a camera sees it as a point: the angle is undefined, and things are as wide as
        // they are deep.
        let roll = if flat > 0.1 {
            [seen.y * seen.y / flat, seen.x * seen.x / flat]
        } else {
            [1.0, 0.0]
        };
        Self {
            camera,
            world_from_camera: *world_from_camera,
            rotation,
            roll,
            down: seen,
            limits,
        }
    }

    #[cfg(test)]
    pub(super) fn ahead(camera: &'a Camera) -> Self {
        let limits = camera.undistorted_bounds();
        Self::new(camera, limits, &Se3::default(), &Vec3::y())
    }

    pub(super) fn camera_point(&self, world: &Vec3) -> Vec3 {
        self.rotation * (world - self.world_from_camera.translation)
    }

    /// Shift to the right per pixel down of a vertical line at a raw pixel; 0 if it is more horizontal than vertical in
    /// the image.
    pub(super) fn lean(&self, raw: Vec2) -> f64 {
        let at = self.camera.undistort(raw);
        let (x, y) = (
            (at.x - self.camera.cx) / self.camera.fx,
            (at.y - self.camera.cy) / self.camera.fy,
        );
        // Towards the vanishing point of the vertical.
        let across = (self.down.x - self.down.z * x) * self.camera.fx;
        let along = (self.down.y - self.down.z * y) * self.camera.fy;
        if across.abs() <= along.abs() {
            across / along
        } else {
            0.0
        }
    }

    /// Undistorts a raw box by its sides' midpoints.
    pub(super) fn undistorted(&self, raw: &BoundingBox) -> Sides {
        let [u, v] = raw.centre();
        let point = |x, y| self.camera.undistort(Vec2::new(x, y));
        [
            point(raw.x0, v).x,
            point(u, raw.y0).y,
            point(raw.x1, v).x,
            point(u, raw.y1).y,
        ]
    }

    /// Share of a box inside the image, along the axis with less.
    pub(super) fn inside(&self, sides: &Sides) -> f64 {
        let share = |low: usize| {
            let (from, to) = (sides[low], sides[low + 2]);
            let seen = to.min(self.limits[low + 2]) - from.max(self.limits[low]);
            seen.max(0.0) / (to - from).max(1e-9)
        };
        share(0).min(share(1))
    }

    /// The inverse of [`Self::undistorted`], clipped to the image; empty when outside.
    pub(super) fn raw(&self, sides: &Sides) -> BoundingBox {
        let [left, top, right, bottom] = self.limits;
        // Distortion is valid within the image only: beyond, its polynomial may fold back.
        let x = [sides[0], sides[2]].map(|x| x.clamp(left - 1.0, right + 1.0));
        let y = [sides[1], sides[3]].map(|y| y.clamp(top - 1.0, bottom + 1.0));
        let (u, v) = ((x[0] + x[1]) / 2.0, (y[0] + y[1]) / 2.0);
        let point = |x, y| self.camera.distort(Vec2::new(x, y));
        BoundingBox {
            x0: point(x[0], v).x,
            y0: point(u, y[0]).y,
            x1: point(x[1], v).x,
            y1: point(u, y[1]).y,
        }
        .clipped(self.camera.width as usize, self.camera.height as usize)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::{BrownConrady, so3};

    fn fr1() -> Camera {
        Camera {
            distortion: BrownConrady {
                k1: 0.2624,
                k2: -0.9531,
                p1: -0.0054,
                p2: 0.0026,
                k3: 1.1633,
            },
            ..Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3])
        }
    }

    proptest! {
        /// Two points of a vertical line project with the computed slope.
        #[test]
        fn projected_vertical_lines_have_the_computed_slope(
            roll in -0.6..0.6_f64, pitch in -0.4..0.4_f64, x in -0.4..0.4_f64, y in -0.3..0.3_f64, z in 1.0..4.0_f64
        ) {
            let camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
            let rotation = so3::exp(&Vec3::new(pitch, 0.0, 0.0)) * so3::exp(&Vec3::new(0.0, 0.0, roll));
            let pose = Se3::new(rotation, Vec3::zeros());
            let view = View::new(&camera, camera.undistorted_bounds(), &pose, &Vec3::y());
            let top = pose.transform(&Vec3::new(x * z, y * z, z));
            let pixel = |world: &Vec3| camera.project(&view.camera_point(world));
            let (a, b) = (pixel(&top), pixel(&(top + Vec3::y() * 1e-4)));
            let lean = (b.x - a.x) / (b.y - a.y);
            prop_assert!((view.lean(a) - lean).abs() < 1e-3, "{} {lean}", view.lean(a));
        }
    }

    proptest! {
        #[test]
        fn raw_and_undistorted_are_inverse(
            x0 in 0.0..600.0_f64, y0 in 0.0..440.0_f64, w in 0.05..1.0_f64, h in 0.05..1.0_f64
        ) {
            let camera = fr1();
            let view = View::ahead(&camera);
            let raw = BoundingBox { x0, y0, x1: x0 + w * (639.0 - x0), y1: y0 + h * (479.0 - y0) };
            let back = view.raw(&view.undistorted(&raw));
            // The midpoint of a side moves slightly along it, which hardly affects the distortion.
            for (a, b) in [(raw.x0, back.x0), (raw.y0, back.y0), (raw.x1, back.x1), (raw.y1, back.y1)] {
                prop_assert!((a - b).abs() < 0.5, "{raw:?} {back:?}");
            }
        }
    }

    #[test]
    fn box_outside_the_image_has_no_area() {
        let camera = fr1();
        let view = View::ahead(&camera);
        for sides in [
            [-900.0, 100.0, -200.0, 300.0],
            [700.0, 100.0, 5000.0, 300.0],
            [100.0, 600.0, 200.0, 1e9],
        ] {
            assert_eq!(view.raw(&sides).area(), 0.0, "{sides:?}");
        }
        let all = view.raw(&[-1e9, -1e9, 1e9, 1e9]);
        assert!(all.area() > 0.97 * 640.0 * 480.0, "{all:?}");
    }

    #[test]
    fn roll_is_the_angle_to_the_vertical() {
        let camera = fr1();
        for angle in [-0.7, 0.0, 0.3, 1.2] {
            let pose = Se3::new(
                stillpoint_geometry::so3::exp(&(Vec3::z() * angle)),
                Vec3::zeros(),
            );
            let view = View::new(&camera, [0.0, 0.0, 1.0, 1.0], &pose, &Vec3::y());
            let c = libm::cos(angle);
            assert!(
                (view.roll[0] - c * c).abs() < 1e-12 && (view.roll[1] + c * c - 1.0).abs() < 1e-12
            );
        }
        let down = Se3::new(
            stillpoint_geometry::so3::exp(&(Vec3::x() * -1.5)),
            Vec3::zeros(),
        );
        assert_eq!(
            View::new(&camera, [0.0; 4], &down, &Vec3::y()).roll,
            [1.0, 0.0]
        );
    }
}
