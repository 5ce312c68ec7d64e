//! `--detector`: from the argument to a detector, checked before the first frame is read.

use crate::failure::Failure;
use std::path::Path;
use stillpoint::datasets::Entry;
use stillpoint::detection::{Detector, ModelError, OnnxDetector, OnnxOptions, ScriptedDetector};
use stillpoint::imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};

/// What `--detector` names.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
enum Choice<'a> {
    None,
    Scripted(&'a str),
    Onnx(&'a str),
}

/// The detector that the argument names, for a recording with these frames; `None` for `none`.
///
/// # Errors
/// A name of no detector, a file that cannot be read, a model or script that cannot be used, a script of another recording.
pub(crate) fn load(
    argument: &str,
    entries: &[Entry],
) -> Result<Option<Box<dyn Detector>>, Failure> {
    Ok(match parse(argument)? {
        Choice::None => None,
        Choice::Scripted(file) => Some(Box::new(script(file, entries)?)),
        Choice::Onnx(file) => {
            let bytes =
                std::fs::read(file).map_err(|e| unreadable(file, "the model of a detector", &e))?;
            let detector = OnnxDetector::from_bytes(bytes, file, &OnnxOptions::default())
                .map_err(|e| Failure::input(format!("--detector {}", shortened(e))))?;
            Some(Box::new(detector))
        }
    })
}

/// Whether the detector looks at colour images.
pub(crate) fn needs_colour(argument: &str) -> bool {
    matches!(parse(argument), Ok(Choice::Onnx(_)))
}

fn parse(argument: &str) -> Result<Choice<'_>, Failure> {
    let extension = |file: &str| {
        Path::new(file)
            .extension()
            .map(|e| e.to_string_lossy().to_lowercase())
    };
    match argument.split_once(':') {
        _ if argument == "none" => Ok(Choice::None),
        Some(("scripted", file)) if !file.is_empty() => Ok(Choice::Scripted(file)),
        _ if extension(argument).as_deref() == Some("onnx") => Ok(Choice::Onnx(argument)),
        _ => {
            let advice = match extension(argument).as_deref() {
                Some("csv" | "txt") => format!("did you mean scripted:{argument}?"),
                _ => "give the model's file, whose name ends with .onnx".to_owned(),
            };
            Err(Failure::input(format!(
                "--detector: expected none, scripted:FILE.csv or FILE.onnx, found \"{argument}\"; {advice}"
            )))
        }
    }
}

/// Models that are something else may have hundreds of inputs: the first ones say enough.
fn shortened(error: ModelError) -> ModelError {
    const LONGEST: usize = 160;
    match error {
        ModelError::Interface { name, found } if found.chars().count() > LONGEST => {
            let found: String = found.chars().take(LONGEST).chain("...".chars()).collect();
            ModelError::Interface { name, found }
        }
        other => other,
    }
}

fn unreadable(file: &str, what: &str, reason: &std::io::Error) -> Failure {
    Failure::input(format!(
        "--detector {file}: expected {what}, found: {reason}; check the path"
    ))
}

/// A script, tried on the stamps of all frames: one that belongs to another recording would see nothing in a long run.
fn script(file: &str, entries: &[Entry]) -> Result<ScriptedDetector, Failure> {
    let text = std::fs::read_to_string(file)
        .map_err(|e| unreadable(file, "a script of detections", &e))?;
    let detector = ScriptedDetector::parse(file, &text)
        .map_err(|e| Failure::input(format!("--detector {e}")))?;
    let mut trial = detector.clone();
    for entry in entries {
        let found = trial.detect(&RgbdFrame {
            id: FrameId(0),
            stamp: entry.stamp,
            depth_stamp: entry.depth_stamp,
            gray: GrayImage::new(0, 0),
            colour: None,
            depth: DepthImage::default(),
        });
        if found.is_ok_and(|d| !d.items.is_empty()) {
            return Ok(detector);
        }
    }
    match trial.remark() {
        // A recording in which nothing was seen is possible: its remark comes at the end.
        Some(remark) if !detector.rows().is_empty() => Err(Failure::input(format!(
            "--detector: expected a script of this recording, found another: {remark}"
        ))),
        _ => Ok(detector),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn arguments_name_detectors() {
        for (argument, choice) in [
            ("none", Choice::None),
            ("scripted:a:b.csv", Choice::Scripted("a:b.csv")),
            ("models/yolox.ONNX", Choice::Onnx("models/yolox.ONNX")),
            ("c:/yolox.onnx", Choice::Onnx("c:/yolox.onnx")),
        ] {
            assert_eq!(parse(argument).ok(), Some(choice), "{argument}");
        }
        for (argument, part) in [
            ("yolox", "whose name ends with .onnx"),
            ("scripted:", "scripted:FILE.csv"),
            ("boxes.csv", "did you mean scripted:boxes.csv?"),
            ("None", "expected none"),
            ("", "found \"\""),
        ] {
            let e = parse(argument).unwrap_err().to_string();
            assert!(e.contains(part), "{e}");
        }
    }
}
