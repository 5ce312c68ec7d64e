//! Data of a run's report: from the session that just ended, or from a result folder.

use crate::dense::Fused;
use crate::failure::Failure;
use crate::run::session::Session;
use crate::run::setup::Setup;
use crate::sink::Found;
use crate::sinks::view::surface;
use serde_json::Value;
use std::path::Path;
use stillpoint::datasets::{StampedPose, read_regular, trajectory};
use stillpoint::evaluation::{PairError, Score};
use stillpoint::geometry::{Se3, Vec3};
use stillpoint::map::SubmapId;
use stillpoint::view::report::{FrameRow, FrameState, ReportRecorder, RunData, from_html};

/// Tolerance for matching stamps of `frames.csv` and `trajectory.txt`, s.
const STAMP: f64 = 2e-6;
const LARGEST: u64 = 1 << 30;

/// From a session that ended.
pub(crate) fn of_session(
    setup: &Setup<'_>,
    (session, found): (&Session, &Found),
    summary: &str,
    score: Option<&Score>,
    recorder: &ReportRecorder,
) -> RunData {
    let mut run = RunData {
        name: name(&setup.input.name),
        // Parsed from the text of `summary.json`, so that both agree to the last digit.
        summary: serde_json::from_str(summary).unwrap_or(Value::Null),
        config: setup.config_text.clone(),
        command: setup.command.clone(),
        ..RunData::default()
    };
    let mut rows = rows(&session.frames_csv, &session.poses.final_poses);
    let times = match &session.live {
        Some(live) => {
            run.time_is = "latency".to_owned();
            live.latency_ms.clone()
        }
        None => {
            run.time_is = "time per frame".to_owned();
            setup.timing.per_frame("total")
        }
    };
    // There is one time per tracked frame; with another count they cannot be assigned.
    if times.len() == rows.len() {
        for (row, ms) in rows.iter_mut().zip(times) {
            row.time_ms = Some(ms).filter(|ms| ms.is_finite());
        }
    }
    if let Some(live) = &session.live {
        for (frame, ms) in &live.answer_ms {
            if let Ok(i) = rows.binary_search_by_key(&frame.0, |r| r.id) {
                rows[i].answer_ms = Some(*ms);
            }
        }
    }
    if let Some(score) = score {
        set_errors(&mut rows, score);
    }
    run.set_frames(&rows);
    let submap = session.tracking.submaps.first().map(|s| SubmapId(s.id));
    run.set_map(&session.view, submap);
    if let Some(fused) = found.shelf.get::<Fused>() {
        run.surface = surface(&fused.mesh);
    }
    run.set_recorded(recorder);
    run.judge();
    run
}

/// From a result folder: the data in its report if there is one, else its files, without map and images.
pub(crate) fn of_folder(folder: &Path) -> Result<RunData, Failure> {
    let text = |name: &str| -> Result<String, Failure> {
        let path = folder.join(name);
        let bytes = read_regular(&path, LARGEST).map_err(|e| {
            Failure::input(format!(
                "{}: expected a file of a result folder, found: {e}; name a folder that run, replay or demo wrote",
                path.display()
            ))
        })?;
        Ok(String::from_utf8_lossy(&bytes).into_owned())
    };
    let summary: Value = serde_json::from_str(&text("summary.json")?).map_err(|e| {
        Failure::input(format!(
            "{}: expected the figures of a run, found: {e}; name a folder that run, replay or demo wrote",
            folder.join("summary.json").display()
        ))
    })?;
    let page = folder.join("report.html");
    let mut run = if page.exists() {
        let failure =
            |e: &dyn std::fmt::Display| Failure::input(format!("{}: {e}", page.display()));
        let bytes = read_regular(&page, LARGEST).map_err(|e| failure(&e))?;
        let runs = from_html(&String::from_utf8_lossy(&bytes)).map_err(|e| failure(&e))?;
        match <[RunData; 1]>::try_from(runs) {
            Ok([run]) => run,
            Err(runs) => {
                return Err(failure(&format!(
                    "expected the report of one run, found {}; remove it, and it is made again from the other files",
                    runs.len()
                )));
            }
        }
    } else {
        let poses = trajectory::read(&folder.join("trajectory.txt"))?;
        let mut run = RunData::default();
        run.set_frames(&rows(&text("frames.csv")?, &poses));
        run
    };
    let input = summary.pointer("/input/name").and_then(Value::as_str);
    run.name = name(input.unwrap_or("run"));
    run.summary = summary;
    run.config = text("config.toml")?;
    run.judge();
    Ok(run)
}

