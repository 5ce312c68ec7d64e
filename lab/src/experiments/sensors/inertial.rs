//! What an inertial sensor is worth: simulated scenes with and without a BMI055, against exact poses.
//!
//! `cargo run --release -p stillpoint --example inertial -- SEEDS FRAMES [SCENE ...]`: a row per scene and contestant, with the median and the worst of the
//! seeds; 0 frames for the scene's own length. No detector. The exit code is 1 where a bar is missed.
#![allow(clippy::print_stdout)]

use std::process::ExitCode;
use stillpoint::evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint::geometry::{Se3, Vec3};
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::simulator::{SimulatedImu, Simulator, SimulatorConfig};
use stillpoint::slam::{Config, Event, Outcome, Stages, System};

type Failure = Box<dyn std::error::Error>;

/// Starts in crowds, then scenes in which nobody is, then a view that is blocked.
const SCENES: [&str; 9] = [
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

/// What is run over each scene.
#[derive(Clone, Copy, PartialEq, Eq, Debug)]
enum Contestant {
    /// Without the sensor.
    Without,
    /// With it.
    With,
    /// With one that is mounted by 90 degrees otherwise than the calibration says.
    Turned,
}

const CONTESTANTS: [Contestant; 3] = [Contestant::Without, Contestant::With, Contestant::Turned];

impl Contestant {
    fn name(self) -> &'static str {
        match self {
            Self::Without => "without",
            Self::With => "with",
            Self::Turned => "mounted wrongly",
        }
    }

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

/// What became of a run.
#[derive(Default)]
struct Score {
    /// ATE of the final poses, mm.
    ate: f64,
    lost: usize,
    carried: usize,
    /// Error of the direction in the last second, relative to the first frame, deg.
    turn: f64,
    /// What was said of the sensor at last.
    said: String,
}

struct Run {
    system: System,
    score: Score,
    online: Vec<(f64, Se3)>,
}

fn run(scene: &str, seed: u64, frames: usize) -> Result<Vec<Score>, Failure> {
    let simulator = Simulator::new(&SimulatorConfig {
        scene: scene.to_owned(),
        seed,
        frames: (frames > 0).then_some(frames),
        ..SimulatorConfig::default()
    })?;
    let imu = SimulatedImu::default();
    let truth = simulator.ground_truth();
    let mut runs = Vec::new();
    for contestant in CONTESTANTS {
        runs.push(Run {
            system: contestant.system(&simulator, &imu, seed)?,
            score: Score::default(),
            online: Vec::new(),
        });
    }
    let mut source = simulator.source().with_imu(&imu);
    while let Some(frame) = source.next_frame() {
        let frame = frame?;
        let samples = source.take_inertial();
        for run in &mut runs {
            run.system.receive_inertial(samples.clone());
            let events = run.system.step(frame.clone());
            run.take(&events);
        }
    }
    Ok(runs.into_iter().map(|r| r.finish(&truth)).collect())
}

impl Run {
    fn take(&mut self, events: &[Event]) {
        for event in events {
            let Event::Frame(done) = event else { continue };
            let report = &done.report;
            if std::env::var_os("VERBOSE").is_some() {
                println!(
                    "{} {:?} inliers {} moving {:.2}",
                    report.frame,
                    report.outcome,
                    report.counts.inliers,
                    report.counts.moving_share()
                );
            }
            self.score.lost += usize::from(matches!(report.outcome, Outcome::Lost { .. }));
            self.score.carried += usize::from(matches!(report.outcome, Outcome::Carried { .. }));
            self.online
                .extend(report.world_from_camera.map(|p| (report.stamp, p)));
            if let Some(said) = &report.inertial {
                self.score.said = said.state.to_string();
            }
        }
    }

    fn finish(mut self, truth: &[(f64, Se3)]) -> Score {
        self.system.finish();
        let timed = |(stamp, world_from_camera): (f64, Se3)| TimedPose {
            stamp,
            world_from_camera,
        };
        let poses: Vec<(f64, Se3)> = self
            .system
            .corrected_trajectory()
            .into_iter()
            .map(|(e, p)| (e.stamp, p))
            .collect();
        self.score.turn = turn_error(&self.online, truth);
        let found: Vec<TimedPose> = poses.into_iter().map(timed).collect();
        let exact: Vec<TimedPose> = truth.iter().copied().map(timed).collect();
        let done = evaluate(&exact, &found, &EvalOptions::default());
        self.score.ate = done.map_or(f64::INFINITY, |d| 1e3 * d.ate.statistics.rmse);
        self.score
    }
}

/// The greatest error of the direction in the last second, as known at each frame, relative to the first frame, deg.
fn turn_error(online: &[(f64, Se3)], truth: &[(f64, Se3)]) -> f64 {
    let exact = |stamp: f64| truth.iter().find(|t| t.0 == stamp).map(|t| t.1);
    let Some((first, last)) = online.first().zip(truth.last()) else {
        return f64::INFINITY;
    };
    let Some(begin) = exact(first.0) else {
        return f64::INFINITY;
    };
    let late = online.iter().filter(|o| o.0 > last.0 - 1.0);
    let errors = late.filter_map(|(stamp, pose)| {
        let found = first.1.inverse() * *pose;
        let exact = begin.inverse() * exact(*stamp)?;
        Some(found.rotation.angle_to(&exact.rotation).to_degrees())
    });
    errors.fold(0.0, f64::max)
}

/// Median and greatest.
fn spread(values: impl Iterator<Item = f64>) -> [f64; 2] {
    let mut sorted: Vec<f64> = values.collect();
    sorted.sort_by(f64::total_cmp);
    let at = |i: usize| sorted.get(i).copied().unwrap_or(f64::NAN);
    [at(sorted.len() / 2), at(sorted.len().max(1) - 1)]
}

/// Whether the runs with the sensor meet the bar of their scene, against those without it.
fn holds(scene: &str, with: &[&Score], without: &[&Score]) -> bool {
    let ate = |s: &[&Score]| spread(s.iter().map(|s| s.ate));
    let ([median, worst], [plain, plain_worst]) = (ate(with), ate(without));
    if scene == "blocked_turn" {
        return with.iter().all(|s| s.lost == 0 && s.turn <= 0.5);
    }
    if scene.starts_with("crowd") {
        return worst <= 0.5 * plain_worst || worst <= 5.0;
    }
    median <= 1.01 * plain
}

fn main() -> Result<ExitCode, Failure> {
    let words: Vec<String> = std::env::args().skip(1).collect();
    let seeds: u64 = words.first().map_or(Ok(10), |w| w.parse())?;
    let frames: usize = words.get(1).map_or(Ok(100), |w| w.parse())?;
    let named: Vec<&str> = words.iter().skip(2).map(String::as_str).collect();
    let scenes = if named.is_empty() {
        &SCENES[..]
    } else {
        &named
    };
    println!(
        "| scene | sensor | ATE, mm: median | worst | lost | carried | direction at the end, deg | it is | |"
    );
    println!("|---|---|---:|---:|---:|---:|---:|---|---|");
    let mut all = true;
    for scene in scenes {
        let frames = if *scene == "blocked_turn" { 0 } else { frames };
        let runs: Result<Vec<Vec<Score>>, Failure> =
            (0..seeds).map(|seed| run(scene, seed, frames)).collect();
        let runs = runs?;
        let of = |k: usize| runs.iter().map(|r| &r[k]).collect::<Vec<&Score>>();
        for (k, contestant) in CONTESTANTS.into_iter().enumerate() {
            let scores = of(k);
            let [median, worst] = spread(scores.iter().map(|s| s.ate));
            let sum = |f: fn(&Score) -> usize| scores.iter().map(|s| f(s)).sum::<usize>();
            let [_, turn] = spread(scores.iter().map(|s| s.turn));
            let mut said: Vec<&str> = scores.iter().map(|s| s.said.as_str()).collect();
            said.sort_unstable();
            said.dedup();
            let verdict = match contestant {
                Contestant::With => {
                    let met = holds(scene, &scores, &of(0));
                    all &= met;
                    if met { "met" } else { "short" }
                }
                _ => "",
            };
            println!(
                "| `{scene}` | {} | {median:.2} | {worst:.2} | {} | {} | {turn:.2} | {} | {verdict} |",
                contestant.name(),
                sum(|s| s.lost),
                sum(|s| s.carried),
                said.join(" / "),
            );
        }
    }
    Ok(if all {
        ExitCode::SUCCESS
    } else {
        ExitCode::FAILURE
    })
}
