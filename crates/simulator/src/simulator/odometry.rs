//! Wheel odometry of a base that carries the simulated camera, exact or with realistic errors.
//!
//! The base follows the camera: even a path impossible for wheels is measured, in all six degrees of freedom.

use super::Simulator;
use crate::random::{Normal, Purpose, bits, key};
use stillpoint_geometry::{OdometryModel, Se3, Vec3, so3};
use stillpoint_imaging::OdometrySample;

/// Samples begin this long before the first frame, s.
pub(super) const BEFORE: f64 = 0.2;
/// Standard deviation of the varying scale errors relative to that of the constant ones.
const RESTLESS: f64 = 3.0;

/// An interval in which the wheels spin: they advance without the base.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct WheelSlip {
    /// Start, s.
    pub from: f64,
    /// End, s.
    pub to: f64,
    /// Speed, m/s.
    pub speed: f64,
}

/// Odometry of the base under the camera.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatedOdometry {
    /// The camera's pose on the base, and the error model of the wheels. Stamps are shifted by minus the time offset.
    pub model: OdometryModel,
    /// Samples per second, 2 to 1000.
    pub rate: f64,
    /// Without noise it measures exactly. With noise there are constant errors (scale of distances, scale of rotations, and rotation per
    /// metre), each drawn once with the model's deviation; from sample to sample the first two vary by three times as much.
    pub noise: bool,
    /// Intervals of spinning wheels.
    pub slips: Vec<WheelSlip>,
    /// Reports a standing base throughout.
    pub stuck: bool,
    /// Independent noise of every sample, m and rad; unrealistic for wheels.
    pub jitter: [f64; 2],
}

impl Default for SimulatedOdometry {
    /// At 50 Hz, of an indoor robot with two driven wheels; the camera looks ahead, 0.2 m before the axle and half a metre above it.
    fn default() -> Self {
        let left = so3::exp(&Vec3::new(0.0, 0.0, -std::f64::consts::FRAC_PI_2));
        let down = so3::exp(&Vec3::new(-std::f64::consts::FRAC_PI_2, 0.0, 0.0));
        let base_from_camera = Se3::new(left * down, Vec3::new(0.2, 0.0, 0.5));
        Self {
            model: OdometryModel::mounted(base_from_camera),
            rate: 50.0,
            noise: true,
            slips: Vec::new(),
            stuck: false,
            jitter: [0.0; 2],
        }
    }
}

impl Simulator {
    /// All samples of the recording, in time order. A pure function of the configurations and the seed.
    #[must_use]
    pub fn odometry(&self, wheels: &SimulatedOdometry) -> Vec<OdometrySample> {
        let rate = wheels.rate.clamp(2.0, 1000.0);
        let end = self.stamp(self.length) + BEFORE;
        let count = ((end + BEFORE) * rate).ceil() as u64;
        let errors = Errors::new(wheels, self.seed);
        let camera_from_base = wheels.model.base_from_camera.inverse();
        let base = |k: u64| {
            let time = k as f64 / rate - BEFORE;
            (time, self.world_from_camera(time) * camera_from_base)
        };
        let (mut before, mut said) = (base(0), Se3::identity());
        let mut samples = Vec::new();
        for k in 0..count {
            let (time, world_from_base) = base(k);
            let step = before.1.inverse() * world_from_base;
            said = said * errors.spoil(k, &step, [before.0, time]);
            before = (time, world_from_base);
            let shown = match wheels.stuck {
                true => Se3::identity(),
                false => said * errors.jitter(k),
            };
            let q = shown.rotation;
            samples.push(OdometrySample {
                stamp: time - wheels.model.time_offset,
                position: shown.translation.into(),
                orientation: [q.i, q.j, q.k, q.w],
                sigmas: None,
            });
        }
        samples
    }
}

struct Errors<'a> {
    wheels: &'a SimulatedOdometry,
    normal: Normal,
    key: u64,
    /// Constant scale errors of distance and rotation, and rotation per metre, rad/m.
    throughout: [f64; 3],
}

impl<'a> Errors<'a> {
    fn new(wheels: &'a SimulatedOdometry, seed: u64) -> Self {
        let m = &wheels.model;
        let mut errors = Self {
            wheels,
            normal: Normal::new(),
            key: key(seed, Purpose::Odometry, 0),
            throughout: [0.0; 3],
        };
        let deviations = [m.slip_per_metre, m.slip_per_radian, m.turn_per_metre];
        errors.throughout = [0, 1, 2].map(|i| errors.draw(0, i) * deviations[i as usize]);
        errors
    }

    /// One of twelve normal numbers of a sample.
    fn draw(&self, sample: u64, stream: u64) -> f64 {
        f64::from(self.normal.at(bits(self.key, 12 * sample + stream)))
    }

