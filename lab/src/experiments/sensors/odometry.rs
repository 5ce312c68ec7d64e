//! Scenes with and without wheel odometry, correct and faulty.

use super::{Run, Score, Sensor, ate};
use crate::Failure;
use stillpoint::geometry::Vec3;
use stillpoint::imaging::{FrameSource, OdometryTrack, Simd};
use stillpoint::simulator::{SimulatedOdometry, Simulator, WheelSlip};
use stillpoint::slam::{Config, Stages, System};

#[derive(Clone, Copy, PartialEq)]
pub(crate) enum Odometry {
    Without,
    With,
    /// With a camera mounted at 90 degrees to the stated orientation.
    Turned,
    /// Always reports standstill.
    Stuck,
    /// Jumps by 0.2 m and 0.2 rad.
    Wild,
    /// Wheels spin at 0.5 m/s for half of every second.
    Slipping,
}

impl Odometry {
    fn wheels(self) -> SimulatedOdometry {
        let right = SimulatedOdometry::default();
        match self {
            Self::Without | Self::With | Self::Turned => right,
            Self::Stuck => SimulatedOdometry {
                stuck: true,
                ..right
            },
            Self::Wild => SimulatedOdometry {
                jitter: [0.2, 0.2],
                ..right
            },
            Self::Slipping => SimulatedOdometry {
                slips: (1..10).map(spin).collect(),
                ..right
            },
        }
    }

    fn system(self, simulator: &Simulator, seed: u64) -> Result<System, Failure> {
        let config = Config {
            seed,
            ..Config::default()
        };
        let stages = Stages::new(config, *simulator.camera(), Simd::detect())?;
        let model = self.wheels().model;
        let quarter = Vec3::new(0.0, 0.0, std::f64::consts::FRAC_PI_2);
        let stages = match self {
            Self::Without => stages,
            Self::Turned => stages.with_odometry(model.turned(quarter))?,
            _ => stages.with_odometry(model)?,
        };
        Ok(System::from(stages))
    }
}

fn spin(second: u32) -> WheelSlip {
    let from = 2.0 * f64::from(second) - 0.5;
    WheelSlip {
        from,
        to: from + 0.5,
        speed: 0.5,
    }
}

impl Sensor for Odometry {
    const SCENES: &'static [&'static str] = &[
        "crowd_xyz",
        "crowd_static",
        "crowd_halfsphere",
        "xyz",
        "halfsphere",
        "walking_xyz",
        "walking_halfsphere",
        "blocked_turn",
        "blocked_walk",
    ];
    const ALL: &'static [Self] = &[
        Self::Without,
        Self::With,
        Self::Turned,
        Self::Stuck,
        Self::Wild,
        Self::Slipping,
    ];

    fn name(self) -> &'static str {
        match self {
            Self::Without => "without",
            Self::With => "with",
            Self::Turned => "mounted wrongly",
            Self::Stuck => "stuck",
            Self::Wild => "wild",
            Self::Slipping => "slipping",
        }
    }

    fn measure(simulator: Simulator, seed: u64) -> Result<Vec<Score>, Failure> {
        let truth = simulator.ground_truth();
        let mut runs = Vec::new();
        for contestant in Self::ALL {
            let samples = simulator.odometry(&contestant.wheels());
            let run = Run::from(contestant.system(&simulator, seed)?);
            runs.push((run, OdometryTrack::new(samples.into())));
        }
        let mut source = simulator.source();
        while let Some(frame) = source.next_frame() {
            let frame = frame?;
            for (run, track) in &mut runs {
                let samples = track.take_until(frame.stamp);
                run.system.receive_odometry(samples);
                run.step(frame.clone());
            }
        }
        let scores = runs.into_iter().map(|(run, _)| {
            let end = run.online.last().map_or(0.0, |o| o.0);
            run.score(&truth, end)
        });
        Ok(scores.collect())
    }

    fn holds(self, scene: &str, runs: &[&Score], without: &[&Score]) -> Option<bool> {
        let ([median, _, worst], [plain, _, plain_worst]) = (ate(runs), ate(without));
        let right = self == Self::With;
        let holds = match scene {
            _ if self == Self::Without => return None,
            // Three seconds without vision: 3 % of the path, and a degree.
            _ if scene.starts_with("blocked") && right => runs
                .iter()
                .all(|s| s.lost == 0 && s.end[0] <= 0.05 && s.end[1] <= 1.5),
            _ if scene.starts_with("blocked") => true,
            _ if scene.starts_with("crowd") => worst <= plain_worst.max(5.0),
            _ if right => median <= 1.01 * plain,
            // Allowed cost of faulty odometry where the map suffices.
            _ => median <= 1.05 * plain,
        };
        Some(holds)
    }
}
