//! `doctor`: what is wrong with a recording, from a few seconds of it.

use crate::args::InputArgs;
use crate::args::doctor::DoctorArgs;
use crate::console;
use crate::failure::{Failure, Status};
use crate::run::open;
use stillpoint::datasets::FrameOptions;
use stillpoint::doctor::{Setup, examine};

/// `doctor`.
pub(crate) fn doctor(args: &DoctorArgs) -> Result<Status, Failure> {
    let input = InputArgs {
        topics: args.topics.clone(),
        camera: args.camera.clone(),
        ..InputArgs::default()
    };
    let input = open(&args.path, &input)?;
    let model = input.camera();
    let setup = Setup {
        camera: model.camera,
        depth_scale: model.depth_scale,
    };
    let mut frames = input.frames(&FrameOptions {
        start: args.start,
        max_frames: None,
        keep_colour: true,
    })?;
    let report = examine(&mut frames, setup, args.seconds).map_err(Failure::input)?;
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
