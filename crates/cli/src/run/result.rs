//! Writes and reports the result of a session, for `run`, `replay` and `demo`.

use crate::console::{self, counted};
use crate::dense::Fused;
use crate::eval::{offset, order};
use crate::failure::{Failure, Status};
use crate::machine::{Machine, peak_memory};
use crate::output::{ResultFolder, submap_file};
use crate::page::{self, data};
use crate::report;
use crate::run::covariances;
use crate::run::session::{Poses, Session};
use crate::run::setup::Setup;
use crate::run::summary::{
    Accuracy, KeptJson, LostStretch, MapJson, PaceJson, ScoreJson, StageTiming, StillJson,
    StillStretch, Summary,
};
use crate::sink::Found;
use crate::sinks::view::PageView;
use std::path::Path;
use stillpoint::datasets::{StampedPose, trajectory};
use stillpoint::evaluation::plot::{
    Figure, Series, drift_figure, poses_figure, timing_figure, trajectory_figure,
};
use stillpoint::evaluation::{EvalOptions, Score, TimedPose, score};
use stillpoint::view::report::to_html;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Voice {
    Words,
    /// JSON: stdout holds only the summary.
    Json,
}

impl Voice {
    pub(crate) fn of(json: bool) -> Self {
        if json { Self::Json } else { Self::Words }
    }

    pub(crate) fn say(self, lines: &str) {
        match self {
            Self::Words => console::report(lines),
            Self::Json => lines.lines().for_each(console::info),
        }
    }
}

/// Scores a session, writes its result, prints the report, and returns the status.
pub(crate) fn finish(
    setup: &Setup<'_>,
    (session, found): (&Session, &Found),
    folder: ResultFolder,
    out: &Path,
    voice: Voice,
) -> Result<Status, Failure> {
    let (summary, _) = write(setup, session, found, folder)?;
    match voice {
        Voice::Words => {
            let detailed = console::verbosity() > 1;
            console::report(&report::run_text(&summary, detailed));
        }
        // Requested explicitly, so printed even with `-q`.
        Voice::Json => console::print(&to_json(&summary)?),
    }
    voice.say(&format!("result in {}\n", out.display()));
    Ok(verdict(&summary))
}

fn to_json(summary: &Summary) -> Result<String, Failure> {
    let json = serde_json::to_string_pretty(summary).map_err(Failure::input)?;
    Ok(format!("{json}\n"))
}

/// Scores a session and writes its result, including that of the sinks. Returns the figures and the score of the final poses.
pub(crate) fn write(
    setup: &Setup<'_>,
    session: &Session,
    found: &Found,
    mut folder: ResultFolder,
) -> Result<(Summary, Option<Score>), Failure> {
    let scores = setup.truth.and_then(|truth| scores(truth, &session.poses));
    write_poses(&session.poses, &mut folder)?;
    folder.write("frames.csv", session.frames_csv.as_bytes())?;
    folder.write("config.toml", setup.config_text.as_bytes())?;
    if let Some(log) = &setup.log {
        folder.write("run.log", log)?;
    }
    for (name, figure) in figures(setup, session, scores.as_ref()) {
        folder.write(&format!("{name}.svg"), figure.to_svg().as_bytes())?;
        let png = figure.to_png().map_err(Failure::input)?;
        folder.write(&format!("{name}.png"), &png)?;
    }
    // After everything that takes memory, except the report, which contains the summary.
    let summary = summarise(setup, session, found, scores.as_ref());
    let json = to_json(&summary)?;
    if let Some(recorder) = setup.report {
        let score = scores.as_ref().map(|s| &s.0);
        let run = data::of_session(setup, (session, found), &json, score, recorder);
        if let Some(view) = found.shelf.get::<PageView>() {
            view.report(&run);
        }
        folder.write(page::FILE, to_html(&[run]).as_bytes())?;
    }
    folder.write("summary.json", json.as_bytes())?;
    folder.commit()?;
    Ok((summary, scores.map(|(final_score, _)| final_score)))
}

