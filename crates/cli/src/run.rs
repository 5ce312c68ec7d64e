//! `run`: a data set folder through the system, and the result folder, which `demo` writes in the same way.

use crate::args::{InputArgs, RunArgs};
use crate::console;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::machine::{Machine, peak_memory};
use crate::map_file::{self, MapOutput};
use crate::output::ResultFolder;
use crate::overlay::OverlayFolder;
use crate::session::{Driver, Outputs, Session};
use crate::summary::{Accuracy, Input, ScoreJson, StageTiming, Summary};
use crate::timing::Timing;
use crate::verdicts::VerdictFile;
use crate::{config, detector, frames, report};
use std::path::{Path, PathBuf};
use stillpoint::datasets::{
    CameraChoice, Dataset, Entry, FrameOptions, OpenOptions, ReadAhead, StampedPose, trajectory,
};
use stillpoint::evaluation::plot::{
    Figure, Series, drift_figure, poses_figure, timing_figure, trajectory_figure,
};
use stillpoint::evaluation::{EvalOptions, Score, TimedPose, score};
use stillpoint::geometry::Camera;
use stillpoint::imaging::{FrameSource, Simd};
use stillpoint::map::Map;
use stillpoint::slam::{Config, MapUse, StartError};

/// `run`.
pub(crate) fn run(args: &RunArgs, timing: &Timing) -> Result<Status, Failure> {
    let config = config::resolve(&args.config)?;
    let simd = config::simd()?;
    let dataset = open(&args.path, &args.input)?;
    let settled = detector::settle(&args.input.detector)?;
    settled.announce();
    let loaded = detector::load(&settled, &args.input.detector, dataset.entries())?;
    let truth = dataset.ground_truth()?;
    let options = FrameOptions {
        start: args.input.start,
        max_frames: args.input.max_frames.map(|n| n as usize),
        keep_colour: args.overlay.is_some() || settled.needs_colour(),
    };
    let frames = dataset.frames(&options)?;
    // Ids of keyframes are numbers of frames.
    let ids = frames.remaining().unwrap_or(dataset.entries().len());
    let map = known_map(args, &config, &dataset.camera().camera, ids)?;
    let out = args.out.clone().unwrap_or_else(|| default_out(&args.path));
    let folder = ResultFolder::create(&out)?;
    let mut outputs = outputs(args, &config, &dataset, frames.remaining())?;
    let interrupt = Interrupt::listen();
    let driver = Driver {
        config: config.clone(),
        camera: dataset.camera().camera,
        simd,
        timing,
        interrupt: &interrupt,
        detector: loaded.detector,
        map,
    };
    let mut session = driver.drive(&mut ReadAhead::new(frames), &mut outputs)?;
    session.detector.library = loaded.library;
    let written = outputs.finish()?;
    let input = Input {
        name: args.path.display().to_string(),
        layout: dataset.layout().to_string(),
        camera: dataset.camera().name.clone(),
    };
    let setup = Setup {
        input,
        config: &config,
        simd,
        timing,
        truth: truth.as_deref(),
    };
    let status = finish(&setup, &session, folder, &out)?;
    console::report(&written);
    // Last, so that the result is there all the same.
    match session.saved {
        Some(Err(failure)) => Err(failure),
        _ => Ok(status),
    }
}

/// The map to begin with, if there is one. `ids` is how many keyframe ids the run may add.
fn known_map(
    args: &RunArgs,
    config: &Config,
    camera: &Camera,
    ids: usize,
) -> Result<Option<(Map, MapUse)>, Failure> {
    let (path, map_use) = match (&args.load_map, &args.localize) {
        (Some(path), _) => (path, MapUse::Grow),
        (None, Some(path)) => (path, MapUse::Localize),
        (None, None) => return Ok(None),
    };
    let map = map_file::load(path)?.file.map;
    map_file::check_fits(path, &map, config, camera)?;
    if map_use == MapUse::Localize && map.view().keyframe_count() == 0 {
        return Err(Failure::input(format!(
            "{}: {}",
            path.display(),
            StartError::Empty
        )));
    }
    if args.save_map.is_some() {
        map_file::check_room(path, &map, ids)?;
    }
    console::info(&format!(
        "{} map {} with {} keyframes and {} landmarks",
        match map_use {
            MapUse::Grow => "going on with",
            MapUse::Localize => "finding the camera in",
        },
        path.display(),
        map.view().keyframe_count(),
        map.view().landmark_count()
    ));
    Ok(Some((map, map_use)))
}

/// What is written while frames go by. `frames` is their number where known.
fn outputs(
    args: &RunArgs,
    config: &Config,
    dataset: &Dataset,
    frames: Option<usize>,
) -> Result<Outputs, Failure> {
    let overlay = |folder: &PathBuf| {
        let every = args.overlay_every as usize;
        let frames = frames.unwrap_or(dataset.entries().len());
        OverlayFolder::create(
            folder,
            every,
            frames,
            rate(dataset.entries()),
            &config.motion_weights,
        )
    };
    // Folders first: the file may lie in one of them.
    let overlay = args.overlay.as_ref().map(overlay).transpose()?;
    let verdicts = args.verdicts.as_deref().map(VerdictFile::create);
    let map = args.save_map.as_deref();
    let map = map.map(|path| MapOutput::create(path, "--save-map"));
    Ok(Outputs {
        verdicts: verdicts.transpose()?,
        overlay,
        shots: None,
        map: map.transpose()?,
    })
}

