//! What is estimated of the sensor: the gyroscope's bias, how the sensor stands to the camera, and how its clock is off.

use super::integrate::Rotation;
use stillpoint_geometry::nalgebra::{SMatrix, SVector, UnitQuaternion};
use stillpoint_geometry::{ImuModel, Mat3, Vec3, so3};

/// A measurement farther off than this is not of the same sensor: 99.9 % of chi-square with three degrees of freedom.
const GATE: f64 = 16.27;
/// What a mount that is stated, of an inertial sensor or of wheels, is off by about each axis, rad: half a degree. With one degree people passed the wider gates of a blocked turn (3.4
/// degrees off instead of 1.5, decision 39).
pub(crate) const MOUNT_SIGMA: f64 = 8.7e-3;
/// What a time offset that is stated is off by, s: with 10 ms gates were too wide, as with a mount of one degree (decision 39).
const OFFSET_SIGMA: f64 = 0.005;
/// So many measurements in a row that are farther off say that mount or clock are so, by [`MISSTATED`] more: chosen, as three beyond a quantile of
/// 99.9 % come once in 1e9 by chance.
const MISSES: u32 = 3;
/// How much farther off mount, rad, and clock, s, may be then: four times [`MOUNT_SIGMA`] and three times [`OFFSET_SIGMA`]. Chosen for the errors
/// that docs/inertial.md promises to find, a few degrees and 20 ms.
const MISSTATED: [f64; 2] = [0.035, 0.015];
/// How a mount works loose, rad/sqrt(s): a degree in half a day of work. Chosen: slow enough that a run of minutes keeps its mount (0.04 degrees in
/// one minute).
const MOUNT_WALK: f64 = 1e-4;
/// How two clocks drift apart, s/sqrt(s): 20 millionths over a minute, the tolerance that data sheets of common quartz crystals state.
const OFFSET_WALK: f64 = 1.5e-4;

/// Of the bias, the mount and the time offset, in this order, a number: three axes of each of the first two, and one offset.
const STATES: usize = 7;
type Covariance = SMatrix<f64, STATES, STATES>;
type Derivatives = SMatrix<f64, 3, STATES>;

/// Bias, mount and time offset with their covariance, by a Kalman filter: rest and tracked rotations measure them, and each walks.
#[derive(Clone, Copy, Debug)]
pub(super) struct Calibration {
    /// In the axes of the sensor, rad/s.
    pub(super) bias: Vec3,
    /// Turns the sensor's axes to the camera's.
    pub(super) camera_from_imu: UnitQuaternion<f64>,
    /// What is to be added to the sensor's stamps beyond what is stated, s.
    pub(super) offset: f64,
    /// Of the bias, of a turn of the mount in the sensor's axes, and of the offset.
    covariance: Covariance,
    walk: f64,
    /// Measurements in a row that were too far off.
    misses: u32,
}

/// What a comparison of rotations may teach.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Teaches {
    /// The bias alone: what the camera's pose was taken from may move itself.
    Bias,
    Everything,
}

impl Calibration {
    /// Of a sensor that was switched on.
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

    /// Time goes by, s.
    pub(super) fn wait(&mut self, seconds: f64) {
        let walks = [self.walk, MOUNT_WALK, OFFSET_WALK];
        for i in 0..STATES {
            let walk = walks[i / 3];
            self.covariance[(i, i)] += walk * walk * seconds.max(0.0);
        }
    }

    /// What bias and mount leave open of a rotation: one standard deviation about an axis, rad.
    pub(super) fn sigma_of(&self, rotation: &Rotation) -> f64 {
        let mut by = derivatives(rotation, &rotation.later_from_earlier);
        by.fixed_columns_mut::<1>(6).fill(0.0);
        deviation(&(by * self.covariance * by.transpose()))
    }

    /// The bias's standard deviation, the mean of the three axes, rad/s.
    pub(super) fn bias_sigma(&self) -> f64 {
        deviation(&self.covariance.fixed_view::<3, 3>(0, 0).into_owned())
    }

    /// The mount's, rad.
    pub(super) fn mount_sigma(&self) -> f64 {
        deviation(&self.covariance.fixed_view::<3, 3>(3, 3).into_owned())
    }

