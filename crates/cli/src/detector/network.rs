//! Models: from what the user names to a network that runs.

use crate::args::models::{NetworkArgs, RuntimeChoice};
use crate::console;
use crate::detector::runtime;
use crate::failure::Failure;
use crate::models::{cache, trial};
use std::path::{Path, PathBuf};
use stillpoint::datasets::{read_regular, read_regular_text};
use stillpoint::inference::{CachedModel, LARGEST};
use stillpoint::inference::{ModelCard, ModelError, OnnxDetector, OnnxOptions, Runtime};

/// A model, not yet read.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ModelFile {
    /// As the user knows it: the file, or the name in the cache.
    pub(crate) name: String,
    place: ModelPlace,
}

#[derive(Clone, Debug, PartialEq, Eq)]
enum ModelPlace {
    File {
        onnx: PathBuf,
        card: Option<PathBuf>,
    },
    Cache(Box<CachedModel>),
}

/// A model's bytes, and its card where it has one, with the card's name.
pub(crate) struct Content {
    pub(crate) bytes: Vec<u8>,
    pub(crate) card: Option<(String, String)>,
}

impl ModelFile {
    /// A file, with the card beside it if there is one.
    pub(crate) fn of_file(file: &str) -> Self {
        let card = Path::new(file).with_extension("toml");
        Self {
            name: file.to_owned(),
            place: ModelPlace::File {
                onnx: file.into(),
                card: card.is_file().then_some(card),
            },
        }
    }

    /// A model of the cache.
    pub(crate) fn of_cache(model: CachedModel) -> Self {
        Self {
            name: model.name.clone(),
            place: ModelPlace::Cache(Box::new(model)),
        }
    }

    /// What `argument` of `option` names: a file, or a model of the cache.
    ///
    /// # Errors
    /// A name that no model has.
    pub(crate) fn named(argument: &str, option: &str) -> Result<Self, Failure> {
        if is_onnx(argument) {
            return Ok(Self::of_file(argument));
        }
        cache::model(argument, option)
    }

    /// Its card, where it has one.
    pub(crate) fn card(&self) -> Option<&Path> {
        match &self.place {
            ModelPlace::File { card, .. } => card.as_deref(),
            ModelPlace::Cache(model) => model.card.as_deref(),
        }
    }

    /// Size of the network's file.
    ///
    /// # Errors
    /// A file that is not there any more.
    pub(crate) fn bytes(&self) -> Result<u64, Failure> {
        match &self.place {
            ModelPlace::File { onnx, .. } => match std::fs::metadata(onnx) {
                Ok(metadata) => Ok(metadata.len()),
                Err(e) => Err(Failure::input(format!(
                    "{}: expected to read it, found: {e}",
                    onnx.display()
                ))),
            },
            ModelPlace::Cache(model) => Ok(model.bytes),
        }
    }

    /// Reads it.
    ///
    /// # Errors
    /// What is wrong, with the file's name.
    pub(crate) fn read(&self) -> Result<Content, String> {
        let unreadable = |path: &Path, what: &str, e: &std::io::Error| {
            let path = path.display();
            format!("{path}: expected {what}, found: {e}; check the path")
        };
        let (bytes, text) = match &self.place {
            ModelPlace::File { onnx, card } => {
                let bytes = read_regular(onnx, LARGEST)
                    .map_err(|e| unreadable(onnx, "the model of a detector", &e))?;
                let text = card.as_ref().map(|card| {
                    read_regular_text(card, LARGEST_CARD)
                        .map_err(|e| unreadable(card, "the card of a model", &e))
                });
                (bytes, text.transpose()?)
            }
            ModelPlace::Cache(model) => (
                model.read().map_err(|e| e.to_string())?,
                model.card_text().map_err(|e| e.to_string())?,
            ),
        };
        let name = self.card().map(|path| path.display().to_string());
        Ok(Content {
            bytes,
            card: name.zip(text),
        })
    }
}

/// Bytes of a card at most: a list of a thousand classes has some ten thousand.
const LARGEST_CARD: u64 = 1 << 22;

/// Whether a name is that of an ONNX file.
pub(crate) fn is_onnx(name: &str) -> bool {
    let extension = Path::new(name).extension();
    extension.is_some_and(|e| e.eq_ignore_ascii_case("onnx"))
}

/// How a network is run.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Running {
    pub(crate) runtime: RuntimeChoice,
    pub(crate) options: OnnxOptions,
}

impl Running {
    pub(crate) fn new(runtime: RuntimeChoice, threads: u8) -> Self {
        Self {
            runtime,
            options: OnnxOptions {
                threads: threads.into(),
                ..OnnxOptions::default()
            },
        }
    }
}

impl From<NetworkArgs> for Running {
    fn from(args: NetworkArgs) -> Self {
        Self::new(args.runtime, args.threads)
    }
}

/// A network that runs.
pub(crate) struct Network {
    pub(crate) detector: OnnxDetector,
    /// The library that runs it, where it is not built in.
    pub(crate) library: Option<String>,
}

/// Loads a model. `option` named it, for messages.
///
/// # Errors
/// Files that cannot be read, a card that cannot be used, a model that does not load or run, a runtime that is not there.
pub(crate) fn open(model: &ModelFile, how: &Running, option: &str) -> Result<Network, Failure> {
    let content = model
        .read()
        .map_err(|e| Failure::input(format!("{option} {e}")))?;
    load(&model.name, &content, how, option)
}

/// Loads a model that was read; `name` is what it is called. See [`open`].
///
/// # Errors
/// A card that cannot be used, a model that does not load or run, a runtime that is not there.
pub(crate) fn load(
    name: &str,
    content: &Content,
    how: &Running,
    option: &str,
) -> Result<Network, Failure> {
    trial::check(name, content, how, option)?;
    load_tried(name, content, how, option)
}

/// Loads a model that was tried, or that is tried here; see [`load`].
///
/// # Errors
/// As [`load`].
pub(crate) fn load_tried(
    name: &str,
    content: &Content,
    how: &Running,
    option: &str,
) -> Result<Network, Failure> {
    let wrong = |e: &dyn std::fmt::Display| Failure::input(format!("{option} {e}"));
    let card = content.card.as_ref();
    let card = card.map(|(name, text)| ModelCard::parse(name, text));
    let card = card.transpose().map_err(|e| wrong(&e))?;
    let chosen = runtime::choose(how.runtime)?;
    if let Some(warning) = &chosen.warning {
        console::warn(warning);
    }
    let (detector, runtime) = match with_runtime(name, content, card.as_ref(), &chosen.runtime, how)
    {
        Ok(detector) => (detector, chosen.runtime),
        // Nobody asked for the library: what it cannot run, the one that is built in may.
        Err(e) if how.runtime == RuntimeChoice::Auto && chosen.runtime != Runtime::Rten => {
            let detector = with_runtime(name, content, card.as_ref(), &Runtime::Rten, how)
                .map_err(|_| wrong(&e))?;
            console::warn(&format!("the network is run by rten: {e}"));
            (detector, Runtime::Rten)
        }
        Err(e) => return Err(wrong(&e)),
    };
    Ok(Network {
        detector,
        library: runtime::library(&runtime),
    })
}

fn with_runtime(
    name: &str,
    content: &Content,
    card: Option<&ModelCard>,
    runtime: &Runtime,
    how: &Running,
) -> Result<OnnxDetector, ModelError> {
    OnnxDetector::with_card(content.bytes.clone(), name, card, runtime, &how.options)
}
