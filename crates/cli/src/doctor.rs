//! `doctor`: diagnoses a recording from a few seconds of it.

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

/// Path argument that means the connected camera.
const LIVE: &str = "live";

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
    // Refuses the inputs that `run` refuses: images of any size would take any amount of time and memory.
    let camera = input.camera().camera;
    System::new(Config::default(), camera, Simd::detect()).map_err(Failure::input)?;
    let mut report = look(&input, start, None, args.seconds)?;
    judge_clock(
        input.set_back().iter().map(|at| (at.index, at.by)),
        &mut report,
    );
    // Errors of geometry or clocks would be taken for a readout.
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

/// Examines an input for this many seconds and at most this many frames.
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

/// Maximum standard deviation of a readout estimate that is reported, s: a tenth of typical readouts, and a quarter of its standard
/// deviation before the first frame.
const MAX_SIGMA: f64 = 0.005;

/// Error that three seconds leave beyond the estimated sigma, s: on five streams of known readout (fr1_xyz, fr1_rpy_walkers, and the
/// simulator's xyz, rpy and rpy_100) the estimate was 0, 17, 0, 1 and 8 ms off, most in fast turns.
const SYSTEMATIC: f64 = 0.008;

struct Followed {
    /// The readout of the colour images; `None` where the frames do not determine it.
    readout: Option<Figure>,
    /// Stamps, s, and `world_from_camera` of the tracked frames.
    poses: Vec<(f64, Se3)>,
    /// Inertial and wheel samples of that time, which tracking did not use.
    samples: Vec<ImuSample>,
    wheels: Vec<OdometrySample>,
}

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

/// Duration that is examined beside a run, s: enough for all findings.
const SECONDS: f64 = 3.0;
/// Maximum number of printed findings, the most harmful first.
const TOLD: usize = 3;

/// Examines the input on a thread of lower priority while the run starts, so that problems are reported in its first seconds. `None` if the
/// console is quiet.
pub(crate) fn beside_run(path: &Path, input: &InputArgs) -> Option<JoinHandle<()>> {
    if console::is_quiet() {
        return None;
    }
    let (path, input) = (path.to_owned(), input.clone());
    let work = move || {
        priority::lower(Stage::Detection);
        // Keeps the spans of this thread out of the run's timing and trace.
        tracing::subscriber::with_default(NoSubscriber::default(), || tell(&path, &input));
    };
    std::thread::Builder::new()
        .name("doctor".to_owned())
        .spawn(work)
        .ok()
}

/// Prints a line per finding, the most harmful first; nothing if there are none.
fn tell(path: &Path, input: &InputArgs) {
    // The run itself reports an unreadable input.
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
