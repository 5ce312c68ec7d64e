//! Online calibration of the inertial sensor: gyroscope bias, rotation to the camera, time offset.

use super::integrate::Rotation;
use stillpoint_geometry::nalgebra::{SMatrix, SVector, UnitQuaternion};
use stillpoint_geometry::{ImuModel, Mat3, Vec3, so3};

/// Gate on the squared Mahalanobis distance of a measurement: 99.9 % of chi-square with three degrees of freedom.
const GATE: f64 = 16.27;
/// Uncertainty of a given mount rotation of an inertial sensor or wheel odometry about each axis, rad: half a
/// degree. With one degree, people passed the wider gates of a camera that turns while blocked (3.4 degrees off instead
/// of 1.5, decision 39).
pub(crate) const MOUNT_SIGMA: f64 = 8.7e-3;
/// Uncertainty of a given time offset, s: with 10 ms gates were too wide, as with a mount of one degree
/// (decision 39).
const OFFSET_SIGMA: f64 = 0.005;
/// Consecutive gated measurements after which the variances of mount and offset grow by [`MISSTATED`]: chosen, as three
/// beyond a quantile of 99.9 % come once in 1e9 by chance.
const MISSES: u32 = 3;
/// Added uncertainty of mount, rad, and time offset, s, after [`MISSES`]: four times [`MOUNT_SIGMA`] and three
/// times [`OFFSET_SIGMA`]. Chosen for the errors that docs/inertial.md promises to find, a few degrees and 20 ms.
const MISSTATED: [f64; 2] = [0.035, 0.015];
/// Random walk of the mount, rad/sqrt(s): a degree in half a day of work. Chosen: slow enough that a run of minutes
/// keeps its mount (0.04 degrees in one minute).
const MOUNT_WALK: f64 = 1e-4;
/// Random walk of the time offset, s/sqrt(s): 20 millionths over a minute, the tolerance in data sheets of common
/// quartz crystals.
const OFFSET_WALK: f64 = 1.5e-4;

/// States: three axes each of bias and mount, and the time offset, in this order.
const STATES: usize = 7;
type Covariance = SMatrix<f64, STATES, STATES>;
type Derivatives = SMatrix<f64, 3, STATES>;

/// Kalman filter of bias, mount and time offset. Rest and tracked rotations are its measurements; each state follows a
/// random walk.
#[derive(Clone, Copy, Debug)]
pub(super) struct Calibration {
    /// Sensor axes, rad/s.
    pub(super) bias: Vec3,
    pub(super) camera_from_imu: UnitQuaternion<f64>,
    /// Correction to the sensor's stamps in addition to the configured offset, s.
    pub(super) offset: f64,
    /// Of bias, mount rotation (in sensor axes) and time offset.
    covariance: Covariance,
    walk: f64,
    misses: u32,
}

/// States that a comparison of rotations may correct.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Teaches {
    /// The bias only: the reference of the camera's pose may itself be moving.
    Bias,
    Everything,
}

impl Calibration {
    pub(super) fn new(model: &ImuModel) -> Self {
        let mut covariance = Covariance::zeros();
        let sigmas = [model.gyro_bias, MOUNT_SIGMA, OFFSET_SIGMA];
        for i in 0..STATES {
            covariance[(i, i)] = sigmas[i / 3] * sigmas[i / 3];
        }
        Self {
            bias: Vec3::zeros(),
            camera_from_imu: model.camera_from_imu.rotation,
            offset: 0.0,
            covariance,
            walk: model.gyro_walk,
            misses: 0,
        }
    }

    /// Prediction: adds the random walk over `seconds`.
    pub(super) fn wait(&mut self, seconds: f64) {
        let walks = [self.walk, MOUNT_WALK, OFFSET_WALK];
        for i in 0..STATES {
            let walk = walks[i / 3];
            self.covariance[(i, i)] += walk * walk * seconds.max(0.0);
        }
    }

    /// Standard deviation of a rotation about an axis due to bias and mount, rad.
    pub(super) fn sigma_of(&self, rotation: &Rotation) -> f64 {
        let mut by = derivatives(rotation, &rotation.later_from_earlier);
        by.fixed_columns_mut::<1>(6).fill(0.0);
        deviation(&(by * self.covariance * by.transpose()))
    }

    /// Standard deviation of the bias, mean of the three axes, rad/s.
    pub(super) fn bias_sigma(&self) -> f64 {
        deviation(&self.covariance.fixed_view::<3, 3>(0, 0).into_owned())
    }

    pub(super) fn mount_sigma(&self) -> f64 {
        deviation(&self.covariance.fixed_view::<3, 3>(3, 3).into_owned())
    }

    pub(super) fn offset_sigma(&self) -> f64 {
        self.covariance[(6, 6)].max(0.0).sqrt()
    }

