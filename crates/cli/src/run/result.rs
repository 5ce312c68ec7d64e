//! What a session found: its score, its result folder, its report and how it ended. `run`, `replay` and `demo` write it
//! in the same way.

use crate::args::run::OutputArgs;
use crate::console::{self, counted};
use crate::eval::{offset, order};
use crate::failure::{Failure, Status};
use crate::machine::{Machine, peak_memory};
use crate::output::{ResultFolder, submap_file};
use crate::page::{self, data};
use crate::run::session::Session;
use crate::run::summary::{
    Accuracy, Input, LostStretch, ReadoutJson, ScoreJson, StageTiming, StillJson, StillStretch,
    Summary,
};
use crate::run::view::PageView;
use crate::timing::Timing;
use crate::{config, report};
use std::path::Path;
use stillpoint::datasets::{StampedPose, trajectory};
use stillpoint::evaluation::plot::{
    Figure, Series, drift_figure, poses_figure, timing_figure, trajectory_figure,
};
use stillpoint::evaluation::{EvalOptions, Score, TimedPose, score};
use stillpoint::imaging::Simd;
use stillpoint::slam::Config;
use stillpoint::view::report::{ReportRecorder, to_html};

/// What a result is about.
pub(crate) struct Setup<'a> {
    pub(crate) input: Input,
    pub(crate) config: &'a Config,
    pub(crate) simd: Simd,
    pub(crate) timing: &'a Timing,
    pub(crate) truth: Option<&'a [StampedPose]>,
    /// What the report shows of the frames; none where none is to be written.
    pub(crate) report: Option<&'a ReportRecorder>,
    /// Where the run was shown while it went on: it is told the report.
    pub(crate) view: Option<&'a PageView>,
    /// How the run was begun.
    pub(crate) command: String,
    /// The log of the run, as it stands in the folder.
    pub(crate) log: Option<Vec<u8>>,
}

/// How a run reports on its result.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Voice {
    /// In words, on stdout.
    Words,
    /// For programs: the summary as JSON is all that goes to stdout.
    Json,
}

impl Voice {
    /// As the arguments have it.
    pub(crate) fn of(args: &OutputArgs) -> Self {
        if args.json { Self::Json } else { Self::Words }
    }

    /// Says something beside the report, in lines.
    pub(crate) fn say(self, lines: &str) {
        match self {
            Self::Words => console::report(lines),
            Self::Json => lines.lines().for_each(console::info),
        }
    }
}

/// Scores a session, writes its result, prints the report, and says how it ended.
pub(crate) fn finish(
    setup: &Setup<'_>,
    session: &Session,
    folder: ResultFolder,
    out: &Path,
    voice: Voice,
) -> Result<Status, Failure> {
    let (summary, _) = write(setup, session, folder)?;
    match voice {
        Voice::Words => {
            let detailed = console::verbosity() > 1;
            console::report(&report::run_text(&summary, detailed));
        }
        // Asked for, so printed even where nothing but errors is to be said.
        Voice::Json => console::print(&to_json(&summary)?),
    }
    voice.say(&format!("result in {}\n", out.display()));
    Ok(verdict(&summary))
}

/// The summary as it stands in `summary.json`.
fn to_json(summary: &Summary) -> Result<String, Failure> {
    let json = serde_json::to_string_pretty(summary).map_err(Failure::input)?;
    Ok(format!("{json}\n"))
}

