//! `run`: a data set folder or recording through the system, frame by frame or as a camera.

pub(crate) mod about;
pub(crate) mod frames;
pub(crate) mod known_map;
pub(crate) mod live_report;
pub(crate) mod masks;
pub(crate) mod objects;
pub(crate) mod overlay;
pub(crate) mod paths;
pub(crate) mod played;
pub(crate) mod prologue;
pub(crate) mod recording;
pub(crate) mod replay;
pub(crate) mod result;
pub(crate) mod session;
pub(crate) mod submaps;
pub(crate) mod summary;
pub(crate) mod tally;
pub(crate) mod verdicts;
pub(crate) mod view;

use crate::args::run::{OutputArgs, RunArgs};
use crate::config;
use crate::console;
use crate::detector::{self, Loaded, Settled};
use crate::doctor;
use crate::failure::{Failure, Status};
use crate::input::open;
use crate::map::file::MapOutput;
use crate::output::StreamedFile;
use crate::page::Gathering;
use crate::priority;
use crate::run::about::About;
use crate::run::known_map::KnownMap;
use crate::run::masks::MaskFolder;
use crate::run::objects::ObjectFile;
use crate::run::overlay::{OverlayFolder, Style};
use crate::run::prologue::{Means, Repeated, Task, last};
use crate::run::recording::SharedRecorder;
use crate::run::session::{Outputs, Session};
use crate::run::summary::Input;
use crate::run::verdicts::VerdictFile;
use crate::timing::Timing;
use crate::trace::TraceFile;
use std::io::Write;
use std::path::{Path, PathBuf};
use stillpoint::datasets::ReadAhead;
use stillpoint::live::Stage;
use stillpoint::recordings;
use stillpoint::slam::{Config, CostTable, Plan, Preset};

/// Frames that are read ahead of a live run: a second at 30 Hz, so that what the disk or another program holds up for a moment does
/// not hold up the camera; about 70 MB with colour.
const AHEAD: usize = 30;

/// `run`.
pub(crate) fn run(args: &RunArgs, timing: &'static Timing) -> Result<Status, Failure> {
    let dataset = open(&args.path, &args.input)?;
    run_on(dataset, args, None, timing)
}

/// `run` on an input that is open; `recorder` is where it writes its frames itself.
pub(crate) fn run_on(
    dataset: recordings::Input,
    args: &RunArgs,
    recorder: Option<SharedRecorder>,
    timing: &'static Timing,
) -> Result<Status, Failure> {
    let mut config = config::resolve(&args.config)?;
    if let (Some(ms), None) = (args.budget_ms, args.live) {
        config = within(&config, ms);
    }
    let is_device = matches!(dataset, recordings::Input::Device(_));
    let task = Task {
        path: &args.path,
        input: &args.input,
        output: &args.output,
        config,
        // A camera's own name is no other run's.
        done: match args.live {
            Some(_) if !is_device => "_live",
            _ => "",
        },
        log: args.log.as_deref(),
        inputs: args
            .config
            .config
            .as_deref()
            .map(|p| ("--config", p))
            .into_iter()
            .collect(),
        recorder,
        timing,
    };
    let beside = (!is_device).then(|| doctor::beside_run(&args.path, &args.input));
    let opened = task.with(dataset)?;
    let settled = detector::settle(&args.input.detector)?;
    settled.announce();
    if args.output.things && !settled.looks() {
        return Err(Failure::input(
            "--things: expected a detector that knows things, found none; name one with --detector, or fetch one with models pull",
        ));
    }
    let loaded = load_detector(args, &settled, &opened.dataset)?;
    let known = KnownMap::of(args.load_map.as_deref(), args.localize.as_deref());
    let ahead = args.live.map_or(ReadAhead::DEFAULT_FRAMES, |_| AHEAD);
    let adds_ids = args.output.save_map.is_some();
    let (begun, means) = opened.begin(
        known,
        settled.needs_colour(),
        ahead,
        adds_ids,
        Repeated::default(),
    )?;
    let log_file = args.log.as_deref();
    let log_file = log_file.map(|path| StreamedFile::create(path, "--log"));
    let log_file = log_file.transpose()?;
    let Means {
        mut frames,
        mut outputs,
        interrupt,
        map,
    } = means;
    let driver = begun.driver(&interrupt, loaded.detector, map);
    let mut session = match args.live {
        None => driver.drive(&mut frames, &mut outputs)?,
        Some(choice) => {
            let budget = args.budget_ms.map(|ms| ms / 1e3);
            driver.drive_live(&mut frames, &mut outputs, choice, budget)?
        }
    };
    session.detector.library = loaded.library;
    let mut about = About::new(&args.input, begun.config(), known, &session.detector)?;
    about.dense = session.dense.as_ref().map(|d| d.logged.clone());
    about.things = session.things.as_ref().and_then(|t| t.frames.clone());
    let status = begun.end(&session, outputs, || run_log(&session, &about, log_file))?;
    if let Some(beside) = beside.flatten().filter(|_| !session.interrupted) {
        // A panic there has been said, and takes nothing from the result.
        let _ = beside.join();
    }
    last(session, status)
}

