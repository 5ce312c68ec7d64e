//! Filter of an object with depth: position and velocity in the world, and size.
//!
//! State: position (m), velocity (m/s), logarithms of width and height (m). The position is the middle of the visible
//! surface. The object is an ellipse that faces the camera, its long axis along the world's vertical: a rolling camera
//! widens its box without widening the object.

use super::depth::DepthMode;
use super::fit::CHI2_99;
use super::kalman::{Drive, Gaussian, Mat8, Row, Vec8};
use super::measurement::Measurement;
use super::view::{NEAREST, Sides, View};
use stillpoint_geometry::{Mat6, Vec2, Vec3};

#[derive(Clone, Debug)]
pub(super) struct Projection {
    pub(super) sides: Sides,
    pub(super) jacobians: [Vec8; 4],
    /// Depth, m.
    pub(super) z: f64,
    /// Derivative of the depth by the state.
    pub(super) z_jacobian: Vec8,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Spatial {
    pub(super) state: Gaussian,
}

/// Standard deviation of the initial velocity, m/s: adults walk at 1.3 to 1.5 m/s (Bohannon, "Comfortable and maximum
/// walking speed", Age and Ageing 1997), either way, or stand.
pub(super) const WALK: f64 = 1.0;
/// Standard deviation of the vertical speed, m/s: people and things indoors move over the floor. Measured: with 1 m/s
/// IDF1 and MOTA of simulated people are 0.01 less.
const VERTICAL_SPEED: f64 = 0.3;
/// Maximum speed of a detected object indoors, m/s: a run. A higher velocity comes from another surface; it is reduced
/// to this with all correlated states (Simon, "Kalman filtering with state constraints", 2010).
pub(super) const FASTEST: f64 = 2.4;
/// Standard deviation of the zero-velocity measurement of a thing whose velocity is insignificant, m/s.
const REST_SPEED: f64 = 0.1;
/// Share of the velocity that is lost per second: with white noise of acceleration of 1 m/s^2 the spread of speeds,
/// sqrt(1/(2*0.5)), stays at 1 m/s, and most of a velocity outlasts a second without detections.
const DECAY: f64 = 0.5;
/// Change of the logarithm of a size per second, standard deviation: arms that stretch, a person who sits down.
/// Measured: 0.4 has more ghosts of simulated people.
const RESHAPE: f64 = 0.3;
/// Linearisations per update, a number (iterated filter: Bar-Shalom, Li, Kirubarajan 2001, section 10.5.2).
const ROUNDS: usize = 3;
/// Range of logarithms of sizes in m, of 2 cm and 20 m, chosen: detected objects are neither smaller nor larger.
const LOG_SIZES: [f64; 2] = [-3.9, 3.0];
impl Spatial {
    /// From one detection and the surface taken as the object. The prior is wide, for sides that are not measured.
    pub(super) fn new(
        view: &View,
        m: &Measurement,
        mode: &DepthMode,
        share: f64,
        liveliness: f64,
    ) -> Self {
        let z = mode.depth.max(NEAREST);
        let centre = Vec2::new(
            (m.sides[0] + m.sides[2]) / 2.0,
            (m.sides[1] + m.sides[3]) / 2.0,
        );
        let point = view.camera.backproject(centre, z);
        let position = view.world_from_camera.transform(&point);
        let [w, h] = m.size();
        let size = upright([w * z / view.camera.fx, h * z / view.camera.fy], view.roll);
        let mut mean = Vec8::zeros();
        mean.fixed_rows_mut::<3>(0).copy_from(&position);
        let speed = WALK * WALK * liveliness * liveliness;
        let mut spread = Vec8::repeat(speed);
        for i in 0..3 {
            spread[i] = z * z / 4.0;
        }
        for i in 0..2 {
            mean[6 + i] = libm::log(size[i].max(0.01));
            spread[6 + i] = 1.0;
        }
        let covariance = Mat8::from_diagonal(&spread);
        let mut filter = Self {
            state: Gaussian { mean, covariance },
        };
        if let Some(p) = filter.project(view) {
            let mut rows = m.side_rows(&p.sides, &p.jacobians, share);
            rows.push(filter.depth_row(&p, mode));
            filter.state.update(&rows);
        }
        filter
    }

    /// Predicts the state `dt` seconds later, for objects that accelerate by `acceleration` m/s^2. The velocity decays
    /// to zero in some seconds, so that its spread stays that of walking people.
    pub(super) fn propagate(&mut self, dt: f64, acceleration: f64) {
        let moving = |i| Drive {
            value: i,
            rate: Some(i + 3),
            density: acceleration * acceleration,
            decay: DECAY,
        };
        let walking = |i| Drive {
            value: i,
            rate: None,
            density: RESHAPE * RESHAPE,
            decay: 0.0,
        };
        let drives = [moving(0), moving(1), moving(2), walking(6), walking(7)];
        self.state.propagate(dt, &drives);
    }

