//! `doctor`: what is wrong with a recording, from a few seconds of it.

use crate::args::InputArgs;
use crate::args::doctor::DoctorArgs;
use crate::console;
use crate::failure::{Failure, Status};
use crate::run::{open, options};
use std::path::Path;
use stillpoint::datasets::FrameOptions;
use stillpoint::doctor::{Report, Setup, examine};
use stillpoint::recordings::{self, Input};

/// `doctor`.
pub(crate) fn doctor(args: &DoctorArgs) -> Result<Status, Failure> {
    let input = InputArgs {
        topics: args.topics.clone(),
        camera: args.camera.clone(),
        ..InputArgs::default()
    };
    let input = open(&args.path, &input)?;
    let report = look(&input, args.start, args.seconds)?;
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

/// Examines so many seconds of an input.
fn look(input: &Input, start: usize, seconds: f64) -> Result<Report, Failure> {
    let model = input.camera();
    let setup = Setup {
        camera: model.camera,
        depth_scale: model.depth_scale,
    };
    let mut frames = input.frames(&FrameOptions {
        start,
        max_frames: None,
        keep_colour: true,
    })?;
    examine(&mut frames, setup, seconds).map_err(Failure::input)
}

/// What a run of it looks at, s: enough for all that there is to find.
const SECONDS: f64 = 3.0;
/// Findings that are told at most; the first do most harm.
const TOLD: usize = 3;

/// The short form after a run: a line for each thing that is wrong with its input, the most harmful first, and nothing where nothing is.
pub(crate) fn after_run(path: &Path, input: &InputArgs) {
    if console::is_quiet() {
        return;
    }
    // The run has said what cannot be read.
    let Ok(opened) = recordings::open(path, &options(input)) else {
        return;
    };
    let Ok(report) = look(&opened, input.start, SECONDS) else {
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
