//! `recording`: inspects recordings, converts between recordings and data set folders, and cuts.

use crate::args::recording::{
    RecordingCommand, RecordingConvertArgs, RecordingCutArgs, RecordingInfoArgs,
};
use crate::args::{InputArgs, TopicArgs};
use crate::console;
use crate::failure::{Failure, Status};
use crate::input::{open, options};
use serde::Serialize;
use std::fmt::Write;
use std::ops::Range;
use std::path::Path;
use stillpoint::datasets::{ColourFormat, FrameOptions, ReadAhead, Recorder, StampedPose};
use stillpoint::imaging::{FrameSource, ImuSample, OdometrySample, RgbdFrame};
use stillpoint::recordings::{self, Info, Input, McapRecorder};

pub(crate) fn recording(command: &RecordingCommand) -> Result<Status, Failure> {
    match command {
        RecordingCommand::Info(args) => info(args),
        RecordingCommand::Convert(args) => convert(args),
        RecordingCommand::Cut(args) => cut(args),
    }
}

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

/// The topics that a run would use, for `--json`.
#[derive(Serialize)]
struct InfoJson<'a> {
    path: String,
    format: &'a str,
    topics: Vec<TopicJson<'a>>,
    remarks: &'a [String],
    /// Number of frames of a run, and its guesses; `None` where a run would refuse the input.
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

#[derive(Serialize)]
struct Written {
    path: String,
    frames: usize,
    left_out: usize,
    first: Option<f64>,
    last: Option<f64>,
    poses: usize,
    inertial: usize,
    odometry: usize,
}

impl Written {
    fn say(&self, json: bool) -> Result<Status, Failure> {
        if json {
            let text = serde_json::to_string(self).map_err(Failure::input)?;
            console::print(&format!("{text}\n"));
        } else {
            let samples = |n: usize, of: &str| match n {
                0 => String::new(),
                n => format!(", {n} samples of {of}"),
            };
            console::report(&format!(
                "{}: {} frames, {} poses of ground truth{}{}\n",
                self.path,
                self.frames,
                self.poses,
                samples(self.inertial, "an inertial sensor"),
                samples(self.odometry, "odometry"),
            ));
        }
        Ok(if self.left_out > 0 {
            Status::Failed
        } else {
            Status::Ok
        })
    }
}

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

    fn add_inertial(&mut self, samples: &[ImuSample]) -> Result<(), Failure> {
        match self {
            Self::Mcap(r) => r.add_inertial(samples)?,
            Self::Folder(r) => r.add_inertial(samples),
        }
        Ok(())
    }

    fn add_odometry(&mut self, samples: &[OdometrySample]) -> Result<usize, Failure> {
        match self {
            Self::Mcap(r) => Ok(r.add_odometry(samples)?),
            Self::Folder(r) => {
                r.add_odometry(samples);
                Ok(samples.len())
            }
        }
    }
}

fn is_mcap(path: &Path) -> bool {
    path.extension()
        .is_some_and(|e| e.eq_ignore_ascii_case("mcap"))
}

fn convert(args: &RecordingConvertArgs) -> Result<Status, Failure> {
    let input = open(&args.path, &input_args(&args.topics, args.camera.as_ref()))?;
    let written = write(&input, &args.out, args.start, args.max_frames)?;
    written.say(args.json)
}

fn cut(args: &RecordingCutArgs) -> Result<Status, Failure> {
    if !is_mcap(&args.out) {
        return Err(Failure::input(format!(
            "{}: expected a name that ends with .mcap, found another; a part is written as MCAP, and recording convert makes a folder of it",
            args.out.display()
        )));
    }
    let input = open(&args.path, &input_args(&args.topics, args.camera.as_ref()))?;
    let stamps: Vec<f64> = input.stamps().iter().map(|s| s.0).collect();
    let within = part(&stamps, args.start_time, args.end_time);
    let first = args.start.unwrap_or(within.start);
    let left = within.end.saturating_sub(first);
    let count = args.max_frames.map_or(left, |n| left.min(n as usize));
    if count == 0 {
        let length = stamps
            .last()
            .zip(stamps.first())
            .map_or(0.0, |(l, f)| l - f);
        return Err(Failure::input(format!(
            "{}: expected a part with frames, found none in it; the recording has {} frames and lasts {length:.3} s",
            args.path.display(),
            stamps.len()
        )));
    }
    let written = write(&input, &args.out, first, Some(count as u64))?;
    written.say(args.json)
}

