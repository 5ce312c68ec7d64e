//! `--detector`: from the argument to a detector, checked before the first frame is read.

pub(crate) mod file;
pub(crate) mod network;
pub(crate) mod runtime;
pub(crate) mod tried;

use crate::args::forward::is_of_recording;
use crate::args::models::DetectorArgs;
use crate::console;
use crate::detector::file::{ModelFile, is_onnx};
use crate::detector::network::Running;
use crate::failure::Failure;
use crate::models::cache::{self, Preferred};
use std::path::Path;
use stillpoint::datasets::{read_regular, read_regular_text};
use stillpoint::detection::{Detector, ScriptedDetector};
use stillpoint::imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};

const OPTION: &str = "--detector";

#[derive(Clone, Debug, PartialEq, Eq)]
enum Choice {
    None,
    Scripted(String),
    Model(ModelFile),
}

#[derive(Clone, Debug)]
pub(crate) struct Settled {
    choice: Choice,
    /// The `--detector` argument that gives the same choice.
    pub(crate) argument: String,
    /// Why it was chosen, where the user named none.
    pub(crate) reason: Option<String>,
}

impl Settled {
    /// True unless the choice is `none`.
    pub(crate) fn looks(&self) -> bool {
        self.choice != Choice::None
    }
}

/// Resolves the arguments; without `--detector` the preferred model of the cache, else none.
///
/// # Errors
/// An unknown detector, a cache that cannot be read.
pub(crate) fn settle(args: &DetectorArgs) -> Result<Settled, Failure> {
    if let Some(argument) = &args.detector {
        return Ok(Settled {
            choice: parse(argument)?,
            argument: argument.clone(),
            reason: None,
        });
    }
    let preferred = cache::preferred()
        .map_err(|e| Failure::input(format!("{e}; --detector none runs without a detector")))?;
    Ok(match preferred {
        Preferred::Model(model) => Settled {
            argument: model.name.clone(),
            choice: Choice::Model(model),
            reason: Some("it is in the cache; --detector none does without".to_owned()),
        },
        Preferred::None(reason) => Settled::none(reason),
    })
}

impl Settled {
    pub(crate) fn none(reason: impl Into<String>) -> Self {
        Self {
            choice: Choice::None,
            argument: "none".to_owned(),
            reason: Some(reason.into()),
        }
    }

    pub(crate) fn words(&self) -> String {
        match &self.reason {
            Some(reason) => format!("{} ({reason})", self.argument),
            None => self.argument.clone(),
        }
    }

    pub(crate) fn is_none(&self) -> bool {
        self.choice == Choice::None
    }

    /// Prints a choice that was made automatically.
    pub(crate) fn announce(&self) {
        if self.reason.is_some() {
            console::info(&format!("detector: {}", self.words()));
        }
    }

    /// What determines its results besides the argument: the bytes of a model and its card, or of a script. Empty for a script that is part
    /// of each recording.
    ///
    /// # Errors
    /// An unreadable file.
    pub(crate) fn content(&self) -> Result<Vec<u8>, Failure> {
        match &self.choice {
            Choice::Scripted(file) if !is_of_recording(file) => {
                read_regular(file.as_ref(), LARGEST_SCRIPT)
                    .map_err(|e| Failure::input(format!("{OPTION} scripted:{file}: expected a script of detections, found: {e}; check the path")))
            }
            Choice::None | Choice::Scripted(_) => Ok(Vec::new()),
            Choice::Model(model) => {
                let content = model
                    .read()
                    .map_err(|e| Failure::input(format!("{OPTION} {e}")))?;
                let card = content.card.map(|(_, text)| text).unwrap_or_default();
                Ok([content.bytes, card.into_bytes()].concat())
            }
        }
    }

    pub(crate) fn needs_colour(&self) -> bool {
        matches!(self.choice, Choice::Model(_))
    }
}

#[derive(Default)]
pub(crate) struct Loaded {
    pub(crate) detector: Option<Box<dyn Detector>>,
    /// The library that runs its network, unless built in.
    pub(crate) library: Option<String>,
}

/// Loads the detector for a recording whose frames have these colour and depth stamps, s.
///
/// # Errors
/// An unreadable file, an unusable model or script, a script of another recording.
pub(crate) fn load(
    settled: &Settled,
    args: &DetectorArgs,
    stamps: &[(f64, f64)],
) -> Result<Loaded, Failure> {
    match &settled.choice {
        Choice::Scripted(file) => Ok(Loaded {
            detector: Some(Box::new(script(file, stamps)?)),
            library: None,
        }),
        _ => load_untried(settled, args),
    }
}

