//! Figures of a run: from trajectories of any system, and from Stillpoint's result folder.

use crate::Failure;
use crate::results::{Figures, Live, Time};
use serde::Deserialize;
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use stillpoint::datasets::trajectory;
use stillpoint::evaluation::{EvalOptions, Score, TimedPose, score};

/// Error above which a confident pose counts as wrong, m, as for starts in a crowd (docs/starts.md): ten times the usual error there, and
/// far below a person's distance.
pub(crate) const WRONG: f64 = 0.1;

#[derive(Debug, Deserialize)]
struct Summary {
    frames: usize,
    interrupted: bool,
    timing_ms: Vec<StageTime>,
    peak_memory_bytes: Option<u64>,
    live: Option<OfLive>,
}

#[derive(Debug, Deserialize)]
struct OfLive {
    dropped_share: f64,
    latency_ms: Time,
    detections_per_second: f64,
    detections_age_ms: Mean,
}

#[derive(Debug, Deserialize)]
struct Mean {
    mean: f64,
}

#[derive(Debug, Deserialize)]
struct StageTime {
    stage: String,
    #[serde(flatten)]
    time: Time,
}

/// States with uncertain poses: the motion hypothesis is undecided, or other sensors carry the pose.
const UNCERTAIN: [&str; 3] = ["undecided", "carried", "lost"];

pub(crate) fn poses(path: &Path) -> Result<Vec<TimedPose>, Failure> {
    let timed = |p: stillpoint::datasets::StampedPose| TimedPose {
        stamp: p.stamp,
        world_from_camera: p.world_from_camera,
    };
    Ok(trajectory::read(path)?.into_iter().map(timed).collect())
}

/// A stamp as a key: files have six decimals.
fn micros(stamp: f64) -> i64 {
    (stamp * 1e6).round() as i64
}

pub(crate) fn result_folder(folder: &Path, truth: &[TimedPose]) -> Result<Figures, Failure> {
    let file = folder.join("summary.json");
    let wrong = |e: &dyn std::fmt::Display| {
        format!(
            "{}: expected the summary of a run, found: {e}",
            file.display()
        )
    };
    let text = std::fs::read_to_string(&file).map_err(|e| wrong(&e))?;
    let summary: Summary = serde_json::from_str(&text).map_err(|e| wrong(&e))?;
    if summary.interrupted {
        return Err("the run was interrupted".into());
    }
    let (undecided, uncertain) = states(&folder.join("frames.csv"))?;
    let last = poses(&folder.join("trajectory.txt"))?;
    let mut figures = of_poses(truth, &last, &uncertain, summary.frames);
    figures.undecided = Some(undecided);
    let online = poses(&folder.join("trajectory_online.txt"))?;
    figures.online_ate_mm = error(truth, &online).map(|(rmse, _)| 1e3 * rmse);
    let timing = summary.timing_ms.into_iter();
    figures.time_ms = timing.map(|t| (t.stage, t.time)).collect();
    figures.memory_bytes = summary.peak_memory_bytes;
    figures.live = summary.live.map(|l| Live {
        dropped_share: l.dropped_share,
        latency_ms: l.latency_ms,
        detections_per_second: l.detections_per_second,
        detections_age_ms: l.detections_age_ms.mean,
    });
    Ok(figures)
}

/// The number of undecided frames, and the stamps of uncertain poses.
fn states(file: &Path) -> Result<(usize, BTreeSet<i64>), Failure> {
    let text = std::fs::read_to_string(file)
        .map_err(|e| format!("{}: expected a line per frame, found: {e}", file.display()))?;
    let (mut undecided, mut uncertain) = (0, BTreeSet::new());
    for (i, line) in text.lines().enumerate().skip(1) {
        let mut cells = line.split(',').skip(1);
        let stamp = cells.next().and_then(|s| s.parse::<f64>().ok());
        let (Some(stamp), Some(state)) = (stamp, cells.next()) else {
            return Err(format!(
                "{}:{}: expected frame,stamp,state, found {line:?}",
                file.display(),
                i + 1
            )
            .into());
        };
        undecided += usize::from(state == "undecided");
        if UNCERTAIN.contains(&state) {
            uncertain.insert(micros(stamp));
        }
    }
    Ok((undecided, uncertain))
}

