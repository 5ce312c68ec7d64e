//! The inertial sensor on the simulated camera, exact or with realistic errors.

use super::Simulator;
use crate::random::{Normal, Purpose, bits, key};
use stillpoint_geometry::{ImuModel, STANDARD_GRAVITY, Se3, Vec3, so3};
use stillpoint_imaging::ImuSample;

/// Samples begin this long before the first frame, s: a sensor starts when the camera is switched on.
pub(super) const BEFORE: f64 = 0.05;
/// Step of numeric derivatives, s: errors of discretisation and rounding are below 1e-6 of the values.
const STEP: f64 = 1e-3;

/// An inertial sensor on the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedImu {
    /// Its mounting and error model. Stamps are shifted by minus the model's time offset.
    pub model: ImuModel,
    /// Samples per second, 10 to 4000.
    pub rate: f64,
    /// Without noise it measures exactly, without bias and quantisation.
    pub noise: bool,
    /// Quantisation steps of the gyroscope, rad/s, and of the accelerometer, m/s^2.
    pub steps: [f64; 2],
}

impl Default for SimulatedImu {
    /// A BMI055 at 200 Hz mounted as in a D435i, with ranges of 500 deg/s (65.6 LSB per deg/s) and 4 g (512 LSB/g) by its data sheet.
    fn default() -> Self {
        let place = Vec3::new(-0.0055, 0.0051, 0.0117);
        Self {
            model: ImuModel::bmi055().mounted(Se3::new(so3::exp(&Vec3::zeros()), place)),
            rate: 200.0,
            noise: true,
            steps: [(1.0_f64 / 65.6).to_radians(), STANDARD_GRAVITY / 512.0],
        }
    }
}

impl Simulator {
    /// All samples of the recording, in time order. A pure function of the configurations and the seed.
    #[must_use]
    pub fn inertial(&self, imu: &SimulatedImu) -> Vec<ImuSample> {
        let rate = imu.rate.clamp(10.0, 4000.0);
        let end = self.stamp(self.length) + BEFORE;
        let count = ((end + BEFORE) * rate).ceil() as u64;
        let mut errors = Errors::new(imu, rate, self.seed);
        let sample = |k: u64| {
            let time = k as f64 / rate - BEFORE;
            let (rate, force) = self.exact(&imu.model.camera_from_imu, time);
            let (rate, force) = errors.spoil(k, rate, force);
            ImuSample {
                stamp: time - imu.model.time_offset,
                angular_rate: rate.into(),
                specific_force: force.into(),
            }
        };
        (0..count).map(sample).collect()
    }

    /// Angular rate (rad/s) and specific force (m/s^2) in the axes of the sensor.
    fn exact(&self, camera_from_imu: &Se3, time: f64) -> (Vec3, Vec3) {
        let pose = |k: f64| self.world_from_camera(time + k * STEP) * *camera_from_imu;
        let at = [-2.0, -1.0, 0.0, 1.0, 2.0].map(pose);
        let turn = |a: usize, b: usize| so3::log(&(at[a].rotation.inverse() * at[b].rotation));
        // Central differences of fourth order (Fornberg, Mathematics of Computation 51, 1988).
        let rate = (turn(1, 3) * 8.0 - turn(0, 4)) / (12.0 * STEP);
        let p = |k: usize| at[k].translation;
        let bend = (p(1) + p(3)) * 16.0 - (p(0) + p(4)) - p(2) * 30.0;
        let acceleration = bend / (12.0 * STEP * STEP);
        let up = Vec3::z() * STANDARD_GRAVITY;
        (rate, at[2].rotation.inverse() * (acceleration + up))
    }
}

struct Errors<'a> {
    imu: &'a SimulatedImu,
    normal: Normal,
    key: u64,
    /// Deviations of the white noise and of a step of the biases, of the gyroscope and of the accelerometer.
    white: [f64; 2],
    walk: [f64; 2],
    bias: [Vec3; 2],
}

impl<'a> Errors<'a> {
    fn new(imu: &'a SimulatedImu, rate: f64, seed: u64) -> Self {
        let m = &imu.model;
        let mut errors = Self {
            imu,
            normal: Normal::new(),
            key: key(seed, Purpose::Inertial, 0),
            white: [m.gyro_noise, m.accel_noise].map(|n| n * rate.sqrt()),
            walk: [m.gyro_walk, m.accel_walk].map(|n| n / rate.sqrt()),
            bias: [Vec3::zeros(); 2],
        };
        let first = [m.gyro_bias, m.accel_bias];
        errors.bias = [0, 1].map(|s| errors.draw(0, 2 * s) * first[s as usize]);
        errors
    }

    /// Three normal numbers for a sample, from one of four streams.
    fn draw(&self, sample: u64, stream: u64) -> Vec3 {
        let at = |axis: u64| {
            let index = 12 * sample + 3 * stream + axis;
            f64::from(self.normal.at(bits(self.key, index)))
        };
        Vec3::new(at(0), at(1), at(2))
    }