/// Like [`load`], for live frames: a script is not compared with stamps.
pub(crate) fn load_untried(settled: &Settled, args: &DetectorArgs) -> Result<Loaded, Failure> {
    match &settled.choice {
        Choice::None => Ok(Loaded::default()),
        Choice::Scripted(file) => Ok(Loaded {
            detector: Some(Box::new(read_script(file)?)),
            library: None,
        }),
        Choice::Model(model) => {
            let how = Running::new(args.runtime, args.detector_threads);
            let network = tried::open(model, &how, OPTION).map_err(|e| {
                if settled.reason.is_some() {
                    // The user did not ask for a model, so say how to go on without.
                    Failure::input(format!("{e}; --detector none runs without a detector"))
                } else {
                    e
                }
            })?;
            Ok(Loaded {
                detector: Some(Box::new(network.detector)),
                library: network.library,
            })
        }
    }
}

fn parse(argument: &str) -> Result<Choice, Failure> {
    let extension = Path::new(argument).extension();
    let extension = extension.map(|e| e.to_string_lossy().to_lowercase());
    match argument.split_once(':') {
        _ if argument == "none" => Ok(Choice::None),
        Some(("scripted", file)) if !file.is_empty() => Ok(Choice::Scripted(file.to_owned())),
        _ if is_onnx(argument) => Ok(Choice::Model(ModelFile::of_file(argument))),
        Some(_) => Err(refused(
            argument,
            "give the model's file, whose name ends with .onnx",
        )),
        None => match extension.as_deref() {
            Some("csv" | "txt") => Err(refused(
                argument,
                &format!("did you mean scripted:{argument}?"),
            )),
            Some("pt" | "pth") => Err(refused(
                argument,
                &format!("make it ONNX with `stillpoint models import {argument}`"),
            )),
            _ => cache::named(argument, OPTION).map(Choice::Model),
        },
    }
}

fn refused(argument: &str, advice: &str) -> Failure {
    Failure::input(format!(
        "{OPTION}: expected none, scripted:FILE.csv, FILE.onnx or the name of a model in the cache, found \"{argument}\"; {advice}"
    ))
}

/// Maximum size of a script, bytes: a day of crowds has some hundred megabytes.
const LARGEST_SCRIPT: u64 = 1 << 30;

/// A script, checked against the stamps of all frames: one of another recording would give no detections throughout.
fn script(file: &str, stamps: &[(f64, f64)]) -> Result<ScriptedDetector, Failure> {
    let detector = read_script(file)?;
    let mut trial = detector.clone();
    for (stamp, depth_stamp) in stamps.iter().copied() {
        let found = trial.detect(&RgbdFrame {
            id: FrameId(0),
            stamp,
            depth_stamp,
            gray: GrayImage::new(0, 0),
            colour: None,
            depth: DepthImage::default(),
        });
        if found.is_ok_and(|d| !d.items.is_empty()) {
            return Ok(detector);
        }
    }
    match trial.remark() {
        // A script without rows is possible: its remark comes at the end of the run.
        Some(remark) if !detector.rows().is_empty() => Err(Failure::input(format!(
            "--detector: expected a script of this recording, found another: {remark}"
        ))),
        _ => Ok(detector),
    }
}

fn read_script(file: &str) -> Result<ScriptedDetector, Failure> {
    let text = read_regular_text(file.as_ref(), LARGEST_SCRIPT).map_err(|e| {
        Failure::input(format!(
            "{OPTION} scripted:{file}: expected a script of detections, found: {e}; check the path"
        ))
    })?;
    ScriptedDetector::parse(file, &text)
        .map_err(|e| Failure::input(format!("{OPTION} scripted:{e}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn detector_arguments_are_parsed() {
        let scripted = |file: &str| Choice::Scripted(file.to_owned());
        let model = |file: &str| Choice::Model(ModelFile::of_file(file));
        for (argument, choice) in [
            ("none", Choice::None),
            ("scripted:a:b.csv", scripted("a:b.csv")),
            ("models/yolox.ONNX", model("models/yolox.ONNX")),
            ("c:/yolox.onnx", model("c:/yolox.onnx")),
        ] {
            assert_eq!(parse(argument).ok(), Some(choice), "{argument}");
        }
        for (argument, part) in [
            ("scripted:", "scripted:FILE.csv"),
            ("boxes.csv", "did you mean scripted:boxes.csv?"),
            ("yolov7-tiny.pt", "models import yolov7-tiny.pt"),
        ] {
            let e = parse(argument).unwrap_err().to_string();
            assert!(e.contains(part), "{e}");
        }
    }

    #[test]
    fn model_card_is_found_beside_its_model() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("m.onnx");
        assert_eq!(ModelFile::of_file(file.to_str().unwrap()).card(), None);
        let card = dir.path().join("m.toml");
        std::fs::write(&card, "").unwrap();
        assert_eq!(
            ModelFile::of_file(file.to_str().unwrap()).card(),
            Some(&*card)
        );
    }
}
