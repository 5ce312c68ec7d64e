//! `recording`: what is in a recording, and conversions between recordings and data set folders.

use crate::args::recording::{RecordingCommand, RecordingConvertArgs, RecordingInfoArgs};
use crate::args::{InputArgs, TopicArgs};
use crate::console;
use crate::failure::{Failure, Status};
use crate::run::{open, options};
use serde::Serialize;
use std::fmt::Write;
use stillpoint::datasets::{ColourFormat, FrameOptions, ReadAhead, Recorder, StampedPose};
use stillpoint::imaging::{FrameSource, RgbdFrame};
use stillpoint::recordings::{self, Info, Input, McapRecorder};

/// `recording`.
pub(crate) fn recording(command: &RecordingCommand) -> Result<Status, Failure> {
    match command {
        RecordingCommand::Info(args) => info(args),
        RecordingCommand::Convert(args) => convert(args),
    }
}

/// A topic, for `--json`.
#[derive(Serialize)]
struct TopicJson<'a> {
    name: &'a str,
    r#type: &'a str,
    messages: u64,
    #[serde(skip_serializing_if = "Option::is_none")]
    first: Option<f64>,
    #[serde(skip_serializing_if = "Option::is_none")]
    last: Option<f64>,
}

/// What a run would make of a recording, for `--json`.
#[derive(Serialize)]
struct InfoJson<'a> {
    path: String,
    format: &'a str,
    topics: Vec<TopicJson<'a>>,
    remarks: &'a [String],
    /// Frames that a run would get, and what was guessed for it; none where it would be refused.
    #[serde(skip_serializing_if = "Option::is_none")]
    frames: Option<usize>,
    guesses: Vec<String>,
    #[serde(skip_serializing_if = "Option::is_none")]
    refused: Option<String>,
}

fn input_args(topics: &TopicArgs, camera: Option<&String>) -> InputArgs {
    InputArgs {
        topics: topics.clone(),
        camera: camera.cloned(),
        ..InputArgs::default()
    }
}

fn info(args: &RecordingInfoArgs) -> Result<Status, Failure> {
    let found = recordings::info(&args.path)?;
    let opened = recordings::open(&args.path, &options(&input_args(&args.topics, None)));
    if args.json {
        let json = InfoJson {
            path: args.path.display().to_string(),
            format: found.format,
            topics: found.topics.iter().map(topic_json).collect(),
            remarks: &found.remarks,
            frames: opened.as_ref().ok().map(|i| i.stamps().len()),
            guesses: opened.as_ref().map_or(Vec::new(), |i| i.guesses().to_vec()),
            refused: opened.as_ref().err().map(ToString::to_string),
        };
        let text = serde_json::to_string(&json).map_err(Failure::input)?;
        console::print(&format!("{text}\n"));
    } else {
        console::print(&text(&found, &opened));
    }
    Ok(Status::Ok)
}

fn topic_json(topic: &recordings::Topic) -> TopicJson<'_> {
    TopicJson {
        name: &topic.name,
        r#type: &topic.type_name,
        messages: topic.messages,
        first: topic.received.map(|r| r.0),
        last: topic.received.map(|r| r.1),
    }
}

fn text(found: &Info, opened: &Result<Input, recordings::RecordingError>) -> String {
    let times = found.topics.iter().filter_map(|t| t.received);
    let (first, last) = times.fold((f64::INFINITY, f64::NEG_INFINITY), |(a, b), (f, l)| {
        (a.min(f), b.max(l))
    });
    let mut text = String::from(found.format);
    if first <= last {
        let _ = write!(text, ", {:.1} s", last - first);
    }
    text += "\n";
    let width = |of: fn(&recordings::Topic) -> &str| {
        let lengths = found.topics.iter().map(|t| of(t).chars().count());
        lengths.max().unwrap_or(0)
    };
    let (names, types) = (width(|t| &t.name), width(|t| &t.type_name));
    for t in &found.topics {
        let line = format!(
            "  {:names$}  {:types$}  {:>8}",
            t.name, t.type_name, t.messages
        );
        text += &format!("{}\n", console::harmless(&line));
    }
    for remark in &found.remarks {
        let _ = writeln!(text, "{remark}");
    }
    match opened {
        Ok(input) => {
            for line in input.guesses() {
                let _ = writeln!(text, "{line}");
            }
        }
        Err(e) => {
            let _ = writeln!(text, "no RGB-D camera: {e}");
        }
    }
    text
}

/// What is written.
enum Target {
    Mcap(Box<McapRecorder>),
    Folder(Box<Recorder>),
}

impl Target {
    fn add(&mut self, frame: &RgbdFrame) -> Result<(), Failure> {
        match self {
            Self::Mcap(r) => Ok(r.add(frame)?),
            Self::Folder(r) => Ok(r.add(frame, None)?),
        }
    }
}

fn convert(args: &RecordingConvertArgs) -> Result<Status, Failure> {
    let input = open(&args.path, &input_args(&args.topics, args.camera.as_ref()))?;
    let truth = input.ground_truth()?.unwrap_or_default();
    let frames = input.frames(&FrameOptions {
        start: args.start,
        max_frames: args.max_frames.map(|n| n as usize),
        keep_colour: true,
    })?;
    let model = input.camera();
    let is_mcap = args
        .out
        .extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("mcap"));
    let mut target = if is_mcap {
        Target::Mcap(Box::new(McapRecorder::create(&args.out, &model.camera)?))
    } else {
        let recorder = Recorder::create(&args.out, &model.camera, &model.name, ColourFormat::Png)?;
        Target::Folder(Box::new(recorder))
    };
    let mut frames = ReadAhead::new(frames);
    let (mut written, mut skipped) = (0, 0);
    let mut times: Option<(f64, f64)> = None;
    while let Some(frame) = frames.next_frame() {
        match frame {
            Ok(frame) => {
                target.add(&frame)?;
                written += 1;
                times = Some((times.map_or(frame.stamp, |t| t.0), frame.stamp));
            }
            Err(e) if e.recoverable => {
                console::warn(&e.message);
                skipped += 1;
            }
            Err(e) => return Err(Failure::input(e)),
        }
    }
    let (first, last) = times.unwrap_or((f64::INFINITY, f64::NEG_INFINITY));
    // A second around, so that poses can be interpolated at the ends.
    let within = |p: &&StampedPose| p.stamp >= first - 1.0 && p.stamp <= last + 1.0;
    let truth: Vec<StampedPose> = truth.iter().filter(within).copied().collect();
    finish(target, args, &truth)?;
    console::report(&format!(
        "{}: {written} frames, {} poses of ground truth\n",
        args.out.display(),
        truth.len()
    ));
    Ok(if skipped > 0 {
        Status::Failed
    } else {
        Status::Ok
    })
}

/// Ends what is written, with the ground truth of the time of its frames.
fn finish(
    target: Target,
    args: &RecordingConvertArgs,
    truth: &[StampedPose],
) -> Result<(), Failure> {
    match target {
        Target::Mcap(mut recorder) => {
            for pose in truth {
                recorder.add_truth(pose)?;
            }
            recorder.finish()?;
        }
        Target::Folder(recorder) => {
            recorder.finish()?;
            if !truth.is_empty() {
                stillpoint::datasets::trajectory::write(&args.out.join("groundtruth.txt"), truth)?;
            }
        }
    }
    Ok(())
}