    fn spoil(&mut self, sample: u64, rate: Vec3, force: Vec3) -> (Vec3, Vec3) {
        if !self.imu.noise {
            return (rate, force);
        }
        let spoiled = [rate, force];
        let [rate, force] = [0, 1].map(|s: u64| {
            let i = s as usize;
            if sample > 0 {
                self.bias[i] += self.draw(sample, 2 * s) * self.walk[i];
            }
            let value = spoiled[i] + self.bias[i] + self.draw(sample, 2 * s + 1) * self.white[i];
            let step = self.imu.steps[i];
            value.map(|v| libm::round(v / step) * step)
        });
        (rate, force)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::path::Path;
    use crate::simulator::SimulatorConfig;
    use stillpoint_geometry::Vec6;
    use stillpoint_imaging::FrameSource;

    fn simulator(scene: &str) -> Simulator {
        Simulator::new(&SimulatorConfig {
            scene: scene.into(),
            frames: Some(30),
            ..SimulatorConfig::default()
        })
        .unwrap()
    }

    fn exactly(model: ImuModel) -> SimulatedImu {
        SimulatedImu {
            model,
            noise: false,
            ..SimulatedImu::default()
        }
    }

    #[test]
    fn constant_twist_gives_constant_rate_and_force() {
        // A rotation about the vertical with a lever arm: the rate is constant, the force is gravity and omega^2 r.
        let start = Se3::new(
            so3::exp(&Vec3::new(0.0, 0.0, 0.3)),
            Vec3::new(1.0, 2.0, 1.0),
        );
        let twist = Vec6::new(0.2, 0.0, 0.0, 0.0, 0.0, 1.5);
        let mut simulator = simulator("static");
        simulator.path = Path::steady(start, twist);
        let model = ImuModel::bmi055().turned(Vec3::new(0.4, -0.2, 1.0));
        let axes = model.camera_from_imu.rotation.inverse();
        let omega = Vec3::new(0.0, 0.0, 1.5);
        // In the axes of the camera the velocity is constantly (0.2, 0, 0).
        let force = omega.cross(&Vec3::new(0.2, 0.0, 0.0)) + Vec3::z() * STANDARD_GRAVITY;
        for s in simulator.inertial(&exactly(model)) {
            assert!((Vec3::from(s.angular_rate) - axes * omega).norm() < 1e-8);
            assert!((Vec3::from(s.specific_force) - axes * force).norm() < 1e-6);
        }
    }

    #[test]
    fn integrated_exact_rates_match_the_poses() {
        let simulator = simulator("rpy");
        let imu = exactly(ImuModel::bmi055());
        let samples = simulator.inertial(&imu);
        let (mut turn, mut span) = (so3::exp(&Vec3::zeros()), 0.0);
        for pair in samples.windows(2).skip(20).take(150) {
            let dt = pair[1].stamp - pair[0].stamp;
            let mean = (Vec3::from(pair[0].angular_rate) + Vec3::from(pair[1].angular_rate)) * 0.5;
            turn *= so3::exp(&(mean * dt));
            span += dt;
        }
        let from = samples[20].stamp;
        let [a, b] = [from, from + span].map(|t| simulator.world_from_camera(t).rotation);
        let error = (a.inverse() * b).angle_to(&turn);
        assert!((a.inverse() * b).angle() > 0.05 && error < 2e-5, "{error}");
    }

    #[test]
    fn noise_and_bias_follow_the_data_sheet_and_the_seed() {
        let simulator = simulator("static");
        let imu = SimulatedImu::default();
        let exact = simulator.inertial(&exactly(imu.model));
        let spoiled = simulator.inertial(&imu);
        assert_eq!(spoiled, simulator.inertial(&imu));
        let count = exact.len() as f64;
        for (of, density, bias) in [
            (0, imu.model.gyro_noise, imu.model.gyro_bias),
            (1, imu.model.accel_noise, imu.model.accel_bias),
        ] {
            let value = |s: &ImuSample| [s.angular_rate, s.specific_force][of][1];
            let errors: Vec<f64> = exact
                .iter()
                .zip(&spoiled)
                .map(|(a, b)| value(b) - value(a))
                .collect();
            let mean = errors.iter().sum::<f64>() / count;
            let deviation =
                (errors.iter().map(|e| (e - mean) * (e - mean)).sum::<f64>() / count).sqrt();
            let expected = density * 200.0_f64.sqrt();
            assert!(mean.abs() < 3.0 * bias && mean != 0.0, "{mean}");
            assert!(
                (deviation / expected - 1.0).abs() < 0.15,
                "{deviation} {expected}"
            );
        }
    }

    #[test]
    fn source_gives_the_inertial_samples_of_its_frames() {
        let imu = exactly(ImuModel::bmi055());
        let mut source = simulator("static")
            .source()
            .with_imu(&imu)
            .between(10, None);
        assert!(source.take_inertial().is_empty());
        let frame = source.next_frame().unwrap().unwrap();
        let first = source.take_inertial();
        assert!(first[0].stamp >= frame.stamp - BEFORE - 1e-9);
        source.next_frame().unwrap().unwrap();
        let next = source.take_inertial();
        let before = first.last().unwrap().stamp;
        assert!(before >= frame.stamp && next[0].stamp > before);
        assert!((6..=7).contains(&next.len()), "{}", next.len());
    }
}
