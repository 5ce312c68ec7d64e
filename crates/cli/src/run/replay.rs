//! `replay`: a run again, bit for bit, from its log and its data set.

use crate::args::InputArgs;
use crate::args::run::ReplayArgs;
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::output::ResultFolder;
use crate::run::about::About;
use crate::run::played;
use crate::run::result::{Setup, finish};
use crate::run::session::Driver;
use crate::run::{KnownMap, default_out, input, open, outputs};
use crate::timing::Timing;
use crate::{config, console};
use std::fs::File;
use std::io::Read;
use std::path::Path;
use stillpoint::datasets::{FrameOptions, ReadAhead};
use stillpoint::imaging::FrameSource;
use stillpoint::slam::RunLog;

/// Bytes that a log may have: that of a day. It is read as a whole.
const LARGEST: u64 = 1 << 30;

/// `replay`.
pub(crate) fn replay(args: &ReplayArgs, timing: &'static Timing) -> Result<Status, Failure> {
    let (log, bytes) = read(&args.log)?;
    let about = About::read(&log.about, &args.log)?;
    let config = config::resolve_over(&about.config, &args.log, &args.config)?;
    let simd = config::simd()?;
    let frames_of = InputArgs {
        camera: args.camera.clone().or(about.camera),
        start: about.start,
        ..InputArgs::default()
    };
    let dataset = open(&args.path, &frames_of)?;
    let truth = dataset.ground_truth()?;
    let frames = dataset.frames(&FrameOptions {
        start: about.start,
        max_frames: None,
        keep_colour: args.output.overlay.is_some(),
    })?;
    let named = KnownMap::of(args.load_map.as_deref(), args.localize.as_deref());
    let logged = KnownMap::of(about.load_map.as_deref(), about.localize.as_deref());
    let known = named.or(logged);
    let camera = dataset.camera().camera;
    let map = known.map(|k| k.load(&config, &camera, None)).transpose()?;
    let out = args.output.out.clone();
    let out = out.unwrap_or_else(|| default_out(&args.path, "_replay"));
    let folder = ResultFolder::create(&out)?;
    let mut outputs = outputs(&args.output, &config, &dataset, frames.remaining(), timing)?;
    let interrupt = Interrupt::listen();
    let driver = Driver {
        config: config.clone(),
        camera,
        simd,
        timing,
        interrupt: &interrupt,
        detector: None,
        map,
    };
    let mut frames = ReadAhead::new(played::Reading::new(frames, timing));
    let place = args.log.display().to_string();
    let detector = about.detector.unwrap_or_default();
    let (session, agrees) = driver
        .drive_replay(&mut frames, &mut outputs, log, detector)
        .map_err(|e| e.at(&place))?;
    let written = outputs.finish()?;
    let setup = Setup {
        input: input(&args.path, &dataset),
        config: &config,
        simd,
        timing,
        truth: truth.as_deref(),
        log: Some(bytes),
    };
    let status = finish(&setup, &session, folder, &out)?;
    console::report(&written);
    if let Some(Err(failure)) = session.saved {
        return Err(failure);
    }
    Ok(judge(agrees, status, &place))
}

/// Says whether the trajectory is that of the run; nothing when not all of it was replayed.
fn judge(agrees: Option<bool>, status: Status, log: &str) -> Status {
    match agrees {
        None => status,
        Some(true) => {
            console::report("the trajectory is that of the run, bit for bit\n");
            status
        }
        Some(false) => {
            console::line(&format!(
                "{log}: expected the trajectory of the run, found another; replay it with the program and on the data set of the run"
            ));
            Status::Failed
        }
    }
}

/// Reads a log: what it says, and its bytes.
fn read(path: &Path) -> Result<(RunLog, Vec<u8>), Failure> {
    let mut bytes = Vec::new();
    let found = File::open(path).and_then(|f| f.take(LARGEST + 1).read_to_end(&mut bytes));
    found.map_err(|e| {
        Failure::input(format!(
            "{}: expected the log of a run, found: {e}; check the path",
            path.display()
        ))
    })?;
    if bytes.len() as u64 > LARGEST {
        return Err(Failure::input(format!(
            "{}: expected a log of at most {LARGEST} bytes, found more; this program reads logs as a whole",
            path.display()
        )));
    }
    let log = RunLog::from_bytes(&bytes)
        .map_err(|e| Failure::input(format!("{}: {e}; run writes such logs", path.display())))?;
    Ok((log, bytes))
}