    /// The camera's rotation from earlier to later, in sensor axes.
    pub(super) fn in_sensor(
        &self,
        camera_later_from_earlier: &UnitQuaternion<f64>,
    ) -> UnitQuaternion<f64> {
        self.camera_from_imu.inverse() * camera_later_from_earlier * self.camera_from_imu
    }

    /// Measurement update at rest: the mean `rate` with standard deviation `sigma`, rad/s, is the bias.
    pub(super) fn measure_rest(&mut self, rate: &Vec3, sigma: f64) {
        let mut by = Derivatives::zeros();
        by.fixed_columns_mut::<3>(0).copy_from(&Mat3::identity());
        self.update(&(rate - self.bias), &by, sigma, Teaches::Bias);
    }

    /// Measurement update with the sensor's `rotation` and the visual rotation `seen` (in sensor axes) with standard
    /// deviation `sigma`, rad. Measurements beyond the gate are ignored.
    pub(super) fn measure_turn(
        &mut self,
        rotation: &Rotation,
        seen: &UnitQuaternion<f64>,
        sigma: f64,
        teaches: Teaches,
    ) {
        let by = derivatives(rotation, seen);
        self.update(&difference(rotation, seen), &by, sigma, teaches);
    }

    /// Kalman update with residual `offset` and Jacobian `by`. States that are not taught are considered but not
    /// changed (Schmidt 1966).
    fn update(&mut self, offset: &Vec3, by: &Derivatives, sigma: f64, teaches: Teaches) {
        let noise = Mat3::identity() * (sigma * sigma);
        let spread = by * self.covariance * by.transpose() + noise;
        let Some(inverse) = spread.try_inverse() else {
            return;
        };
        if offset.dot(&(inverse * offset)) > GATE {
            self.miss(teaches);
            return;
        }
        self.misses = 0;
        let mut gain = self.covariance * by.transpose() * inverse;
        if teaches == Teaches::Bias {
            gain.fixed_rows_mut::<4>(3).fill(0.0);
        }
        self.correct(&(gain * offset));
        let left = Covariance::identity() - gain * by;
        // Joseph form keeps the covariance symmetric and positive definite.
        self.covariance =
            left * self.covariance * left.transpose() + gain * gain.transpose() * (sigma * sigma);
    }

    fn miss(&mut self, teaches: Teaches) {
        self.misses += u32::from(teaches == Teaches::Everything);
        if self.misses >= MISSES {
            self.misses = 0;
            for i in 3..STATES {
                let more = MISSTATED[i / 3 - 1];
                self.covariance[(i, i)] += more * more;
            }
        }
    }

    fn correct(&mut self, by: &SVector<f64, STATES>) {
        self.bias += by.fixed_rows::<3>(0);
        let turn: Vec3 = by.fixed_rows::<3>(3).into_owned();
        self.camera_from_imu *= so3::exp(&turn);
        self.offset += by[6];
    }

    /// State of the time-reversed sensor.
    pub(super) fn mirrored(&self) -> Self {
        let mut mirror = Covariance::identity();
        for i in [0, 1, 2, 6] {
            mirror[(i, i)] = -1.0;
        }
        Self {
            bias: -self.bias,
            offset: -self.offset,
            covariance: mirror * self.covariance * mirror,
            ..*self
        }
    }
}

/// Rotation vector from the sensor's rotation to the visual one, in sensor axes.
pub(super) fn difference(rotation: &Rotation, seen: &UnitQuaternion<f64>) -> Vec3 {
    so3::log(&(seen * rotation.later_from_earlier.inverse()))
}

/// Jacobian of the difference with respect to bias, mount and time offset.
fn derivatives(rotation: &Rotation, seen: &UnitQuaternion<f64>) -> Derivatives {
    let mut by = Derivatives::zeros();
    by.fixed_columns_mut::<3>(0).copy_from(&rotation.by_bias);
    let turned = Mat3::identity() - seen.to_rotation_matrix().into_inner();
    by.fixed_columns_mut::<3>(3).copy_from(&turned);
    by.fixed_columns_mut::<1>(6).copy_from(&rotation.by_time);
    by
}

