//! Model files given by path or in the cache, and their contents.

use crate::failure::Failure;
use std::path::{Path, PathBuf};
use stillpoint::datasets::{read_regular, read_regular_text};
use stillpoint::inference::{CachedModel, LARGEST};

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct ModelFile {
    /// The file, or the name in the cache.
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

/// A model's bytes, and its card with the card's name, if there is one.
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

    pub(crate) fn of_cache(model: CachedModel) -> Self {
        Self {
            name: model.name.clone(),
            place: ModelPlace::Cache(Box::new(model)),
        }
    }

    /// Path of its card, if there is one.
    pub(crate) fn card(&self) -> Option<&Path> {
        match &self.place {
            ModelPlace::File { card, .. } => card.as_deref(),
            ModelPlace::Cache(model) => model.card.as_deref(),
        }
    }

    /// Size of the network's file.
    ///
    /// # Errors
    /// A missing file.
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

    /// Reads model and card.
    ///
    /// # Errors
    /// An unreadable file; the message names it.
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

/// Maximum size of a card, bytes: a list of a thousand classes has some ten thousand.
const LARGEST_CARD: u64 = 1 << 22;

pub(crate) fn is_onnx(name: &str) -> bool {
    let extension = Path::new(name).extension();
    extension.is_some_and(|e| e.eq_ignore_ascii_case("onnx"))
}
