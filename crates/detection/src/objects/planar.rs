//! Filter of an object without depth: its box and the changes of the box.
//!
//! State: centre (undistorted px), logarithms of width and height (px), and the rates of the four. The centre refers to
//! the camera at the state's time; for another camera it is rotated, since depth is unknown.

use super::kalman::{Drive, Gaussian, Mat8, Row, Vec8};
use super::measurement::Measurement;
use super::view::{NEAREST, Sides, View};
use stillpoint_geometry::{Mat3, Vec2};

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Planar {
    pub(super) state: Gaussian,
    /// Rotation of `world_from_camera` of the centre's camera.
    rotation: Mat3,
}

impl Planar {
    pub(super) fn new(view: &View, m: &Measurement, share: f64) -> Self {
        let [w, h] = m.size();
        let mut mean = Vec8::zeros();
        mean[0] = (m.sides[0] + m.sides[2]) / 2.0;
        mean[1] = (m.sides[1] + m.sides[3]) / 2.0;
        mean[2] = libm::log(w);
        mean[3] = libm::log(h);
        let extent = w.max(h);
        let spread = Vec8::from_column_slice(&[
            extent * extent,
            extent * extent,
            1.0,
            1.0,
            extent * extent,
            extent * extent,
            0.25,
            0.25,
        ]);
        let covariance = Mat8::from_diagonal(&spread);
        let mut filter = Self {
            state: Gaussian { mean, covariance },
            rotation: view.rotation.transpose(),
        };
        if let Some((sides, jacobians)) = filter.project(view) {
            filter.state.update(&m.side_rows(&sides, &jacobians, share));
        }
        filter
    }

    /// Predicts the state `dt` seconds later, in the old camera.
    pub(super) fn propagate(&mut self, dt: f64, acceleration: f64) {
        let extent = libm::exp(self.state.mean[2].max(self.state.mean[3]));
        // For an object a metre high.
        let pixels = acceleration * extent;
        let drive = |value, density| Drive {
            value,
            rate: Some(value + 4),
            density,
            decay: 0.0,
        };
        let drives = [
            drive(0, pixels * pixels),
            drive(1, pixels * pixels),
            drive(2, acceleration * acceleration / 4.0),
            drive(3, acceleration * acceleration / 4.0),
        ];
        self.state.propagate(dt, &drives);
    }

    fn centre(&self, view: &View) -> Option<Vec2> {
        let ray = view
            .camera
            .ray(Vec2::new(self.state.mean[0], self.state.mean[1]));
        let turned = view.rotation * (self.rotation * ray);
        (turned.z > NEAREST).then(|| view.camera.project(&turned))
    }

    /// Transforms the state to this camera. Small rolls are covered by the noise.
    pub(super) fn rebase(&mut self, view: &View) {
        if let Some(centre) = self.centre(view) {
            self.state.mean[0] = centre.x;
            self.state.mean[1] = centre.y;
            self.rotation = view.rotation.transpose();
        }
    }

    /// The sides in this camera, with their derivatives by the rebased state; `None` behind the camera.
    pub(super) fn project(&self, view: &View) -> Option<(Sides, [Vec8; 4])> {
        let centre = self.centre(view)?;
        // Avoids infinity when the size diverges.
        let [w, h] = [2, 3].map(|i| libm::exp(self.state.mean[i].min(20.0)));
        let row = |axis: usize, half: f64| {
            let mut row = Vec8::zeros();
            row[axis] = 1.0;
            row[axis + 2] = half;
            row
        };
        let sides = [
            centre.x - w / 2.0,
            centre.y - h / 2.0,
            centre.x + w / 2.0,
            centre.y + h / 2.0,
        ];
        let jacobians = [
            row(0, -w / 2.0),
            row(1, -h / 2.0),
            row(0, w / 2.0),
            row(1, h / 2.0),
        ];
        Some((sides, jacobians))
    }