fn deviation(covariance: &Mat3) -> f64 {
    (covariance.trace() / 3.0).max(0.0).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn vector(size: f64) -> impl Strategy<Value = Vec3> {
        [-size..size, -size..size, -size..size].prop_map(Vec3::from)
    }

    /// An error-free rotation of half a second.
    fn exact(turn: &Vec3, change: &Vec3) -> Rotation {
        Rotation {
            later_from_earlier: so3::exp(turn),
            by_bias: Mat3::identity() * 0.5,
            by_time: *change,
        }
    }

    /// The same rotation measured with a bias and a time offset that [`Calibration`] has not corrected.
    fn wrong(exact: &Rotation, bias: &Vec3, offset: f64) -> Rotation {
        let off = exact.by_bias * bias + exact.by_time * offset;
        Rotation {
            later_from_earlier: so3::exp(&-off) * exact.later_from_earlier,
            ..*exact
        }
    }

    proptest! {
        /// For small state errors the difference is linear with these derivatives.
        #[test]
        fn derivatives_match_the_linearised_difference(turn in vector(0.6), change in vector(1.0), state in vector(1e-4), mount in vector(1e-4), offset in -1e-4..1e-4f64) {
            let exact = exact(&turn, &change);
            let wrong = wrong(&exact, &state, offset);
            let seen = so3::exp(&mount) * exact.later_from_earlier * so3::exp(&-mount);
            let found = difference(&wrong, &seen);
            let by = derivatives(&wrong, &seen);
            let states: Vec<f64> = state.iter().chain(mount.iter()).copied().chain([offset]).collect();
            let expected = by * SVector::<f64, STATES>::from_column_slice(&states);
            prop_assert!((found - expected).norm() < 1e-6, "{found} {expected}");
        }

        /// Rotations about several axes make all states observable.
        #[test]
        fn rotations_calibrate_bias_mount_and_time_offset(bias in vector(0.02), mount in vector(0.04), offset in -0.02..0.02f64, seed in 0u32..1000) {
            let model = ImuModel::bmi055();
            let mut found = Calibration::new(&model);
            for k in 0..60_u32 {
                let angle = f64::from(k + seed);
                let turn = Vec3::new(libm::sin(angle), libm::sin(1.7 * angle), libm::sin(2.9 * angle)) * 0.3;
                let change = Vec3::new(libm::cos(2.3 * angle), libm::cos(angle), libm::cos(1.3 * angle));
                let exact = exact(&turn, &change);
                let rotation = wrong(&exact, &(bias - found.bias), offset - found.offset);
                let camera = so3::exp(&mount) * exact.later_from_earlier * so3::exp(&-mount);
                let seen = found.in_sensor(&camera);
                found.wait(0.5);
                found.measure_turn(&rotation, &seen, 0.003, Teaches::Everything);
            }
            prop_assert!((found.bias - bias).norm() < 0.002, "{} {bias}", found.bias);
            let off = found.camera_from_imu.angle_to(&so3::exp(&mount));
            prop_assert!(off < 0.004 && (found.offset - offset).abs() < 0.002, "{off} {}", found.offset);
            prop_assert!(found.bias_sigma() < 0.003 && found.mount_sigma() < 0.004 && found.offset_sigma() < 0.002);
        }
    }

    #[test]
    fn implausible_bias_measurement_is_ignored() {
        let mut known = Calibration::new(&ImuModel::bmi055());
        known.measure_rest(&Vec3::new(0.0, 0.5, 0.0), 0.002);
        assert_eq!(known.bias, Vec3::zeros());
        known.measure_rest(&Vec3::new(0.0, 0.02, 0.0), 0.002);
        assert!((known.bias - Vec3::new(0.0, 0.02, 0.0)).norm() < 1e-3);
        assert!(known.bias_sigma() < 0.002);
    }

    #[test]
    fn bias_only_updates_leave_mount_and_offset_unchanged() {
        let model = ImuModel::bmi055();
        let mut known = Calibration::new(&model);
        let exact = exact(&Vec3::new(0.0, 0.3, 0.0), &Vec3::x());
        let seen = so3::exp(&Vec3::new(0.0, 0.31, 0.004));
        let before = (known.mount_sigma(), known.offset_sigma());
        known.measure_turn(&exact, &seen, 0.003, Teaches::Bias);
        assert!(known.bias.norm() > 1e-3);
        assert_eq!(
            (known.camera_from_imu, known.offset),
            (model.camera_from_imu.rotation, 0.0)
        );
        assert!((known.mount_sigma() - before.0).abs() < 1e-12);
        known.measure_turn(&exact, &seen, 0.003, Teaches::Everything);
        assert!(known.camera_from_imu != model.camera_from_imu.rotation && known.offset != 0.0);
        assert!(known.mount_sigma() < before.0 && known.offset_sigma() < before.1);
    }

    #[test]
    fn bias_sigma_grows_without_measurements() {
        let mut known = Calibration::new(&ImuModel {
            gyro_walk: 1e-3,
            ..ImuModel::bmi055()
        });
        known.measure_rest(&Vec3::zeros(), 1e-4);
        let before = known.bias_sigma();
        known.wait(100.0);
        assert!(before < 2e-4 && (known.bias_sigma() - 0.01).abs() < 1e-3);
    }
}
