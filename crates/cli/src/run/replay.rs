//! `replay`: repeats a run, bit for bit, from its log and its data set.

use crate::args::run::ReplayArgs;
use crate::args::{InputArgs, TopicArgs};
use crate::failure::{Failure, Status};
use crate::run::about::About;
use crate::run::known_map::KnownMap;
use crate::run::prologue::{Means, Task};
use crate::run::result::Voice;
use crate::sink::Repeated;
use crate::timing::Timing;
use crate::{config, console};
use std::path::Path;
use stillpoint::datasets::{ReadAhead, read_regular};
use stillpoint::slam::RunLog;

/// Maximum size of a log, bytes: that of a day. It is read into memory as a whole.
const LARGEST: u64 = 1 << 30;

pub(crate) fn replay(args: &ReplayArgs, timing: &'static Timing) -> Result<Status, Failure> {
    let (log, bytes) = read(&args.log)?;
    let about = About::read(&log.about, &args.log)?;
    let frames_of = input_of(&about, args.camera.clone());
    let task = Task {
        path: &args.path,
        input: &frames_of,
        output: &args.output,
        config: config::resolve_over(&about.config, &args.log, &args.config)?,
        done: "_replay",
        log: None,
        inputs: vec![("the log", &args.log)],
        recorder: None,
        timing,
    };
    let opened = task.open()?;
    let named = KnownMap::of(args.load_map.as_deref(), args.localize.as_deref());
    let logged = KnownMap::of(about.load_map.as_deref(), about.localize.as_deref());
    // The detections are in the log, so no colour is needed.
    let (begun, means) = opened.begin(
        named.or(logged),
        false,
        ReadAhead::DEFAULT_FRAMES,
        false,
        Repeated {
            dense: about.dense,
            things: about.things,
        },
    )?;
    let Means {
        mut frames,
        mut sinks,
        interrupt,
        map,
    } = means;
    let driver = begun.driver(&interrupt, None, map);
    let place = args.log.display().to_string();
    let detector = about.detector.unwrap_or_default();
    let session = driver
        .drive_replay(&mut frames, &mut sinks, log, detector)
        .map_err(|e| e.at(&place))?;
    let (over, found) = begun.finish(&session, sinks)?;
    let status = over.write(&session, &found, Some(bytes))?;
    let status = found.late.map_or(Ok(status), Err)?;
    let voice = Voice::of(args.output.json.json);
    Ok(judge(session.agrees, status, &place, voice))
}

/// The frames of the logged run, with another camera if given.
pub(crate) fn input_of(about: &About, camera: Option<String>) -> InputArgs {
    InputArgs {
        camera: camera.or_else(|| about.camera.clone()),
        start: about.start,
        topics: TopicArgs {
            color_topic: about.color_topic.clone(),
            depth_topic: about.depth_topic.clone(),
            info_topic: about.info_topic.clone(),
            truth_topic: about.truth_topic.clone(),
            imu_topic: about.imu_topic.clone(),
            no_imu: about.no_imu,
            odometry_topic: about.odometry_topic.clone(),
            no_odometry: about.no_odometry,
            depth_scale: about.depth_scale,
        },
        ..InputArgs::default()
    }
}

/// Reports whether the trajectory equals that of the run; nothing if the replay is incomplete.
fn judge(agrees: Option<bool>, status: Status, log: &str, voice: Voice) -> Status {
    match agrees {
        None => status,
        Some(true) => {
            voice.say("the trajectory is that of the run, bit for bit\n");
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

pub(crate) fn read(path: &Path) -> Result<(RunLog, Vec<u8>), Failure> {
    let bytes = read_regular(path, LARGEST).map_err(|e| {
        Failure::input(format!(
            "{}: expected the log of a run, found: {e}; check the path",
            path.display()
        ))
    })?;
    let log = RunLog::from_bytes(&bytes)
        .map_err(|e| Failure::input(format!("{}: {e}; run writes such logs", path.display())))?;
    Ok((log, bytes))
}
