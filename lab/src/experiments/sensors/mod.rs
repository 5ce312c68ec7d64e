//! Benefit of further sensors: simulated scenes with and without them, without a detector.
//!
//! A row per scene and variant, with the median and the worst of the seeds. The exit code is 1 if a bound is missed.

mod inertial;
mod odometry;

pub(crate) use inertial::Inertial;
pub(crate) use odometry::Odometry;

use crate::Failure;
use crate::experiments::shared::{
    ate_mm, code, each_seed, final_poses, lost, scene, timed, verdict,
};
use crate::table::{self, Align, Table, figure, spread};
use std::process::ExitCode;
use stillpoint::evaluation::TimedPose;
use stillpoint::geometry::Se3;
use stillpoint::imaging::RgbdFrame;
use stillpoint::simulator::Simulator;
use stillpoint::slam::{Outcome, System};

/// Simulated scenes with and without the sensor: starts in crowds, rooms without people, blocked views
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Seeds per scene
    #[arg(long, default_value_t = 4)]
    seeds: u64,
    /// Frames per run; blocked views have their own length
    #[arg(long, default_value_t = 100)]
    frames: usize,
    /// Simulated scenes [default: all scenes of the sensor]
    scenes: Vec<String>,
}

/// A kind of sensor; its values are variants of a run.
pub(crate) trait Sensor: Copy + 'static {
    /// Starts in crowds, then scenes without people, then blocked views.
    const SCENES: &'static [&'static str];
    /// All variants; the first is without the sensor.
    const ALL: &'static [Self];

    fn name(self) -> &'static str;

    /// Runs all variants on a scene; its frames are rendered once.
    fn measure(simulator: Simulator, seed: u64) -> Result<Vec<Score>, Failure>;

    /// Whether runs meet their bound, relative to those without the sensor; `None` without a bound.
    fn holds(self, scene: &str, runs: &[&Score], without: &[&Score]) -> Option<bool>;
}

#[derive(Default)]
pub(crate) struct Score {
    /// ATE of the final poses, mm.
    ate: f64,
    lost: usize,
    carried: usize,
    /// Errors of the pose in the last second, relative to the first frame: m and deg.
    end: [f64; 2],
    /// Final state of the sensor.
    said: String,
    slips: u32,
}

struct Run {
    system: System,
    score: Score,
    online: Vec<(f64, Se3)>,
}

impl From<System> for Run {
    fn from(system: System) -> Self {
        Self {
            system,
            score: Score::default(),
            online: Vec::new(),
        }
    }
}

impl Run {
    fn step(&mut self, frame: RgbdFrame) {
        let events = self.system.step(frame);
        self.score.lost += lost(&events);
        for report in events.iter().filter_map(|e| Some(&e.as_frame()?.report)) {
            self.score.carried += usize::from(matches!(report.outcome, Outcome::Carried { .. }));
            let pose = report.world_from_camera.map(|p| (report.stamp, p));
            self.online.extend(pose);
            if let Some(said) = &report.inertial {
                self.score.said = said.state.to_string();
            }
            if let Some(said) = &report.odometry {
                self.score.said = said.state.to_string();
                self.score.slips = said.slips;
            }
        }
    }

    /// `end`: end of the last second, s.
    fn score(mut self, truth: &[(f64, Se3)], end: f64) -> Score {
        self.system.finish();
        let exact: Vec<TimedPose> = truth.iter().copied().map(timed).collect();
        let ate = ate_mm(&exact, &final_poses(&self.system));
        self.score.ate = ate.unwrap_or(f64::INFINITY);
        self.score.end = end_error(&self.online, truth, end - 1.0);
        self.score
    }
}

/// Maximum error of online poses after a time, s, relative to the first frame: m and deg.
fn end_error(online: &[(f64, Se3)], truth: &[(f64, Se3)], after: f64) -> [f64; 2] {
    let exact = |stamp: f64| truth.iter().find(|t| t.0 == stamp).map(|t| t.1);
    let first = online.first().map(|first| (first.1, exact(first.0)));
    let Some((first, Some(begin))) = first else {
        return [f64::INFINITY; 2];
    };
    let late = online.iter().filter(|o| o.0 > after);
    let errors = late.filter_map(|(stamp, pose)| {
        let found = first.inverse() * *pose;
        let off = found.inverse() * (begin.inverse() * exact(*stamp)?);
        Some([off.translation.norm(), off.rotation.angle().to_degrees()])
    });
    errors.fold([0.0; 2], |a, b| [a[0].max(b[0]), a[1].max(b[1])])
}

/// ATE of runs, mm: median, minimum, maximum.
fn ate(runs: &[&Score]) -> [f64; 3] {
    spread(runs.iter().map(|s| s.ate))
}

fn add(table: &mut Table, scene: &str, name: &str, runs: &[&Score], holds: Option<bool>) {
    let sum = |f: fn(&Score) -> usize| runs.iter().map(|s| f(s)).sum::<usize>().to_string();
    let end = [0, 1].map(|k| spread(runs.iter().map(|s| s.end[k]))[2]);
    let [median, _, worst] = ate(runs);
    let mut said: Vec<&str> = runs.iter().map(|s| s.said.as_str()).collect();
    said.sort_unstable();
    said.dedup();
    table.row([
        format!("`{scene}`"),
        name.to_owned(),
        figure(median, 2),
        figure(worst, 2),
        sum(|s| s.lost),
        sum(|s| s.carried),
        figure(1e3 * end[0], 1),
        figure(end[1], 2),
        sum(|s| s.slips as usize),
        said.join(" / "),
        holds.map_or("", verdict).to_owned(),
    ]);
}

pub(crate) fn run<S: Sensor>(arguments: &Arguments) -> Result<ExitCode, Failure> {
    println!("{} seeds, {} frames\n", arguments.seeds, arguments.frames);
    let header = "scene | sensor | ATE, mm: median | worst | lost | carried | at the end: mm | deg | slips seen | it is | ".split(" | ");
    let left = [1, 9, 10].into_iter();
    let mut table = left.fold(Table::new(header), |t, column| t.align(column, Align::Left));
    let named: Vec<&str> = arguments.scenes.iter().map(String::as_str).collect();
    let scenes = if named.is_empty() {
        S::SCENES
    } else {
        &named[..]
    };
    let mut all = true;
    for name in scenes {
        let frames = (!name.starts_with("blocked")).then_some(arguments.frames);
        let measure = |seed| S::measure(scene(name, seed, frames)?, seed);
        let runs = each_seed(arguments.seeds, measure)?;
        let of = |k: usize| runs.iter().map(|r| &r[k]).collect::<Vec<&Score>>();
        for (k, way) in S::ALL.iter().enumerate() {
            let holds = way.holds(name, &of(k), &of(0));
            add(&mut table, name, way.name(), &of(k), holds);
            all &= holds != Some(false);
        }
    }
    table::print(&table);
    Ok(code(all))
}