/// The frames from `start` and before `end`, both in s after the first frame. Stamps are sorted.
fn part(stamps: &[f64], start: Option<f64>, end: Option<f64>) -> Range<usize> {
    let origin = stamps.first().copied().unwrap_or(0.0);
    let before = |time: f64| stamps.partition_point(|s| s - origin < time);
    start.map_or(0, before)..end.map_or(stamps.len(), before)
}

/// Starts the output for an input from a frame on, with the mounting of its other sensors.
fn target(input: &Input, out: &Path, start: usize) -> Result<Target, Failure> {
    let (model, imu, wheels) = (input.camera(), input.imu(), input.odometry());
    if is_mcap(out) {
        let mut recorder = McapRecorder::create(out, &model.camera)?;
        let first = input.stamps().get(start).map_or(0.0, |s| s.0);
        if let Some(imu) = &imu {
            recorder.add_imu(imu, first)?;
        }
        if let Some(wheels) = &wheels {
            recorder.add_base(wheels, first)?;
        }
        return Ok(Target::Mcap(Box::new(recorder)));
    }
    let mut recorder = Recorder::create(out, &model.camera, &model.name, ColourFormat::Png)?;
    if let Some(imu) = imu {
        recorder = recorder.with_imu(imu);
    }
    if let Some(wheels) = wheels {
        recorder = recorder.with_odometry(wheels);
    }
    Ok(Target::Folder(Box::new(recorder)))
}

/// Writes frames of an input, and the ground truth of their time.
fn write(
    input: &Input,
    out: &Path,
    start: usize,
    max_frames: Option<u64>,
) -> Result<Written, Failure> {
    let truth = input.ground_truth()?.unwrap_or_default();
    let frames = input.frames(&FrameOptions {
        start,
        max_frames: max_frames.map(|n| n as usize),
        keep_colour: true,
    })?;
    let mut target = target(input, out, start)?;
    let mut frames = ReadAhead::new(frames);
    let (mut written, mut skipped, mut inertial, mut odometry) = (0, 0, 0, 0);
    let mut times: Option<(f64, f64)> = None;
    while let Some(frame) = frames.next_frame() {
        let samples = frames.take_inertial();
        target.add_inertial(&samples)?;
        inertial += samples.len();
        odometry += target.add_odometry(&frames.take_odometry())?;
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
    // One second of margin, so that poses can be interpolated at the ends.
    let within = |p: &&StampedPose| p.stamp >= first - 1.0 && p.stamp <= last + 1.0;
    let truth: Vec<StampedPose> = truth.iter().filter(within).copied().collect();
    finish(target, out, &truth)?;
    Ok(Written {
        path: out.display().to_string(),
        frames: written,
        left_out: skipped,
        first: times.map(|t| t.0),
        last: times.map(|t| t.1),
        poses: truth.len(),
        inertial,
        odometry,
    })
}

/// Completes the output, with the ground truth of the time of its frames.
fn finish(target: Target, out: &Path, truth: &[StampedPose]) -> Result<(), Failure> {
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
                stillpoint::datasets::trajectory::write(&out.join("groundtruth.txt"), truth)?;
            }
        }
    }
    Ok(())
}

#[cfg(test)]
mod tests {
    use super::part;

    #[test]
    fn time_range_includes_start_and_excludes_end() {
        let stamps = [5.0, 5.25, 5.5, 5.75];
        for (start, end, expected) in [
            (None, None, 0..4),
            (Some(0.25), None, 1..4),
            (None, Some(0.5), 0..2),
            (Some(0.1), Some(0.6), 1..3),
            (Some(9.0), None, 4..4),
        ] {
            assert_eq!(part(&stamps, start, end), expected, "{start:?} {end:?}");
        }
        assert!(part(&stamps, Some(0.5), Some(0.25)).is_empty());
        assert_eq!(part(&[], Some(0.0), None), 0..0);
    }
}