/// Scores a session and writes its result. Returns the figures and the score of the final poses.
pub(crate) fn write(
    setup: &Setup<'_>,
    session: &Session,
    mut folder: ResultFolder,
) -> Result<(Summary, Option<Score>), Failure> {
    let scores = setup.truth.and_then(|truth| scores(truth, session));
    let poses = |p: &[StampedPose]| trajectory::format(p).into_bytes();
    folder.write("trajectory.txt", &poses(&session.final_poses))?;
    folder.write("trajectory_online.txt", &poses(&session.online_poses))?;
    for (i, submap) in session.other_submaps.iter().enumerate() {
        let name = submap_file(i + 1, submap.id);
        folder.write(&name, &poses(&submap.final_poses))?;
    }
    folder.write("keyframes.txt", &poses(&session.keyframes))?;
    folder.write("frames.csv", session.frames_csv.as_bytes())?;
    let config = config::to_text(setup.config)?;
    folder.write("config.toml", config.as_bytes())?;
    if let Some(log) = &setup.log {
        folder.write("run.log", log)?;
    }
    for (name, figure) in figures(setup, session, scores.as_ref()) {
        folder.write(&format!("{name}.svg"), figure.to_svg().as_bytes())?;
        let png = figure.to_png().map_err(Failure::input)?;
        folder.write(&format!("{name}.png"), &png)?;
    }
    if let Some(fused) = &session.dense {
        fused.write(&mut folder)?;
    }
    if let Some(gathered) = session.things.as_ref().filter(|t| t.frames.is_some()) {
        folder.write("things.json", gathered.json()?.as_bytes())?;
    }
    // After all that takes memory, but for the report, which holds it.
    let summary = summarise(setup, session, scores.as_ref());
    let json = to_json(&summary)?;
    if let Some(recorder) = setup.report {
        let score = scores.as_ref().map(|s| &s.0);
        let run = data::of_session(setup, session, &json, score, recorder, config);
        if let Some(view) = setup.view {
            view.report(&run);
        }
        folder.write(page::FILE, to_html(&[run]).as_bytes())?;
    }
    folder.write("summary.json", json.as_bytes())?;
    folder.commit()?;
    Ok((summary, scores.map(|(final_score, _)| final_score)))
}

/// The plots of a result: the final poses, against the ground truth where there is any, and the times.
fn figures(
    setup: &Setup<'_>,
    session: &Session,
    scores: Option<&(Score, Score)>,
) -> Vec<(&'static str, Figure)> {
    let name = &setup.input.name;
    let mut figures = Vec::new();
    let poses = timed(&session.final_poses);
    figures.push((
        "plot",
        match scores {
            Some((score, _)) => score_figure(name, score, &poses),
            None => poses_figure(name, &poses),
        },
    ));
    let frame = |name| (name, setup.timing.per_frame(name));
    let whole = match &session.live {
        Some(live) => ("latency", live.latency_ms.clone()),
        None => frame("total"),
    };
    let stages = [whole, frame("frame")];
    let series: Vec<Series<'_>> = stages
        .iter()
        .map(|(name, milliseconds)| Series { name, milliseconds })
        .collect();
    figures.push(("timing", timing_figure(name, &series)));
    figures
}

/// The plot of a score: errors of a camera that moves, drift of one that stands still.
pub(crate) fn score_figure(title: &str, score: &Score, estimate: &[TimedPose]) -> Figure {
    match score {
        Score::Moving(e) => trajectory_figure(title, &e.ate),
        Score::Fixed(_) => drift_figure(title, estimate),
    }
}

/// One frame in so many may be unreadable, as for the doctor. A few damaged images are part of life, and tracking goes on behind them; with more than
/// that something is wrong with the recording as a whole, and poses are far apart.
const READABLE: usize = 10;

/// Whether too many frames could not be read.
fn unread(summary: &Summary) -> bool {
    summary.skipped * READABLE > summary.frames + summary.skipped
}

/// At most so many stretches are listed, each of at least so many frames: the longest fit on a screen, and a driver repeats single images now and then.
const TOLD: usize = 5;
const LONG: u32 = 3;

/// Says for how long images stood still.
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

/// Says in which frames there is no pose, and why, and in which images stood still.
fn tell_stretches(s: &Summary) {
    let unexplained = |l: &&LostStretch| !s.still.iter().any(|still| still.explains(l));
    for stretch in s.lost.iter().filter(unexplained) {
        console::warn(&format!(
            "no pose in frames {} to {} ({:.2} s): {}; then {}",
            stretch.first, stretch.last, stretch.seconds, stretch.reason, stretch.then
        ));
    }
    tell_still(&s.still);
}

