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

/// What looks at the frames.
#[derive(Clone, Debug, PartialEq, Eq)]
enum Choice {
    None,
    Scripted(String),
    Model(ModelFile),
}

/// A choice that is made, by the user or for the user.
#[derive(Clone, Debug)]
pub(crate) struct Settled {
    choice: Choice,
    /// What `--detector` would have to be for the same choice.
    pub(crate) argument: String,
    /// Why it is that, when the user did not say.
    pub(crate) reason: Option<String>,
}

impl Settled {
    /// Whether anything looks at the frames.
    pub(crate) fn looks(&self) -> bool {
        self.choice != Choice::None
    }
}

/// What the arguments name; without `--detector` the model of the cache that is preferred, else none.
///
/// # Errors
/// A name of no detector, a cache that cannot be read.
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
    /// None, for this reason.
    pub(crate) fn none(reason: impl Into<String>) -> Self {
        Self {
            choice: Choice::None,
            argument: "none".to_owned(),
            reason: Some(reason.into()),
        }
    }

    /// In words, for reports.
    pub(crate) fn words(&self) -> String {
        match &self.reason {
            Some(reason) => format!("{} ({reason})", self.argument),
            None => self.argument.clone(),
        }
    }

    /// Whether nothing looks at the frames.
    pub(crate) fn is_none(&self) -> bool {
        self.choice == Choice::None
    }

    /// Tells the user what was chosen in their place.
    pub(crate) fn announce(&self) {
        if self.reason.is_some() {
            console::info(&format!("detector: {}", self.words()));
        }
    }

    /// What makes its results, beside its name: the bytes of a model and its card, or of a script. Nothing where that lies in each recording.
    ///
    /// # Errors
    /// A file that cannot be read.
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

    /// Whether the detector looks at colour images.
    pub(crate) fn needs_colour(&self) -> bool {
        matches!(self.choice, Choice::Model(_))
    }
}

/// A detector that is ready.
#[derive(Default)]
pub(crate) struct Loaded {
    /// `None` for `none`.
    pub(crate) detector: Option<Box<dyn Detector>>,
    /// The library that runs its network, where it is not built in.
    pub(crate) library: Option<String>,
}

/// The detector that was settled on, for a recording whose frames have these stamps of colour and depth, s.
///
/// # Errors
/// A file that cannot be read, a model or script that cannot be used, a script of another recording.
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

/// The same for frames that are still to come: a script is taken as it is.
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
                    // Who did not ask for a model must be able to go on without.
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

/// Bytes of a script at most: a day of crowds has some hundred megabytes.
const LARGEST_SCRIPT: u64 = 1 << 30;

/// A script, tried on the stamps of all frames: one that belongs to another recording would see nothing in a long run.
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
        // A recording in which nothing was seen is possible: its remark comes at the end.
        Some(remark) if !detector.rows().is_empty() => Err(Failure::input(format!(
            "--detector: expected a script of this recording, found another: {remark}"
        ))),
        _ => Ok(detector),
    }
}

/// A script as it stands in its file.
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
    fn arguments_name_detectors() {
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
    fn a_card_is_found_beside_its_model() {
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