    /// The time offset's, s.
    pub(super) fn offset_sigma(&self) -> f64 {
        self.covariance[(6, 6)].max(0.0).sqrt()
    }

    /// The camera's turn from earlier to later, in the axes of the sensor.
    pub(super) fn in_sensor(
        &self,
        camera_later_from_earlier: &UnitQuaternion<f64>,
    ) -> UnitQuaternion<f64> {
        self.camera_from_imu.inverse() * camera_later_from_earlier * self.camera_from_imu
    }

    /// The sensor measured `rate` where nothing turned, give or take `sigma`, rad/s.
    pub(super) fn measure_rest(&mut self, rate: &Vec3, sigma: f64) {
        let mut by = Derivatives::zeros();
        by.fixed_columns_mut::<3>(0).copy_from(&Mat3::identity());
        self.update(&(rate - self.bias), &by, sigma, Teaches::Bias);
    }

    /// The sensor turned by `rotation` while the camera was seen to turn by `seen`, in the axes of the sensor, give or take `sigma`, rad. Of what cannot be,
    /// nothing is learnt.
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

    /// A measurement of what is wrong with the states, which `by` brings to `offset`. What is not taught is considered and not changed (Schmidt 1966).
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
        // Joseph's form stays symmetric and positive.
        self.covariance =
            left * self.covariance * left.transpose() + gain * gain.transpose() * (sigma * sigma);
    }

    /// A measurement was too far off.
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

    /// Of a sensor whose time runs backwards.
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

/// By which rotation vector a turn that was seen, in the axes of the sensor, differs from the sensor's.
pub(super) fn difference(rotation: &Rotation, seen: &UnitQuaternion<f64>) -> Vec3 {
    so3::log(&(seen * rotation.later_from_earlier.inverse()))
}

/// How the difference changes with what is wrong with bias, mount and time offset.
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

    /// A turn of half a second, as a sensor has it that errs by nothing.
    fn exact(turn: &Vec3, change: &Vec3) -> Rotation {
        Rotation {
            later_from_earlier: so3::exp(turn),
            by_bias: Mat3::identity() * 0.5,
            by_time: *change,
        }
    }

    /// The same as one has it that stands so to the camera and adds a bias and an offset, as [`Calibration`] corrects for neither.
    fn wrong(exact: &Rotation, bias: &Vec3, offset: f64) -> Rotation {
        let off = exact.by_bias * bias + exact.by_time * offset;
        Rotation {
            later_from_earlier: so3::exp(&-off) * exact.later_from_earlier,
            ..*exact
        }
    }

    proptest! {
        /// Where the states are wrong by a little, sensor and camera differ as the derivatives say.
        #[test]
        fn derivatives_are_those_of_differences(turn in vector(0.6), change in vector(1.0), state in vector(1e-4), mount in vector(1e-4), offset in -1e-4..1e-4f64) {
            let exact = exact(&turn, &change);
            let wrong = wrong(&exact, &state, offset);
            let seen = so3::exp(&mount) * exact.later_from_earlier * so3::exp(&-mount);
            let found = difference(&wrong, &seen);
            let by = derivatives(&wrong, &seen);
            let states: Vec<f64> = state.iter().chain(mount.iter()).copied().chain([offset]).collect();
            let expected = by * SVector::<f64, STATES>::from_column_slice(&states);
            prop_assert!((found - expected).norm() < 1e-6, "{found} {expected}");
        }

        /// Measurements of turns about several axes find what a sensor may have.
        #[test]
        fn turns_find_bias_mount_and_offset(bias in vector(0.02), mount in vector(0.04), offset in -0.02..0.02f64, seed in 0u32..1000) {
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
    fn what_no_sensor_can_be_changes_nothing() {
        let mut known = Calibration::new(&ImuModel::bmi055());
        known.measure_rest(&Vec3::new(0.0, 0.5, 0.0), 0.002);
        assert_eq!(known.bias, Vec3::zeros());
        known.measure_rest(&Vec3::new(0.0, 0.02, 0.0), 0.002);
        assert!((known.bias - Vec3::new(0.0, 0.02, 0.0)).norm() < 1e-3);
        assert!(known.bias_sigma() < 0.002);
    }

    #[test]
    fn where_much_moves_mount_and_clock_are_not_learnt() {
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
    fn what_is_not_measured_becomes_less_certain() {
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
