//! Scenes with and without a BMI055.

use super::{Run, Score, Sensor, ate};
use crate::Failure;
use stillpoint::geometry::Vec3;
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::simulator::{SimulatedImu, Simulator};
use stillpoint::slam::{Config, Stages, System};

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Inertial {
    Without,
    With,
    /// Mounted at 90 degrees to the calibrated orientation.
    Turned,
}

impl Inertial {
    fn system(
        self,
        simulator: &Simulator,
        imu: &SimulatedImu,
        seed: u64,
    ) -> Result<System, Failure> {
        let config = Config {
            seed,
            ..Config::default()
        };
        let stages = Stages::new(config, *simulator.camera(), Simd::detect())?;
        let quarter = Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let stages = match self {
            Self::Without => stages,
            Self::With => stages.with_imu(imu.model)?,
            Self::Turned => stages.with_imu(imu.model.turned(quarter))?,
        };
        Ok(System::from(stages))
    }
}

impl Sensor for Inertial {
    const SCENES: &'static [&'static str] = &[
        "crowd_xyz",
        "crowd_static",
        "crowd_halfsphere",
        "crowd_rpy_60",
        "crowd_rpy_150",
        "xyz",
        "halfsphere",
        "rpy_60",
        "blocked_turn",
    ];
    const ALL: &'static [Self] = &[Self::Without, Self::With, Self::Turned];

    fn name(self) -> &'static str {
        match self {
            Self::Without => "without",
            Self::With => "with",
            Self::Turned => "mounted wrongly",
        }
    }

    fn measure(simulator: Simulator, seed: u64) -> Result<Vec<Score>, Failure> {
        let imu = SimulatedImu::default();
        let truth = simulator.ground_truth();
        let systems = Self::ALL.iter().map(|c| c.system(&simulator, &imu, seed));
        let mut runs: Vec<Run> = systems
            .map(|s| Ok(s?.into()))
            .collect::<Result<_, Failure>>()?;
        let mut source = simulator.source().with_imu(&imu);
        while let Some(frame) = source.next_frame() {
            let frame = frame?;
            let samples = source.take_inertial();
            for run in &mut runs {
                run.system.receive_inertial(samples.clone());
                run.step(frame.clone());
            }
        }
        let end = truth.last().map_or(0.0, |t| t.0);
        let scores = runs.into_iter().map(|run| run.score(&truth, end));
        Ok(scores.collect())
    }

    /// Only correctly mounted sensors have a bound, relative to the runs without one.
    fn holds(self, scene: &str, runs: &[&Score], without: &[&Score]) -> Option<bool> {
        let ([median, _, worst], [plain, _, plain_worst]) = (ate(runs), ate(without));
        if self != Self::With {
            return None;
        }
        Some(match scene {
            "blocked_turn" => runs.iter().all(|s| s.lost == 0 && s.end[1] <= 0.5),
            _ if scene.starts_with("crowd") => worst <= 0.5 * plain_worst || worst <= 5.0,
            _ => median <= 1.01 * plain,
        })
    }
}
