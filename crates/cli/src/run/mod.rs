//! `run`: processes a data set folder or recording, frame by frame or at camera rate.

pub(crate) mod about;
mod covariances;
pub(crate) mod drive;
pub(crate) mod frames;
pub(crate) mod known_map;
pub(crate) mod live_report;
pub(crate) mod paths;
pub(crate) mod played;
pub(crate) mod prologue;
pub(crate) mod replay;
pub(crate) mod result;
pub(crate) mod session;
pub(crate) mod setup;
pub(crate) mod stop;
pub(crate) mod submaps;
pub(crate) mod summary;
pub(crate) mod tally;

use crate::args::run::{LiveChoice, RunArgs};
use crate::config;
use crate::console;
use crate::dense::Fused;
use crate::detector::{self, Loaded, Settled};
use crate::doctor;
use crate::failure::{Failure, Status};
use crate::input::open;
use crate::output::StreamedFile;
use crate::priority;
use crate::run::about::{About, run_log};
use crate::run::drive::live::Choice;
use crate::run::known_map::KnownMap;
use crate::run::prologue::{Means, Task};
use crate::sink::Repeated;
use crate::sinks::record::SharedRecorder;
use crate::sinks::things::Gathered;
use crate::timing::Timing;
use stillpoint::datasets::ReadAhead;
use stillpoint::live::Stage;
use stillpoint::recordings;
use stillpoint::slam::{Config, CostTable, Plan};

/// Frames that are read ahead of a live run: a second at 30 Hz, so that short delays of the disk or of other programs do not delay the
/// camera; about 70 MB with colour.
const AHEAD: usize = 30;

pub(crate) fn run(args: &RunArgs, timing: &'static Timing) -> Result<Status, Failure> {
    let dataset = open(&args.path, &args.input)?;
    run_on(dataset, args, None, timing)
}

/// `run` on an open input; `recorder` is the file to which the input writes its frames.
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
        // The name of a device needs no suffix.
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
    if args.output.things.things && !settled.looks() {
        return Err(Failure::input(
            "--things: expected a detector that knows things, found none; name one with --detector, or fetch one with models pull",
        ));
    }
    let loaded = load_detector(args, &settled, &opened.dataset)?;
    let known = KnownMap::of(args.load_map.as_deref(), args.localize.as_deref());
    let ahead = args.live.map_or(ReadAhead::DEFAULT_FRAMES, |_| AHEAD);
    let adds_ids = args.output.map.save_map.is_some();
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
        mut sinks,
        interrupt,
        map,
    } = means;
    let driver = begun.driver(&interrupt, loaded.detector, map);
    let mut session = match args.live {
        None => driver.drive(&mut frames, &mut sinks)?,
        Some(choice) => {
            let choice = Choice {
                name: choice.name(),
                drops_late: choice == LiveChoice::Newest,
                budget: args.budget_ms.map(|ms| ms / 1e3),
            };
            driver.drive_live(&mut frames, &mut sinks, choice)?
        }
    };
    session.stages.detector.library = loaded.library;
    let (over, found) = begun.finish(&session, sinks)?;
    let detector = &session.stages.detector;
    let mut about = About::new(&args.input, over.config(), known, detector)?;
    about.dense = found.shelf.get::<Fused>().map(|d| d.logged.clone());
    about.things = found.shelf.get::<Gathered>().map(|t| t.frames.clone());
    let log = run_log(&session, &about, log_file)?;
    let status = over.write(&session, &found, log)?;
    if let Some(beside) = beside.flatten().filter(|_| !session.interrupted) {
        // A panic there was reported and does not affect the result.
        let _ = beside.join();
    }
    found.late.map_or(Ok(status), Err)
}

/// The configuration whose work fits into a time per frame.
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

/// Loads the detector. In a live run its thread has a lower priority than tracking, and so have the network's threads, which inherit it.
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

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ordinals_are_correct_english() {
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
}