/// `uncertain` are the stamps of uncertain poses.
pub(crate) fn of_poses(
    truth: &[TimedPose],
    last: &[TimedPose],
    uncertain: &BTreeSet<i64>,
    frames: usize,
) -> Figures {
    let mut figures = Figures {
        frames,
        lost: frames.saturating_sub(last.len()),
        time_ms: BTreeMap::new(),
        ..Figures::default()
    };
    let Some((rmse, errors)) = error(truth, last) else {
        return figures;
    };
    let certain = |e: &&(f64, f64)| !uncertain.contains(&micros(e.0));
    let wrong = errors.iter().filter(certain).filter(|e| e.1 > WRONG);
    figures.wrong = wrong.count();
    figures.ate_mm = Some(1e3 * rmse);
    figures.worst_mm = errors.iter().map(|e| 1e3 * e.1).reduce(f64::max);
    match score(truth, last, &EvalOptions::default()) {
        Ok(Score::Moving(e)) => {
            figures.rpe_mm = e.rpe.as_ref().map(|r| 1e3 * r.translation.rmse);
            figures.rpe_deg = e.rpe.as_ref().map(|r| r.rotation_deg.rmse);
        }
        _ => figures.drift = true,
    }
    figures
}

/// RMSE, m, and errors by stamp: after alignment, or relative to the first pose if the camera stands still. `None` if too few poses have
/// ground truth.
fn error(truth: &[TimedPose], poses: &[TimedPose]) -> Option<(f64, Vec<(f64, f64)>)> {
    match score(truth, poses, &EvalOptions::default()).ok()? {
        Score::Moving(e) => {
            let errors = e.ate.pairs.iter().map(|p| (p.stamp, p.error)).collect();
            Some((e.ate.statistics.rmse, errors))
        }
        Score::Fixed(d) => {
            let at = |p: &TimedPose| p.world_from_camera.translation;
            let first = at(poses.first()?);
            let from = |p: &TimedPose| (p.stamp, (at(p) - first).norm());
            Some((d.drift.rmse, poses.iter().map(from).collect()))
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::geometry::{Se3, Vec3};

    /// A camera moving sideways by 0.1 m per frame; the estimate is off by `off(i)` upwards.
    fn path(n: usize, off: impl Fn(usize) -> f64) -> Vec<TimedPose> {
        let pose = |i: usize| {
            let world_from_camera = Se3 {
                translation: Vec3::new(0.1 * i as f64, off(i), 0.05 * (i * i % 7) as f64),
                ..Se3::default()
            };
            TimedPose {
                stamp: i as f64 / 10.0,
                world_from_camera,
            }
        };
        (0..n).map(pose).collect()
    }

    #[test]
    fn wrong_frames_count_unless_marked_uncertain() {
        let truth = path(40, |_| 0.0);
        let off = path(40, |i| if (18..22).contains(&i) { 0.3 } else { 0.0 });
        let none = BTreeSet::new();
        let figures = of_poses(&truth, &off, &none, 42);
        assert_eq!((figures.wrong, figures.lost, figures.frames), (4, 2, 42));
        assert!(figures.worst_mm.unwrap() > 200.0 && figures.ate_mm.unwrap() > 50.0);
        assert!(figures.rpe_mm.is_some() && !figures.drift);
        let said = BTreeSet::from([micros(1.8), micros(1.9)]);
        assert_eq!(of_poses(&truth, &off, &said, 40).wrong, 2);
        assert_eq!(of_poses(&truth, &truth, &none, 40).wrong, 0);
        let few = of_poses(&truth, &off[..2], &none, 40);
        assert_eq!((few.ate_mm, few.lost), (None, 38));
    }

    #[test]
    fn frame_states_are_read_by_column_name() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("frames.csv");
        let head = "frame,stamp,state,submap\n";
        let text = "0,0.000000,undecided,0\n1,0.1,tracked,0\n2,0.2,lost,\n3,0.3,carried,\n";
        std::fs::write(&file, head.to_owned() + text).unwrap();
        let (undecided, uncertain) = states(&file).unwrap();
        assert_eq!(undecided, 1);
        assert_eq!(uncertain, BTreeSet::from([0, 200_000, 300_000]));
        std::fs::write(&file, head.to_owned() + "0;1\n").unwrap();
        let e = states(&file).unwrap_err().to_string();
        assert!(e.contains("frames.csv:2: expected"), "{e}");
    }
}