/// The run's name: the last part of its input path.
pub(crate) fn name(input: &str) -> String {
    let last = Path::new(input).file_name();
    last.map_or_else(|| input.to_owned(), |n| n.to_string_lossy().into_owned())
}

fn rows(frames_csv: &str, poses: &[StampedPose]) -> Vec<FrameRow> {
    let pose_at = |stamp: f64| -> Option<Se3> {
        let i = poses.partition_point(|p| p.stamp < stamp - STAMP);
        let found = poses.get(i).filter(|p| p.stamp <= stamp + STAMP);
        found.map(|p| p.world_from_camera)
    };
    let lines = frames_csv.lines().skip(1);
    let row = |line: &str| -> Option<FrameRow> {
        let mut cells = line.splitn(8, ',');
        let mut next = || cells.next();
        let (id, stamp, state) = (next()?, next()?, next()?);
        let stamp = stamp.parse().ok()?;
        let state = FrameState::from_name(state)?;
        let (_, _) = (next(), next());
        let inliers = next()?.parse().ok()?;
        let _ = next();
        Some(FrameRow {
            id: id.parse().ok()?,
            stamp,
            state,
            inliers,
            reason: next().unwrap_or_default().to_owned(),
            pose: Some(state)
                .filter(|s| *s != FrameState::Lost)
                .and_then(|_| pose_at(stamp)),
            error: None,
            truth: None,
            time_ms: None,
            answer_ms: None,
        })
    };
    lines.filter_map(row).collect()
}

/// Sets errors and true positions, in the world of the run.
fn set_errors(rows: &mut [FrameRow], score: &Score) {
    match score {
        Score::Moving(evaluation) => {
            let ate = &evaluation.ate;
            for row in rows {
                let i = ate.pairs.partition_point(|p| p.stamp < row.stamp - STAMP);
                let pair: Option<&PairError> =
                    ate.pairs.get(i).filter(|p| p.stamp <= row.stamp + STAMP);
                row.error = pair.map(|p| p.error);
                row.truth = pair.map(|p| ate.alignment.invert(&p.reference));
            }
        }
        Score::Fixed(_) => {
            let first: Option<Vec3> = rows.iter().find_map(|r| Some(r.pose?.translation));
            for row in rows {
                row.error = row.pose.zip(first).map(|(p, f)| (p.translation - f).norm());
                row.truth = first.filter(|_| row.pose.is_some());
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frame_table_rows_are_joined_with_poses_by_stamp() {
        let csv = "frame,stamp,state,submap,final_submap,inliers,keyframe,reason\n\
            0,1.000000,initialised,0,0,200,1,\n\
            2,1.033333,lost,,,0,0,too few keypoints, really\n\
            3,1.066667,undecided,0,0,80,0,\n\
            4,1.100000,tracked,4,4,90,0,\n";
        let pose = |stamp: f64, x: f64| StampedPose {
            stamp,
            world_from_camera: Se3::new(Default::default(), Vec3::new(x, 0.0, 0.0)),
        };
        // The last frame is in another submap.
        let poses = [pose(1.0, 0.0), pose(1.066_666_7, 0.2)];
        let rows = rows(csv, &poses);
        let states = rows.iter().map(|r| (r.id, r.state, r.inliers));
        assert_eq!(
            states.collect::<Vec<_>>(),
            [
                (0, FrameState::Begun, 200),
                (2, FrameState::Lost, 0),
                (3, FrameState::Undecided, 80),
                (4, FrameState::Tracked, 90)
            ]
        );
        assert_eq!(rows[1].reason, "too few keypoints, really");
        let x = rows.iter().map(|r| r.pose.map(|p| p.translation.x));
        assert_eq!(x.collect::<Vec<_>>(), [Some(0.0), None, Some(0.2), None]);
    }

    #[test]
    fn run_name_is_the_last_path_component() {
        for (path, expected) in [("data/desk/", "desk"), ("sim:rpy", "sim:rpy"), ("/", "/")] {
            assert_eq!(name(path), expected);
        }
    }
}
