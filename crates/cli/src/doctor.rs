//! `doctor`: what is wrong with a recording, from a few seconds of it.

use crate::args::InputArgs;
use crate::args::doctor::DoctorArgs;
use crate::console;
use crate::failure::{Failure, Status};
use crate::input::{open, options};
use crate::priority;
use crate::realsense::seconds::some_seconds;
use std::path::Path;
use std::thread::JoinHandle;
use stillpoint::datasets::FrameOptions;
use stillpoint::doctor::{
    Figure, Report, Setup, examine, judge_clock, judge_inertial, judge_odometry,
};
use stillpoint::geometry::Se3;
use stillpoint::imaging::{FrameSource, ImuSample, OdometrySample, Simd};
use stillpoint::live::Stage;
use stillpoint::recordings::{self, Input};
use stillpoint::slam::{Config, Event, System};
use tracing::subscriber::NoSubscriber;

/// Stands for the camera that is connected.
const LIVE: &str = "live";

/// `doctor`.
pub(crate) fn doctor(args: &DoctorArgs) -> Result<Status, Failure> {
    let input = InputArgs {
        topics: args.topics.clone(),
        camera: args.camera.clone(),
        ..InputArgs::default()
    };
    let (input, start) = if args.path.as_os_str() == LIVE && !args.path.exists() {
        let kept = some_seconds(args.playback.clone(), args.start, args.seconds)?;
        (kept, 0)
    } else {
        (open(&args.path, &input)?, args.start)
    };
    // An input that `run` refuses is refused here too: images of any size would take any amount of time and memory.
    let camera = input.camera().camera;
    System::new(Config::default(), camera, Simd::detect()).map_err(Failure::input)?;
    let mut report = look(&input, start, None, args.seconds)?;
    judge_clock(
        input.set_back().iter().map(|at| (at.index, at.by)),
        &mut report,
    );
    // What is wrong with the geometry or the clocks would be learned as a readout.
    if report.findings.is_empty() {
        let followed = follow(&input, start, report.frames)?;
        match followed.readout {
            Some(figure) => report.measured.push(figure),
            None => report
                .not_judged
                .push("the readout of a rolling shutter: these seconds do not tell it".into()),
        }
        if let Some(imu) = input.imu() {
            let turn = |p: &(f64, Se3)| (p.0, p.1.rotation);
            let turns: Vec<_> = followed.poses.iter().map(turn).collect();
            judge_inertial(&followed.samples, &turns, &imu, &mut report);
        }
        if let Some(wheels) = input.odometry() {
            judge_odometry(&followed.wheels, &followed.poses, &wheels, &mut report);
        }
    }
    if args.json {
        let text = serde_json::to_string(&report).map_err(Failure::input)?;
        console::print(&format!("{text}\n"));
    } else {
        console::print(&report.to_string());
    }
    Ok(if report.findings.is_empty() {
        Status::Ok
    } else {
        Status::Failed
    })
}

/// Examines so many seconds of an input, and at most so many frames.
fn look(
    input: &Input,
    start: usize,
    max_frames: Option<u64>,
    seconds: f64,
) -> Result<Report, Failure> {
    let model = input.camera();
    let setup = Setup {
        camera: model.camera,
        depth_scale: model.depth_scale,
    };
    let mut frames = input.frames(&FrameOptions {
        start,
        max_frames: max_frames.map(|n| n as usize),
        keep_colour: false,
    })?;
    examine(&mut frames, setup, seconds).map_err(Failure::input)
}

/// Standard deviation of a readout that says something, s: a tenth of what readouts are, and a quarter of what they may be before the first frame.
const MAX_SIGMA: f64 = 0.005;

/// What three seconds leave open beyond that, s: on five streams whose readout is known (fr1_xyz, fr1_rpy_walkers, and the simulator's xyz, rpy and rpy_100)
/// the estimate was 0, 17, 0, 1 and 8 ms off, the most in fast turns.
const SYSTEMATIC: f64 = 0.008;

/// What tracking made of some seconds.
struct Followed {
    /// The readout of the colour images; none where the frames tell nothing of it.
    readout: Option<Figure>,
    /// Stamps, s, and `world_from_camera` of the frames that were tracked.
    poses: Vec<(f64, Se3)>,
    /// What an inertial sensor measured and the wheels did meanwhile; tracking did not listen to them.
    samples: Vec<ImuSample>,
    wheels: Vec<OdometrySample>,
}

/// Tracks the same frames, as many as were looked at.
fn follow(input: &Input, start: usize, count: usize) -> Result<Followed, Failure> {
    let camera = input.camera().camera;
    let mut system =
        System::new(Config::default(), camera, Simd::detect()).map_err(Failure::input)?;
    let mut frames = input.frames(&FrameOptions {
        start,
        ..FrameOptions::default()
    })?;
    let (mut samples, mut wheels, mut poses) = (Vec::new(), Vec::new(), Vec::new());
    for _ in 0..count {
        let Some(Ok(frame)) = frames.next_frame() else {
            break;
        };
        samples.extend(frames.take_inertial());
        wheels.extend(frames.take_odometry());
        for event in system.step(frame) {
            if let Event::Frame(frame) = event {
                let report = &frame.report;
                poses.extend(report.world_from_camera.map(|p| (report.stamp, p)));
            }
        }
    }
    let sigma = system.timing().readout_sigma;
    let readout = (sigma <= MAX_SIGMA).then(|| Figure {
        name: "readout of a rolling shutter",
        value: 1000.0 * system.timing().readout,
        sigma: Some(1000.0 * sigma.hypot(SYSTEMATIC)),
        unit: "ms",
    });
    Ok(Followed {
        readout,
        poses,
        samples,
        wheels,
    })
}

/// What a run of it looks at, s: enough for all that there is to find.
const SECONDS: f64 = 3.0;
/// Findings that are told at most; the first do most harm.
const TOLD: usize = 3;

/// Examines the input on a thread of lower priority while the run begins, so that faults are told in its first seconds. None where the console is quiet.
pub(crate) fn beside_run(path: &Path, input: &InputArgs) -> Option<JoinHandle<()>> {
    if console::is_quiet() {
        return None;
    }
    let (path, input) = (path.to_owned(), input.clone());
    let work = move || {
        priority::lower(Stage::Detection);
        // Spans of this thread stay out of the run's times and trace.
        tracing::subscriber::with_default(NoSubscriber::default(), || tell(&path, &input));
    };
    std::thread::Builder::new()
        .name("doctor".to_owned())
        .spawn(work)
        .ok()
}

/// The short form: a line for each thing that is wrong with an input, the most harmful first, and nothing where nothing is.
fn tell(path: &Path, input: &InputArgs) {
    // The run has said what cannot be read.
    let Ok(opened) = recordings::open(path, &options(input)) else {
        return;
    };
    let Ok(report) = look(&opened, input.start, input.max_frames, SECONDS) else {
        return;
    };
    for finding in report.findings.iter().take(TOLD) {
        console::warn(&format!("{}; {}", finding.message, finding.remedy));
    }
    if !report.findings.is_empty() {
        console::info(&format!(
            "stillpoint doctor {} says what that rests on",
            path.display()
        ));
    }
}