    /// Applies measurements; `rows` linearises them for a filter with another mean.
    pub(super) fn update(&mut self, rows: impl Fn(&Self) -> Vec<Row>) {
        let covariance = self.state.covariance;
        self.state.update_iterated(ROUNDS, |mean| {
            rows(&Self {
                state: Gaussian {
                    mean: *mean,
                    covariance,
                },
            })
        });
        for i in 6..8 {
            self.state.mean[i] = self.state.mean[i].clamp(LOG_SIZES[0], LOG_SIZES[1]);
        }
    }

    /// Applies a zero-velocity measurement of [`REST_SPEED`] if the velocity is insignificant or `certain` is set, and
    /// one of the vertical speed.
    pub(super) fn settle(&mut self, down: &Vec3, may_rest: bool, certain: bool) {
        let mut rows = vec![self.speed_row(down, VERTICAL_SPEED)];
        let velocity = self.velocity();
        let covariance = self.state.covariance.fixed_view::<3, 3>(3, 3).into_owned();
        let still = covariance
            .try_inverse()
            .is_some_and(|inverse| velocity.dot(&(inverse * velocity)) < CHI2_99[3]);
        if certain || (may_rest && still) {
            rows.extend([Vec3::x(), Vec3::y(), Vec3::z()].map(|a| self.speed_row(&a, REST_SPEED)));
        }
        self.state.update(&rows);
        let speed = self.velocity().norm();
        if speed > FASTEST {
            let mut row = self.speed_row(&(self.velocity() / speed), 0.0);
            row.residual += FASTEST;
            row.variance = 1e-6;
            self.state.update(&[row]);
        }
    }

    /// Measurement row of zero speed along a direction, with a standard deviation.
    fn speed_row(&self, direction: &Vec3, sigma: f64) -> Row {
        let mut jacobian = Vec8::zeros();
        jacobian.fixed_rows_mut::<3>(3).copy_from(direction);
        Row {
            jacobian,
            residual: -direction.dot(&self.velocity()),
            variance: sigma * sigma,
        }
    }

    pub(super) fn position(&self) -> Vec3 {
        self.state.mean.fixed_rows::<3>(0).into_owned()
    }

    pub(super) fn velocity(&self) -> Vec3 {
        self.state.mean.fixed_rows::<3>(3).into_owned()
    }

    pub(super) fn covariance(&self) -> Mat6 {
        self.state.covariance.fixed_view::<6, 6>(0, 0).into_owned()
    }

    /// Width and height, m.
    pub(super) fn size(&self) -> [f64; 2] {
        [6, 7].map(|i| libm::exp(self.state.mean[i]))
    }