/// The log of a run, for the result folder; where it goes to a file of its own, it is written there.
pub(crate) fn run_log(
    session: &Session,
    about: &About,
    file: Option<StreamedFile>,
) -> Result<Option<Vec<u8>>, Failure> {
    let Some(mut log) = session.log.clone() else {
        return Ok(None);
    };
    log.about = about.to_text()?;
    let text = log.to_text();
    let Some(mut file) = file else {
        return Ok(Some(text.into_bytes()));
    };
    file.write(|w| w.write_all(text.as_bytes()))?;
    file.finish()?;
    Ok(None)
}

/// The configuration with as much work as fits into a time per frame.
fn within(config: &Config, budget_ms: f64) -> Config {
    let plan = Plan::new(config, budget_ms, &CostTable::REFERENCE);
    console::info(&format!(
        "{budget_ms} ms per frame: {} keypoints, {} neighbours and {} keyframes in mapping, the detector at {}; about {:.1} ms where OpenCV's ORB takes {} ms",
        plan.features,
        plan.mapping.neighbours,
        plan.mapping.window,
        every(plan.detector_stride),
        plan.per_frame_ms,
        CostTable::REFERENCE_UNIT_MS,
    ));
    if !plan.fits {
        console::warn("even the least work takes longer than that");
    }
    plan.apply(config)
}

/// Every n-th frame, in words.
fn every(n: u32) -> String {
    let suffix = match (n % 10, n % 100) {
        (_, 11..=13) => "th",
        (1, _) => "st",
        (2, _) => "nd",
        (3, _) => "rd",
        _ => "th",
    };
    match n {
        0 | 1 => "every frame".to_owned(),
        n => format!("every {n}{suffix} frame"),
    }
}

/// The detector. What runs it in a live run gives way to tracking: so do the threads that a network brings, which have the priority
/// of whoever starts them.
fn load_detector(
    args: &RunArgs,
    settled: &Settled,
    dataset: &recordings::Input,
) -> Result<Loaded, Failure> {
    let load = || detector::load(settled, &args.input.detector, &dataset.stamps());
    if args.live.is_none() {
        return load();
    }
    let load = || {
        priority::lower(Stage::Detection);
        load()
    };
    std::thread::scope(|scope| scope.spawn(load).join())
        .unwrap_or_else(|panic| std::panic::resume_unwind(panic))
}

/// What a result is of.
pub(crate) fn input(path: &Path, dataset: &recordings::Input) -> Input {
    Input {
        name: path.display().to_string(),
        layout: dataset.kind(),
        camera: dataset.camera().name.clone(),
    }
}