    pub(super) fn rows(&self, view: &View, m: &Measurement, share: f64) -> Vec<Row> {
        self.project(view)
            .map(|(sides, jacobians)| m.side_rows(&sides, &jacobians, share))
            .unwrap_or_default()
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoundingBox, ClassId, Detection};
    use stillpoint_geometry::{Camera, Se3, Vec3, so3};
    use stillpoint_imaging::CoarseDepth;

    const CAMERA: Camera = Camera {
        width: 640,
        height: 480,
        fx: 500.0,
        fy: 500.0,
        cx: 320.0,
        cy: 240.0,
        distortion: stillpoint_geometry::BrownConrady {
            k1: 0.0,
            k2: 0.0,
            p1: 0.0,
            p2: 0.0,
            k3: 0.0,
        },
    };

    fn view(yaw: f64) -> View<'static> {
        let pose = Se3::new(so3::exp(&(Vec3::y() * yaw)), Vec3::zeros());
        View::new(&CAMERA, CAMERA.undistorted_bounds(), &pose, &Vec3::y())
    }

    fn measured(view: &View, bounds: BoundingBox) -> Measurement {
        let detection = Detection {
            class: ClassId::PERSON,
            score: 0.5,
            bounds,
        };
        Measurement::new(view, &detection, &CoarseDepth::default()).unwrap()
    }

    const BOX: BoundingBox = BoundingBox {
        x0: 100.0,
        y0: 120.0,
        x1: 180.0,
        y1: 320.0,
    };

    #[test]
    fn planar_jacobians_match_differences() {
        let start = view(0.0);
        let f = Planar::new(&start, &measured(&start, BOX), 0.06);
        let (_, jacobians) = f.project(&start).unwrap();
        for i in 0..8 {
            let shifted = |step: f64| {
                let mut f = f.clone();
                f.state.mean[i] += step;
                f.project(&start).unwrap().0
            };
            let (plus, minus) = (shifted(1e-6), shifted(-1e-6));
            for (k, jacobian) in jacobians.iter().enumerate() {
                let numeric = (plus[k] - minus[k]) / 2e-6;
                assert!((numeric - jacobian[i]).abs() < 1e-4, "{k} {i}");
            }
        }
    }

    #[test]
    fn planar_filter_follows_a_moving_growing_box() {
        let v = view(0.0);
        let at = |t: f64| BoundingBox {
            x0: 100.0 + 100.0 * t,
            y0: 120.0 - 20.0 * t,
            x1: 180.0 + 140.0 * t,
            y1: 320.0 + 20.0 * t,
        };
        let mut f = Planar::new(&v, &measured(&v, at(0.0)), 0.02);
        for i in 1..=30 {
            f.propagate(1.0 / 30.0, 1.0);
            let rows = f.rows(&v, &measured(&v, at(f64::from(i) / 30.0)), 0.02);
            f.state.update(&rows);
        }
        f.propagate(0.5, 1.0);
        let found = v.raw(&f.project(&v).unwrap().0);
        assert!(found.iou(&at(1.5)) > 0.85, "{found:?} {:?}", at(1.5));
    }

    #[test]
    fn planar_state_rotates_with_the_camera() {
        let start = view(0.0);
        let mut f = Planar::new(&start, &measured(&start, BOX), 0.06);
        let ray = CAMERA.ray(stillpoint_geometry::Vec2::new(140.0, 220.0));
        let turned = view(-0.2);
        let expected = CAMERA.project(&(turned.rotation * ray));
        assert!((expected.x - 140.0).abs() > 80.0);
        for _ in 0..2 {
            let (sides, _) = f.project(&turned).unwrap();
            assert!(((sides[0] + sides[2]) / 2.0 - expected.x).abs() < 1e-9);
            assert!(((sides[1] + sides[3]) / 2.0 - expected.y).abs() < 1e-9);
            f.rebase(&turned);
        }
        assert!(f.project(&view(3.0)).is_none());
    }
}