/// Writes all poses: of frames, of each submap, and of keyframes.
fn write_poses(poses: &Poses, folder: &mut ResultFolder) -> Result<(), Failure> {
    let text = |p: &[StampedPose]| trajectory::format(p).into_bytes();
    folder.write("trajectory.txt", &text(&poses.final_poses))?;
    for (name, text) in covariances::files(poses) {
        folder.write(name, text.as_bytes())?;
    }
    folder.write("trajectory_online.txt", &text(&poses.online))?;
    for (i, submap) in poses.other_submaps.iter().enumerate() {
        let name = submap_file(i + 1, submap.id);
        folder.write(&name, &text(&submap.final_poses))?;
    }
    folder.write("keyframes.txt", &text(&poses.keyframes))
}

/// The plots: final poses, with the ground truth if there is any, and times.
fn figures(
    setup: &Setup<'_>,
    session: &Session,
    scores: Option<&(Score, Score)>,
) -> Vec<(&'static str, Figure)> {
    let name = &page::data::name(&setup.input.name);
    let mut figures = Vec::new();
    let poses = timed(&session.poses.final_poses);
    figures.push((
        "plot",
        match scores {
            Some((score, _)) => score_figure(name, score, &poses),
            None => poses_figure(name, &poses),
        },
    ));
    let stage = |label, name| (label, setup.timing.per_frame(name));
    let whole = match &session.live {
        Some(live) => ("latency", live.latency_ms.clone()),
        None => stage("whole frame", "total"),
    };
    let stages = [whole, stage("tracking", "frame")];
    let series: Vec<Series<'_>> = stages
        .iter()
        .map(|(name, milliseconds)| Series { name, milliseconds })
        .collect();
    figures.push(("timing", timing_figure(name, &series)));
    figures
}

/// The plot of a score: errors of a moving camera, drift of one that stands still.
pub(crate) fn score_figure(title: &str, score: &Score, estimate: &[TimedPose]) -> Figure {
    match score {
        Score::Moving(e) => trajectory_figure(title, &e.ate, e.rpe.as_ref()),
        Score::Fixed(_) => drift_figure(title, estimate),
    }
}

/// A result is a failure if more than one frame in this many is unreadable, as in the doctor. Tracking bridges a few damaged images; more
/// of them mean that the recording as a whole is faulty, and leave large gaps between poses.
const READABLE: usize = 10;

fn unread(summary: &Summary) -> bool {
    summary.tracking.skipped * READABLE > summary.tracking.frames + summary.tracking.skipped
}

/// Maximum number of intervals that are listed, which fits on a screen, and minimum number of frames of each, as camera drivers sometimes
/// repeat single images.
const TOLD: usize = 5;
const LONG: u32 = 3;

fn tell_still(stretches: &[StillStretch]) {
    let (long, short): (Vec<_>, Vec<_>) = stretches.iter().partition(|s| s.frames >= LONG);
    for stretch in long.iter().take(TOLD) {
        match stretch.what {
            StillJson::Rest => console::info(&stretch.to_string()),
            _ => console::warn(&stretch.to_string()),
        }
    }
    let others: Vec<_> = long.into_iter().skip(TOLD).chain(short).collect();
    if !others.is_empty() {
        let frames: u32 = others.iter().map(|s| s.frames).sum();
        console::warn(&format!(
            "frames that repeat an image of the one before, in other places: {frames}; frames.csv says where, and what became of them"
        ));
    }
}

/// Prints the intervals without a pose, with reasons, and those of repeated images.
fn tell_stretches(s: &Summary) {
    let unexplained = |l: &&LostStretch| !s.tracking.still.iter().any(|still| still.explains(l));
    for stretch in s.tracking.lost.iter().filter(unexplained) {
        console::warn(&format!(
            "no pose in frames {} to {} ({:.2} s): {}; then {}",
            stretch.first, stretch.last, stretch.seconds, stretch.reason, stretch.then
        ));
    }
    tell_still(&s.tracking.still);
}