/// Frames per second; 30 where the stamps do not tell.
fn rate(entries: &[Entry]) -> f64 {
    let (Some(first), Some(last)) = (entries.first(), entries.last()) else {
        return 30.0;
    };
    let rate = (entries.len() - 1) as f64 / (last.stamp - first.stamp);
    if rate.is_finite() && rate > 0.0 {
        rate
    } else {
        30.0
    }
}

/// Opens the data set and says what was guessed.
fn open(path: &Path, input: &InputArgs) -> Result<Dataset, Failure> {
    let options = OpenOptions {
        camera: input.camera.as_deref().map(CameraChoice::from_argument),
        strict: input.strict,
        ..OpenOptions::default()
    };
    let dataset = Dataset::open(path, &options)?;
    for guess in dataset.guesses() {
        console::info(guess);
    }
    for warning in dataset.warnings() {
        console::warn(warning);
    }
    Ok(dataset)
}

/// `out/` and the folder's name.
fn default_out(path: &Path) -> PathBuf {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    Path::new("out").join(
        path.file_name()
            .or(full.file_name())
            .unwrap_or("run".as_ref()),
    )
}

/// What a result is about.
pub(crate) struct Setup<'a> {
    pub(crate) input: Input,
    pub(crate) config: &'a Config,
    pub(crate) simd: Simd,
    pub(crate) timing: &'a Timing,
    pub(crate) truth: Option<&'a [StampedPose]>,
}

/// Scores a session, writes its result, prints the report, and says how it ended.
fn finish(
    setup: &Setup<'_>,
    session: &Session,
    folder: ResultFolder,
    out: &Path,
) -> Result<Status, Failure> {
    let (summary, _) = write(setup, session, folder)?;
    console::report(&report::run_text(&summary));
    console::report(&format!("result in {}\n", out.display()));
    Ok(verdict(&summary))
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
    for (i, piece) in session.other_pieces.iter().enumerate() {
        let name = frames::file_name(i + 1, piece.id);
        folder.write(&name, &poses(&piece.final_poses))?;
    }
    folder.write("keyframes.txt", &poses(&session.keyframes))?;
    folder.write("frames.csv", session.frames_csv.as_bytes())?;
    folder.write("config.toml", config::to_text(setup.config)?.as_bytes())?;
    for (name, figure) in figures(setup, session, scores.as_ref()) {
        folder.write(&format!("{name}.svg"), figure.to_svg().as_bytes())?;
        let png = figure.to_png().map_err(Failure::input)?;
        folder.write(&format!("{name}.png"), &png)?;
    }
    // Last, so that the peak of memory is that of all the work.
    let summary = summarise(setup, session, scores.as_ref());
    let json = serde_json::to_string_pretty(&summary).map_err(Failure::input)?;
    folder.write("summary.json", format!("{json}\n").as_bytes())?;
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
    let stages = ["total", "frame"].map(|s| (s, setup.timing.per_frame(s)));
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

/// Says what went wrong, if anything did.
pub(crate) fn verdict(summary: &Summary) -> Status {
    let s = summary;
    if s.interrupted {
        console::line(&format!(
            "interrupted after {} frames: the result holds what there was",
            s.frames
        ));
    }
    for stretch in &s.lost {
        console::warn(&format!(
            "no pose in frames {} to {} ({:.2} s): {}; then {}",
            stretch.first, stretch.last, stretch.seconds, stretch.reason, stretch.then
        ));
    }
    for piece in s.pieces.iter().skip(1) {
        console::warn(&format!(
            "{} frames are in a piece of map that was not recognised as part of the first: their poses are in {}, in a frame of reference of their own",
            piece.frames, piece.trajectory
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
    let missing = s.frames - s.tracked;
    if missing > 0 {
        console::line(&format!(
            "{missing} of {} frames have no pose in trajectory.txt",
            s.frames
        ));
    }
    if missing > 0 || s.tracked < 2 || s.interrupted || d.never_answered() {
        Status::Failed
    } else {
        Status::Ok
    }
}

/// Scores of the final and the online poses. No score is no reason to lose the result.
fn scores(truth: &[StampedPose], session: &Session) -> Option<(Score, Score)> {
    let truth = timed(truth);
    let options = EvalOptions::default();
    let both = score(&truth, &timed(&session.final_poses), &options)
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
        lost: session.lost.clone(),
        pieces: session.pieces.clone(),
        detector: session.detector.clone(),
        features: session.features,
        loops: session.loops,
        interrupted: session.interrupted,
        keyframes: session.view.keyframe_count(),
        landmarks: session.view.landmark_count(),
        map_versions: session.view.version(),
        map: session
            .saved
            .as_ref()
            .and_then(|s| s.as_ref().ok())
            .cloned(),
        seconds: session.seconds,
        timing_ms: setup
            .timing
            .statistics()
            .into_iter()
            .map(|(name, s)| StageTiming::new(name, s))
            .collect(),
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_go_beside_each_other_by_name() {
        assert_eq!(default_out(Path::new("data/desk/")), Path::new("out/desk"));
        let here = std::env::current_dir().unwrap();
        let name = here.file_name().unwrap();
        assert_eq!(default_out(Path::new(".")), Path::new("out").join(name));
    }
}