/// What is written while frames go by. `frames` is their number where known.
pub(crate) fn outputs(
    args: &OutputArgs,
    config: &Config,
    dataset: &recordings::Input,
    frames: Option<usize>,
    timing: &'static Timing,
) -> Result<Outputs, Failure> {
    let overlay = |folder: &PathBuf| {
        let every = args.overlay_every as usize;
        let stamps = dataset.stamps();
        let frames = frames.unwrap_or(stamps.len());
        OverlayFolder::create(
            folder,
            every,
            frames,
            rate(&stamps),
            Style {
                labels: args.overlay_labels.into(),
                weights: config.motion_weights.clone(),
                bare: false,
            },
        )
    };
    // Folders first: the files may lie in one of them.
    let overlay = args.overlay.as_ref().map(overlay).transpose()?;
    let masks = args.masks.as_deref().map(|folder| {
        if config.static_filter.preset != Preset::Default {
            return Err(Failure::input(
                "--masks: expected static_filter.preset \"default\", which judges surfaces; the configuration has another, which judges features alone",
            ));
        }
        MaskFolder::create(folder)
    });
    let masks = masks.transpose()?;
    let objects = args.objects.as_deref().map(ObjectFile::create);
    let verdicts = args.verdicts.as_deref().map(VerdictFile::create);
    let map = args.save_map.as_deref();
    let map = map.map(|path| MapOutput::create(path, "--save-map"));
    let trace = args.trace.as_deref();
    let trace = trace.map(|path| TraceFile::create(path, timing));
    Ok(Outputs {
        verdicts: verdicts.transpose()?,
        objects: objects.transpose()?,
        masks,
        overlay,
        report: (!args.no_report).then(Gathering::default),
        map: map.transpose()?,
        trace: trace.transpose()?,
        ..Outputs::default()
    })
}

/// Frames per second; 30 where the stamps do not tell.
fn rate(stamps: &[(f64, f64)]) -> f64 {
    let (Some((first, _)), Some((last, _))) = (stamps.first(), stamps.last()) else {
        return 30.0;
    };
    let rate = (stamps.len() - 1) as f64 / (last - first);
    if rate.is_finite() && rate > 0.0 {
        rate
    } else {
        30.0
    }
}

/// `out/`, the name of the folder or of the file without its ending, and `_` with what was done to it other than `run`.
pub(crate) fn default_out(path: &Path, done: &str) -> PathBuf {
    let full = path.canonicalize().unwrap_or_else(|_| path.to_owned());
    let name = path.file_name().or(full.file_name());
    let stem = name.and_then(|n| Path::new(n).file_stem());
    let name = if path.is_file() { stem } else { name };
    let mut name = name.unwrap_or("run".as_ref()).to_owned();
    name.push(done);
    Path::new("out").join(name)
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinals_are_those_of_english() {
        for (n, said) in [
            (1, "every frame"),
            (2, "every 2nd frame"),
            (3, "every 3rd frame"),
            (5, "every 5th frame"),
            (12, "every 12th frame"),
            (21, "every 21st frame"),
        ] {
            assert_eq!(every(n), said);
        }
    }

    #[test]
    fn results_go_beside_each_other_by_name() {
        assert_eq!(
            default_out(Path::new("data/desk/"), ""),
            Path::new("out/desk")
        );
        let here = std::env::current_dir().unwrap();
        let name = here.file_name().unwrap();
        assert_eq!(default_out(Path::new("."), ""), Path::new("out").join(name));
        // A file gives its name without the ending, a folder all of it.
        let dir = tempfile::tempdir().unwrap();
        let [file, folder] = ["walk.mcap", "walk.bag"].map(|n| dir.path().join(n));
        std::fs::write(&file, "").unwrap();
        std::fs::create_dir(&folder).unwrap();
        assert_eq!(default_out(&file, "_live"), Path::new("out/walk_live"));
        assert_eq!(default_out(&folder, ""), Path::new("out/walk.bag"));
    }
}