    /// A measured step with errors, over a span of time, s.
    fn spoil(&self, sample: u64, step: &Se3, [from, to]: [f64; 2]) -> Se3 {
        let (mut way, mut turn) = (step.translation, so3::log(&step.rotation));
        if self.wheels.noise {
            let m = &self.wheels.model;
            let [slip, twist, drift] = self.throughout;
            let length = way.norm();
            way *= 1.0 + slip + RESTLESS * m.slip_per_metre * self.draw(sample, 3);
            turn *= 1.0 + twist + RESTLESS * m.slip_per_radian * self.draw(sample, 4);
            turn.z += drift * length;
        }
        for slip in &self.wheels.slips {
            let spins = (to.min(slip.to) - from.max(slip.from)).max(0.0);
            way.x += slip.speed * spins;
        }
        Se3::new(so3::exp(&turn), way)
    }

    fn jitter(&self, sample: u64) -> Se3 {
        let [place, turn] = self.wheels.jitter;
        let draw = |stream: u64| {
            let at = |axis: u64| self.draw(sample, stream + axis);
            Vec3::new(at(0), at(1), at(2))
        };
        Se3::new(so3::exp(&(draw(5) * turn)), draw(8) * place)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::simulator::SimulatorConfig;
    use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
    use stillpoint_imaging::FrameSource;

    fn simulator(scene: &str) -> Simulator {
        Simulator::new(&SimulatorConfig {
            scene: scene.into(),
            frames: Some(60),
            ..SimulatorConfig::default()
        })
        .unwrap()
    }

    fn exactly() -> SimulatedOdometry {
        SimulatedOdometry {
            noise: false,
            ..SimulatedOdometry::default()
        }
    }

    fn pose(s: &OdometrySample) -> Se3 {
        let [i, j, k, w] = s.orientation;
        let rotation = UnitQuaternion::new_normalize(Quaternion::new(w, i, j, k));
        Se3::new(rotation, s.position.into())
    }

    /// The camera's motion from the first sample to the last, by samples and exactly.
    fn motions(simulator: &Simulator, wheels: &SimulatedOdometry) -> [Se3; 2] {
        let samples = simulator.odometry(wheels);
        let (first, last) = (samples[0], samples[samples.len() - 1]);
        let base = pose(&first).inverse() * pose(&last);
        let [a, b] = [first.stamp, last.stamp].map(|t| simulator.world_from_camera(t));
        [wheels.model.camera_motion(&base), a.inverse() * b]
    }

    #[test]
    fn exact_odometry_matches_the_poses() {
        let [said, exact] = motions(&simulator("halfsphere"), &exactly());
        assert!(exact.translation.norm() > 0.1);
        assert!((said.inverse() * exact).log().norm() < 1e-9);
    }

    #[test]
    fn odometry_errors_are_bounded_and_follow_the_seed() {
        let simulator = simulator("xyz");
        let wheels = SimulatedOdometry::default();
        assert_eq!(simulator.odometry(&wheels), simulator.odometry(&wheels));
        let [said, exact] = motions(&simulator, &wheels);
        let off = (said.translation - exact.translation).norm();
        // Two seconds to and fro.
        assert!(off > 1e-4 && off < 0.1, "{off}");
    }

    #[test]
    fn spinning_wheels_overestimate_and_stuck_wheels_stay() {
        let simulator = simulator("static");
        let slip = WheelSlip {
            from: 0.5,
            to: 1.0,
            speed: 0.4,
        };
        let spinning = SimulatedOdometry {
            slips: vec![slip],
            ..exactly()
        };
        let [said, exact] = motions(&simulator, &spinning);
        // The camera looks ahead.
        let more = said.translation - exact.translation;
        assert!((more.z - 0.2).abs() < 0.01, "{more}");
        let stuck = SimulatedOdometry {
            stuck: true,
            ..exactly()
        };
        let samples = simulator.odometry(&stuck);
        assert!(samples.iter().all(|s| s.position == [0.0; 3]));
    }

    #[test]
    fn source_gives_the_odometry_samples_of_its_frames() {
        let mut source = simulator("static")
            .source()
            .with_odometry(&exactly())
            .between(20, None);
        assert!(source.take_odometry().is_empty());
        let frame = source.next_frame().unwrap().unwrap();
        let first = source.take_odometry();
        assert!(first[0].stamp >= frame.stamp - BEFORE - 1e-9);
        source.next_frame().unwrap().unwrap();
        let next = source.take_odometry();
        assert!(first.last().unwrap().stamp >= frame.stamp);
        assert!((1..=2).contains(&next.len()) && source.take_inertial().is_empty());
    }
}