/// Says what went wrong, if anything did.
pub(crate) fn verdict(summary: &Summary) -> Status {
    let s = summary;
    if s.interrupted {
        console::line(&format!(
            "interrupted after {}: the result holds what there was",
            counted(s.frames, "frame")
        ));
    }
    tell_stretches(s);
    for submap in s.submaps.iter().skip(1) {
        console::warn(&format!(
            "{} frames are in a submap that was not recognised as part of the first: their poses are in {}, in a frame of reference of their own",
            submap.frames, submap.trajectory
        ));
    }
    if let Some(remark) = &s.detector.remark {
        console::warn(remark);
    }
    let d = &s.detector;
    if d.failed_frames > 0 {
        console::line(&format!(
            "the detector failed on {} of {} frames",
            d.failed_frames, s.frames
        ));
    }
    let unread = unread(s);
    if unread {
        console::line(&format!(
            "{} of {} frames could not be read, more than one in {READABLE}: the result is not of the whole recording",
            s.skipped,
            s.frames + s.skipped
        ));
    }
    let passed_over: usize = s.still.iter().map(StillStretch::passed_over).sum();
    let stood_still = passed_over * READABLE > s.frames;
    if stood_still {
        console::line(&format!(
            "{passed_over} of {} frames are no new views, more than one in {READABLE}: the result is not of the whole recording",
            s.frames
        ));
    }
    let missing = (s.frames - s.tracked).saturating_sub(passed_over);
    if missing > 0 {
        console::line(&format!(
            "{missing} of {} frames have no pose in trajectory.txt",
            s.frames
        ));
    }
    let broken = s.live.as_ref().map_or(0, |live| live.tell());
    let incomplete = missing > 0 || unread || stood_still;
    if incomplete || s.tracked < 2 || s.interrupted || d.never_answered() || broken > 0 {
        Status::Failed
    } else {
        Status::Ok
    }
}

/// Scores of the final and the online poses. No score is no reason to lose the result.
fn scores(truth: &[StampedPose], session: &Session) -> Option<(Score, Score)> {
    let truth = timed(truth);
    let options = EvalOptions::default();
    let poses = timed(&session.final_poses);
    order::remark(&truth, &poses);
    offset::remark(
        &truth,
        &poses,
        (false, 0.0),
        "stillpoint eval GROUNDTRUTH trajectory.txt --time-offset",
    );
    let both = score(&truth, &poses, &options)
        .and_then(|f| Ok((f, score(&truth, &timed(&session.online_poses), &options)?)));
    both.map_err(|e| console::warn(&format!("no score: {e}")))
        .ok()
}

fn summarise(setup: &Setup<'_>, session: &Session, scores: Option<&(Score, Score)>) -> Summary {
    Summary {
        input: setup.input.clone(),
        frames: session.frames,
        skipped: session.skipped,
        tracked: session.final_poses.len(),
        undecided: session.undecided,
        readout: ReadoutJson {
            seconds: session.timing.readout,
            sigma: session.timing.readout_sigma,
        },
        lost: session.lost.clone(),
        still: session.still.clone(),
        submaps: session.submaps.clone(),
        detector: session.detector.clone(),
        features: session.features,
        loops: session.loops,
        inertial: session.inertial.clone(),
        odometry: session.odometry.clone(),
        interrupted: session.interrupted,
        keyframes: session.view.keyframe_count(),
        landmarks: session.view.landmark_count(),
        map_versions: session.view.version(),
        map: session
            .saved
            .as_ref()
            .and_then(|s| s.as_ref().ok())
            .cloned(),
        dense: session.dense.as_ref().map(|d| d.json.clone()),
        seconds: session.seconds,
        timing_ms: setup
            .timing
            .statistics()
            .into_iter()
            .map(|(name, s)| StageTiming::new(name, s))
            .collect(),
        live: session.live.as_ref().map(|live| live.json.clone()),
        peak_memory_bytes: peak_memory(),
        simd: format!("{:?}", setup.simd).to_lowercase(),
        machine: Machine::here(),
        accuracy: scores.map(|(final_score, online_score)| Accuracy {
            final_poses: ScoreJson::new(final_score, false),
            online: ScoreJson::new(online_score, false),
        }),
    }
}

/// Poses as the judge takes them.
pub(crate) fn timed(poses: &[StampedPose]) -> Vec<TimedPose> {
    poses
        .iter()
        .map(|p| TimedPose {
            stamp: p.stamp,
            world_from_camera: p.world_from_camera,
        })
        .collect()
}