/// Prints problems, if any, and returns the status.
pub(crate) fn verdict(summary: &Summary) -> Status {
    let s = summary;
    if s.interrupted {
        console::line(&format!(
            "interrupted after {}: the result holds what there was",
            counted(s.tracking.frames, "frame")
        ));
    }
    tell_stretches(s);
    for submap in s.tracking.submaps.iter().skip(1) {
        console::warn(&format!(
            "{} frames are in a submap that was not recognised as part of the first: their poses are in {}, in a frame of reference of their own",
            submap.frames, submap.trajectory
        ));
    }
    if let Some(remark) = &s.stages.detector.remark {
        console::warn(remark);
    }
    let d = &s.stages.detector;
    if d.failed_frames > 0 {
        console::line(&format!(
            "the detector failed on {} of {} frames",
            d.failed_frames, s.tracking.frames
        ));
    }
    let unread = unread(s);
    if unread {
        console::line(&format!(
            "{} of {} frames could not be read, more than one in {READABLE}: the result is not of the whole recording",
            s.tracking.skipped,
            s.tracking.frames + s.tracking.skipped
        ));
    }
    let passed_over: usize = s.tracking.still.iter().map(StillStretch::passed_over).sum();
    let stood_still = passed_over * READABLE > s.tracking.frames;
    if stood_still {
        console::line(&format!(
            "{passed_over} of {} frames are no new views, more than one in {READABLE}: the result is not of the whole recording",
            s.tracking.frames
        ));
    }
    let missing = (s.tracking.frames - s.tracking.tracked).saturating_sub(passed_over);
    if missing > 0 {
        console::line(&format!(
            "{missing} of {} frames have no pose in trajectory.txt",
            s.tracking.frames
        ));
    }
    let broken = s.pace.live.as_ref().map_or(0, |live| live.tell());
    let incomplete = missing > 0 || unread || stood_still;
    if incomplete || s.tracking.tracked < 2 || s.interrupted || d.never_answered() || broken > 0 {
        Status::Failed
    } else {
        Status::Ok
    }
}

/// Scores of the final and the online poses. A failure to score does not discard the result.
fn scores(truth: &[StampedPose], found: &Poses) -> Option<(Score, Score)> {
    let truth = timed(truth);
    let options = EvalOptions::default();
    let poses = timed(&found.final_poses);
    order::remark(&truth, &poses);
    offset::remark(
        &truth,
        &poses,
        (false, 0.0),
        "stillpoint eval GROUNDTRUTH trajectory.txt --time-offset",
    );
    let both = score(&truth, &poses, &options)
        .and_then(|f| Ok((f, score(&truth, &timed(&found.online), &options)?)));
    both.map_err(|e| console::warn(&format!("no score: {e}")))
        .ok()
}

fn summarise(
    setup: &Setup<'_>,
    session: &Session,
    found: &Found,
    scores: Option<&(Score, Score)>,
) -> Summary {
    let stages = setup.timing.statistics().into_iter();
    Summary {
        input: setup.input.clone(),
        tracking: session.tracking.clone(),
        stages: session.stages.clone(),
        interrupted: session.interrupted,
        map: MapJson::of(&session.view),
        kept: KeptJson {
            map: found.shelf.get().cloned(),
            dense: found.shelf.get::<Fused>().map(|d| d.json.clone()),
        },
        pace: PaceJson {
            seconds: session.seconds,
            timing_ms: stages.map(|(name, s)| StageTiming::new(name, s)).collect(),
            live: session.live.as_ref().map(|live| live.json.clone()),
            peak_memory_bytes: peak_memory(),
        },
        simd: format!("{:?}", setup.simd).to_lowercase(),
        machine: Machine::here(),
        accuracy: scores.map(|(final_score, online_score)| Accuracy {
            final_poses: ScoreJson::new(final_score, false),
            online: ScoreJson::new(online_score, false),
        }),
        sections: found.sections.clone(),
    }
}

pub(crate) fn timed(poses: &[StampedPose]) -> Vec<TimedPose> {
    poses
        .iter()
        .map(|p| TimedPose {
            stamp: p.stamp,
            world_from_camera: p.world_from_camera,
        })
        .collect()
}
