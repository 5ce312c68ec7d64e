//! Calibration of pose covariances: the share of 90 % intervals that contain the true value.
//!
//! A row per input. Single poses are those of `trajectory.txt`, aligned as evo does, with the covariance relative to the map's origin; the
//! control leaves out the map's uncertainty. Motions are over one second. Poses known at each frame have the covariance for an EKF. The
//! exit code is 1 if the coverage of positions is outside its bounds.

use crate::Failure;
use crate::experiments::shared::{code, next_readable, scene, timed, truth};
use crate::inputs::{self, Input};
use crate::table::{self, Align, Table, figure};
use std::collections::BTreeMap;
use std::process::ExitCode;
use stillpoint::datasets::FrameOptions;
use stillpoint::evaluation::{Coverage, TimedPose, coverage, motion_coverage};
use stillpoint::geometry::{Camera, Mat6, Se3};
use stillpoint::imaging::{RgbdFrame, Simd};
use stillpoint::recordings::{OpenOptions, open};
use stillpoint::slam::{
    Config, CovarianceLog, Event, FrameState, PoseCovariance, System, TrajectoryEntry,
    covariance_of_motion,
};

/// Accepted coverage of 90 % intervals.
const BAR: std::ops::RangeInclusive<f64> = 0.85..=0.95;
/// Duration of motions, s: that of the field's relative pose errors (Sturm et al. 2012).
const SECONDS: f64 = 1.0;
/// The inputs of `docs/health.md`: recordings, and scenes with their seed.
const INPUTS: [&str; 13] = [
    "sim:xyz@1",
    "sim:rpy@1",
    "sim:halfsphere@1",
    "sim:walking_xyz@1",
    "sim:walking_static@1",
    "sim:loop_two_rooms@1",
    "fr1_xyz",
    "fr1_xyz_walkers",
    "fr1_rpy_walkers",
    "corridor_fixed",
    "lab_fixed",
    "tartanair_office",
    "kitchen",
];

/// Measures the calibration of pose covariances: the share of 90 % intervals that contain the true value
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Scenes (sim:SCENE@SEED), names below the data folder, or paths
    #[arg(default_values = INPUTS)]
    inputs: Vec<String>,
    /// Maximum number of frames per run [default: all]
    #[arg(long)]
    frames: Option<usize>,
}

struct Passage {
    system: System,
    log: CovarianceLog,
    online: Vec<(TimedPose, Mat6)>,
}

impl Passage {
    fn new(camera: Camera) -> Result<Self, Failure> {
        Ok(Self {
            system: System::new(Config::default(), camera, Simd::detect())?,
            log: CovarianceLog::default(),
            online: Vec::new(),
        })
    }

    fn step(&mut self, frame: RgbdFrame) {
        let events = self.system.step(frame);
        for done in events.iter().filter_map(Event::as_frame) {
            let health = &done.health;
            let known = health.covariance.zip(health.covariance_in_map);
            let Some(((covariance, in_map), pose)) = known.zip(done.report.world_from_camera)
            else {
                continue;
            };
            self.log.note(health.frame, &in_map);
            self.online.push((timed((health.stamp, pose)), covariance));
        }
    }

    fn score(mut self, truth: &[TimedPose]) -> Option<Row> {
        self.system.finish();
        let view = self.system.view();
        let poses = largest(self.system.corrected_trajectory(), &|id| view.submap_of(id));
        let covariances = self.log.of(&poses, &view)?;
        let last: Vec<TimedPose> = poses.iter().map(|(e, p)| timed((e.stamp, *p))).collect();
        let of = |which: fn(&PoseCovariance) -> Mat6| -> Vec<Mat6> {
            covariances.iter().map(which).collect()
        };
        let motion = |i: usize, j: usize, by: &Se3| {
            let (a, b) = (&covariances[i].in_map, &covariances[j].in_map);
            covariance_of_motion(a, b, by, last[j].stamp - last[i].stamp)
        };
        let (online, known): (Vec<TimedPose>, Vec<Mat6>) = self.online.into_iter().unzip();
        Some(Row {
            single: coverage(truth, &last, &of(|c| c.from_origin))?,
            control: coverage(truth, &last, &of(|c| c.in_map))?,
            motion: motion_coverage(truth, &last, SECONDS, motion)?,
            online: coverage(truth, &online, &known)?,
        })
    }
}

/// The poses with enough inliers, of the submap with most of them.
fn largest<I: Copy + Ord>(
    poses: Vec<(TrajectoryEntry, Se3)>,
    submap_of: &dyn Fn(stillpoint::map::KeyframeId) -> Option<I>,
) -> Vec<(TrajectoryEntry, Se3)> {
    let mut by_submap: BTreeMap<Option<I>, Vec<(TrajectoryEntry, Se3)>> = BTreeMap::new();
    for (entry, pose) in poses {
        if entry.carried || entry.inliers >= FrameState::MIN_INLIERS {
            let submap = submap_of(entry.pose.reference);
            by_submap.entry(submap).or_default().push((entry, pose));
        }
    }
    by_submap
        .into_values()
        .max_by_key(Vec::len)
        .unwrap_or_default()
}

struct Row {
    single: Coverage,
    control: Coverage,
    motion: Coverage,
    online: Coverage,
}

fn measure(input: &Input, frames: Option<usize>) -> Result<Row, Failure> {
    let none = || {
        format!("{input}: expected poses with covariances and ground truth over more than a second")
    };
    match input {
        Input::Scene { scene: name, seed } => {
            let simulator = scene(name, seed.unwrap_or(0), frames)?;
            let mut passage = Passage::new(*simulator.camera())?;
            (0..simulator.len()).for_each(|i| passage.step(simulator.frame(i)));
            Ok(passage.score(&truth(&simulator)).ok_or_else(none)?)
        }
        Input::Folder { path, .. } => {
            let truth = inputs::truth(path)?.ok_or_else(none)?;
            let opened = open(path, &OpenOptions::default())?;
            let mut passage = Passage::new(opened.camera().camera)?;
            let mut source = opened.frames(&FrameOptions::default())?;
            let mut left = frames.unwrap_or(usize::MAX);
            while left > 0
                && let Some(frame) = next_readable(&mut source)?
            {
                passage.step(frame);
                left -= 1;
            }
            Ok(passage.score(&truth).ok_or_else(none)?)
        }
    }
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut table = Table::new([
        "input",
        "poses",
        "places",
        "error / sigma",
        "control",
        "directions",
        "motions of 1 s",
        "their turns",
        "online",
        "places and motions",
    ])
    .align(9, Align::Left);
    let mut all_met = true;
    for input in inputs::parse(&arguments.inputs)? {
        let row = measure(&input, arguments.frames)?;
        let said = |share: f64| match share {
            s if BAR.contains(&s) => "met",
            s if s < *BAR.start() => "too tight",
            _ => "too wide",
        };
        let verdicts = [row.single.place, row.motion.place].map(said);
        all_met &= verdicts == ["met"; 2];
        let share = |of: f64| figure(of, 2);
        table.row([
            input.to_string(),
            row.single.count.to_string(),
            share(row.single.place),
            share(row.single.place_ratio),
            share(row.control.place),
            share(row.single.direction),
            share(row.motion.place),
            share(row.motion.direction),
            share(row.online.place),
            verdicts.join(", "),
        ]);
    }
    table::print(&table);
    Ok(code(all_met))
}