    /// Predicted sides and depth in a camera, with their derivatives; `None` behind the camera.
    pub(super) fn project(&self, view: &View) -> Option<Projection> {
        let p = view.camera_point(&self.position());
        if p.z.is_nan() || p.z < NEAREST {
            return None;
        }
        let (fx, fy) = (view.camera.fx, view.camera.fy);
        let centre = view.camera.project(&p);
        let [c2, s2] = view.roll;
        let [w2, h2] = self.size().map(|s| s * s);
        let (seen_w, seen_h) = ((w2 * c2 + h2 * s2).sqrt(), (h2 * c2 + w2 * s2).sqrt());
        let (a, b) = (fx * seen_w / p.z, fy * seen_h / p.z);
        // Derivatives by the point in camera coordinates, then by the logarithms of the sizes.
        let du = Vec3::new(fx / p.z, 0.0, -fx * p.x / (p.z * p.z));
        let dv = Vec3::new(0.0, fy / p.z, -fy * p.y / (p.z * p.z));
        let da = Vec3::new(0.0, 0.0, -a / p.z);
        let db = Vec3::new(0.0, 0.0, -b / p.z);
        let (aw, ah) = (
            a * w2 * c2 / (seen_w * seen_w),
            a * h2 * s2 / (seen_w * seen_w),
        );
        let (bw, bh) = (
            b * w2 * s2 / (seen_h * seen_h),
            b * h2 * c2 / (seen_h * seen_h),
        );
        let row = |point: Vec3, w: f64, h: f64| {
            let world = view.rotation.transpose() * point;
            let mut row = Vec8::zeros();
            row.fixed_rows_mut::<3>(0).copy_from(&world);
            row[6] = w;
            row[7] = h;
            row
        };
        Some(Projection {
            sides: [
                centre.x - a / 2.0,
                centre.y - b / 2.0,
                centre.x + a / 2.0,
                centre.y + b / 2.0,
            ],
            jacobians: [
                row(du - da / 2.0, -aw / 2.0, -ah / 2.0),
                row(dv - db / 2.0, -bw / 2.0, -bh / 2.0),
                row(du + da / 2.0, aw / 2.0, ah / 2.0),
                row(dv + db / 2.0, bw / 2.0, bh / 2.0),
            ],
            z: p.z,
            z_jacobian: row(Vec3::z(), 0.0, 0.0),
        })
    }
}

/// Width and height of an upright ellipse whose image has this size in a rolled camera. Near 45 degrees they cannot be
/// separated: the image size is returned.
fn upright([w, h]: [f64; 2], [c2, s2]: [f64; 2]) -> [f64; 2] {
    if (c2 - s2).abs() < 0.3 {
        return [w, h];
    }
    let (w2, h2, d) = (w * w, h * h, c2 * c2 - s2 * s2);
    let least = w2.min(h2) * 0.1;
    [
        ((w2 * c2 - h2 * s2) / d).max(least).sqrt(),
        ((h2 * c2 - w2 * s2) / d).max(least).sqrt(),
    ]
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::{Camera, Se3, Vec6};

    fn filter(v: &[f64]) -> Spatial {
        Spatial {
            state: Gaussian {
                mean: Vec8::from_column_slice(v),
                covariance: Mat8::identity(),
            },
        }
    }

    fn shifted(filter: &Spatial, view: &View, i: usize, step: f64) -> [f64; 5] {
        let mut f = filter.clone();
        f.state.mean[i] += step;
        let p = f.project(view).unwrap();
        [p.sides[0], p.sides[1], p.sides[2], p.sides[3], p.z]
    }

    proptest! {
        #[test]
        fn spatial_jacobians_match_differences(
            at in prop::array::uniform3(-1.0..1.0_f64), size in prop::array::uniform2(-2.0..0.5_f64),
            twist in prop::array::uniform6(-0.4..0.4_f64)
        ) {
            let camera = Camera::pinhole(640, 480, [517.3, 510.0, 318.6, 255.3]);
            let pose = Se3::exp(&Vec6::from_column_slice(&twist));
            let view = View::new(&camera, camera.undistorted_bounds(), &pose, &Vec3::y());
            let f = filter(&[at[0], at[1], at[2] + 3.5, 0.3, 0.1, -0.2, size[0], size[1]]);
            let p = f.project(&view).unwrap();
            for i in 0..8 {
                let step = 1e-6;
                let (plus, minus) = (shifted(&f, &view, i, step), shifted(&f, &view, i, -step));
                for k in 0..5 {
                    let numeric = (plus[k] - minus[k]) / (2.0 * step);
                    let analytic = if k < 4 { p.jacobians[k][i] } else { p.z_jacobian[i] };
                    prop_assert!(
                        (numeric - analytic).abs() <= 1e-5 * (1.0 + numeric.abs()),
                        "number {k} by state {i}: {numeric} {analytic}"
                    );
                }
            }
        }

        #[test]
        fn upright_size_is_recovered_from_a_rolled_box(w in 0.1..1.0_f64, h in 0.1..2.0_f64, roll in -0.5..0.5_f64) {
            let c = libm::cos(roll);
            let roll = [c * c, 1.0 - c * c];
            let seen = [
                (w * w * roll[0] + h * h * roll[1]).sqrt(),
                (h * h * roll[0] + w * w * roll[1]).sqrt(),
            ];
            let found = upright(seen, roll);
            prop_assert!((found[0] - w).abs() < 1e-6 || w < 0.35 * h || h < 0.35 * w, "{found:?}");
            prop_assert!((found[1] - h).abs() < 1e-6 || w < 0.35 * h || h < 0.35 * w, "{found:?}");
        }
    }

    #[test]
    fn person_projection_matches_a_manual_calculation() {
        let camera = Camera::pinhole(640, 480, [500.0, 500.0, 320.0, 240.0]);
        let view = View::ahead(&camera);
        let (w, h) = (libm::log(0.5), libm::log(1.6));
        let f = filter(&[0.2, 0.1, 2.0, 0.0, 0.0, 0.0, w, h]);
        let p = f.project(&view).unwrap();
        let expected = [370.0 - 62.5, 265.0 - 200.0, 370.0 + 62.5, 265.0 + 200.0];
        for (found, expected) in p.sides.iter().zip(expected) {
            assert!((found - expected).abs() < 1e-9, "{found} {expected}");
        }
        assert_eq!(p.z, 2.0);
        assert!(
            filter(&[0.2, 0.1, -2.0, 0.0, 0.0, 0.0, w, h])
                .project(&view)
                .is_none()
        );
    }
}
