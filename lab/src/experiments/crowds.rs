//! Starts in a crowd: scenes that begin with people covering a quarter to half of the image.
//!
//! A row per scene and contestant, with the median and the worst of the seeds. The exit code is 1 if a bound is missed.

use crate::Failure;
use crate::experiments::shared::{
    ate_mm, code, each_seed, final_poses, scene, script, scripted, timed, truth, verdict,
};
use crate::table::{self, Align, Table, figure, spread};
use std::collections::BTreeSet;
use std::process::ExitCode;
use stillpoint::detection::ScriptRow;
use stillpoint::evaluation::{EvalOptions, TimedPose, evaluate};
use stillpoint::imaging::Simd;
use stillpoint::simulator::{DetectionNoise, Simulator};
use stillpoint::slam::{Config, Preset, System};

/// All scenes that begin in a crowd, one per camera path.
const SCENES: [&str; 7] = [
    "crowd_xyz",
    "crowd_static",
    "crowd_halfsphere",
    "crowd_rpy_60",
    "crowd_rpy_150",
    "crowd_coat",
    "crowd_pitch",
];
/// Error above which a confident pose counts as wrong, m.
const WRONG: f64 = 0.1;
/// Maximum by which final poses may be worse than online ones, mm: other refinement has errors of this size.
const WORSE: f64 = 3.0;

/// Evaluates starts in a crowd against exact poses, with a simulated detector and without
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Seeds per scene
    #[arg(long, default_value_t = 10)]
    seeds: u64,
    /// Frames per run
    #[arg(long, default_value_t = 150)]
    frames: usize,
    /// Simulated scenes
    #[arg(default_values = SCENES)]
    scenes: Vec<String>,
}

#[derive(Clone, Copy, PartialEq)]
enum Contestant {
    /// With the simulated detector.
    Detector,
    Alone,
    /// Control: without the static filter and its handling of starts among people.
    Unfiltered,
}

const CONTESTANTS: [Contestant; 3] = [
    Contestant::Detector,
    Contestant::Alone,
    Contestant::Unfiltered,
];

impl Contestant {
    fn name(self) -> &'static str {
        match self {
            Self::Detector => "with the detector",
            Self::Alone => "without",
            Self::Unfiltered => "control: filter off",
        }
    }

    /// Maximum error, mm, and minimum share of frames with a pose.
    fn bars(self, scene: &str) -> (f64, f64) {
        if scene.ends_with("coat") || scene.ends_with("pitch") {
            // The camera is slow, so no frame needs to be lost.
            return (if self == Self::Detector { 15.0 } else { 20.0 }, 1.0);
        }
        let fast = scene.ends_with("150");
        match self {
            Self::Detector => (if fast { 25.0 } else { 15.0 }, 0.97),
            _ => (if fast { 40.0 } else { 25.0 }, 0.93),
        }
    }

    fn system(
        self,
        simulator: &Simulator,
        seed: u64,
        script: &[ScriptRow],
    ) -> Result<System, Failure> {
        let mut config = Config {
            seed,
            ..Config::default()
        };
        if self == Self::Unfiltered {
            config.static_filter.preset = Preset::Off;
        }
        let system = System::new(config, *simulator.camera(), Simd::detect())?;
        Ok(if self == Self::Detector {
            system.with_detector(scripted(script)?)
        } else {
            system
        })
    }
}

struct Score {
    /// ATE of the final poses, mm.
    ate: f64,
    /// ATE of the poses known at each frame, mm.
    online: f64,
    poses: f64,
    /// Frames above [`WRONG`] that were neither undecided nor lost.
    wrong: usize,
}

/// Runs all contestants on a scene; its frames are rendered once.
fn measure(name: &str, seed: u64, frames: usize) -> Result<Vec<Score>, Failure> {
    let simulator = scene(name, seed, Some(frames))?;
    let noise = DetectionNoise {
        seed,
        ..DetectionNoise::default()
    };
    let script = script(&simulator, &noise)?;
    let mut runs = Vec::new();
    for contestant in CONTESTANTS {
        let system = contestant.system(&simulator, seed, &script)?;
        runs.push((system, Vec::new(), BTreeSet::new()));
    }
    for i in 0..simulator.len() {
        let frame = simulator.frame(i);
        for (system, online, undecided) in &mut runs {
            let events = system.step(frame.clone());
            for report in events.iter().filter_map(|e| Some(&e.as_frame()?.report)) {
                if report.is_undecided() {
                    undecided.insert(report.stamp.to_bits());
                }
                online.extend(report.world_from_camera.map(|p| timed((report.stamp, p))));
            }
        }
    }
    let truth = truth(&simulator);
    let scored = runs
        .into_iter()
        .map(|(system, online, undecided)| score(system, &online, &undecided, &truth));
    Ok(scored.collect())
}

fn score(
    mut system: System,
    online: &[TimedPose],
    undecided: &BTreeSet<u64>,
    truth: &[TimedPose],
) -> Score {
    system.finish();
    let poses = final_poses(&system);
    // Without enough poses there is no error, and the share of poses fails.
    let done = evaluate(truth, &poses, &EvalOptions::default()).ok();
    let wrong = done.iter().flat_map(|d| &d.ate.pairs);
    let wrong = wrong.filter(|p| p.error > WRONG && !undecided.contains(&p.stamp.to_bits()));
    Score {
        wrong: wrong.count(),
        ate: done.map_or(f64::INFINITY, |d| 1e3 * d.ate.statistics.rmse),
        online: ate_mm(truth, online).unwrap_or(f64::INFINITY),
        poses: poses.len() as f64 / truth.len() as f64,
    }
}

/// Returns whether the contestant's bounds hold.
fn add(table: &mut Table, scene: &str, contestant: Contestant, scores: &[&Score]) -> bool {
    let (bar, least) = contestant.bars(scene);
    let of = |f: fn(&Score) -> f64| spread(scores.iter().map(|s| f(s)));
    let [ate, _, worst] = of(|s| s.ate);
    let [online, _, worst_online] = of(|s| s.online);
    let [_, poses, _] = of(|s| s.poses);
    let [_, _, worse] = of(|s| s.ate - s.online);
    let wrong: usize = scores.iter().map(|s| s.wrong).sum();
    let holds = worst <= bar && poses >= least && wrong == 0 && worse <= WORSE;
    table.row([
        format!("`{scene}`"),
        contestant.name().to_owned(),
        figure(ate, 1),
        figure(worst, 1),
        figure(bar, 0),
        figure(poses, 3),
        wrong.to_string(),
        figure(online, 1),
        figure(worst_online, 1),
        format!("{worse:+.1}"),
        verdict(holds).to_owned(),
    ]);
    holds
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let (seeds, frames) = (arguments.seeds, arguments.frames);
    println!(
        "{seeds} seeds, {frames} frames; ATE in mm, of the final poses and of those known at each frame\n"
    );
    let mut table = Table::new("scene | run | median | worst | bar | least poses | wrong frames | at each frame: median | worst | final worse by | ".split(" | "))
    .align(1, Align::Left)
    .align(10, Align::Left);
    let mut holds = true;
    for scene in &arguments.scenes {
        let runs = each_seed(seeds, |seed| measure(scene, seed, frames))?;
        for (k, contestant) in CONTESTANTS.into_iter().enumerate() {
            let scores: Vec<&Score> = runs.iter().map(|scores| &scores[k]).collect();
            let met = add(&mut table, scene, contestant, &scores);
            // The control must fail.
            holds &= met != (contestant == Contestant::Unfiltered);
        }
    }
    table::print(&table);
    Ok(code(holds))
}
