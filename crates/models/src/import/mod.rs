//! Converts PyTorch checkpoints to ONNX, without Python.
//!
//! Answers: the network of a YOLOv7-tiny checkpoint, as an ONNX file and a model card. A checkpoint is a zip archive with a pickle of the
//! whole module, a program that Python would run. Here it is read and never executed: opcodes and classes that are not on a list are
//! errors, and nothing is written anywhere. Knows the layers of YOLOv7-tiny in any number and width; does not train, run or download
//! networks.

mod card;
mod error;
mod fold;
mod head;
mod kinds;
mod modules;
mod network;
mod onnx;
mod pickle;
mod report;
mod tensors;
mod zip;

pub use error::ImportError;
pub use report::{HeadKind, Precision, Report};

use error::Result;
use modules::{Module, Source};
use network::{Network, Operation};
use pickle::{Arena, Id, Scalar, Value};
use stillpoint_inference::ModelCard;
use tensors::Tensors;
use zip::Archive;

/// A checkpoint converted to ONNX.
#[derive(Clone, Debug)]
#[non_exhaustive]
pub struct Imported {
    /// The ONNX file: input `images` [1, 3, H, W] with free H and W, multiples of the coarsest stride; per stride s an output `strideS` [1,
    /// anchors (5 + classes), H / s, W / s] of raw values, from the finest to the coarsest.
    pub onnx: Vec<u8>,
    /// Its model card.
    pub card: ModelCard,
    /// Facts about the checkpoint.
    pub report: Report,
}

/// Converts a checkpoint written by `torch.save` to ONNX. `name` becomes the name of the graph.
///
/// Memory is bounded by the file's size and by fixed limits, for any content; no file is touched.
///
/// # Errors
/// [`ImportError`]: not a checkpoint, a damaged or malicious file, unknown classes or layers, or inconsistent tensors.
pub fn import_checkpoint(bytes: &[u8], name: &str) -> std::result::Result<Imported, ImportError> {
    let archive = open(bytes)?;
    let folder = folder(&archive)?;
    let (arena, root) = pickle::read(entry(&archive, folder, "data.pkl").unwrap_or_default())?;
    let tensors = Tensors::new(&arena, &archive, folder, bytes.len());
    let source = Source {
        arena: &arena,
        tensors: &tensors,
    };
    let (id, which) = network(&arena, root)?;
    let model = Module::new(source, id, String::new())?;
    let network = Network::read(&model)?;
    let names = card::names(source, &model, &network.head)?;
    let card = card::card(&network.head, &names)?;
    let format = entry(&archive, folder, "version").and_then(|v| std::str::from_utf8(v).ok());
    let report = report(&network, &card, names, which, format);
    let onnx = onnx::write(&network, name, &notes(&card, &report));
    Ok(Imported { onnx, card, report })
}

/// Opens the archive, or reports the apparent format of the file.
fn open(bytes: &[u8]) -> Result<Archive<'_>> {
    // The magic number of PyTorch files before version 1.6: a pickled integer.
    const OLD: &[u8] = b"\x80\x02\x8a\x0a\x6c\xfc\x9c\x46\xf9\x20\x6a\xa8\x50\x19";
    let (found, advice) = if bytes.starts_with(b"PK") {
        return Archive::open(bytes);
    } else if bytes.starts_with(OLD) {
        (
            "the format of PyTorch before 1.6",
            "load and save it again with a newer PyTorch",
        )
    } else if bytes.starts_with(b"\x80") {
        ("a bare pickle", "save the network with torch.save")
    } else if bytes.trim_ascii_start().starts_with(b"<") {
        (
            "a web page",
            "get the file itself: the page may ask for a login or say that it is gone",
        )
    } else if bytes.is_empty() {
        ("an empty file", "get it again")
    } else {
        (
            "bytes of another format",
            "give a .pt file of YOLOv7-tiny; ONNX files need no import",
        )
    };
    Err(ImportError::NoCheckpoint {
        found: found.to_owned(),
        advice,
    })
}

/// Name of the archive's one folder, before `/data.pkl`.
fn folder<'a>(archive: &Archive<'a>) -> Result<&'a str> {
    let mut folders = archive.names().filter_map(|n| n.strip_suffix("/data.pkl"));
    let none = |found: &str, advice| ImportError::NoCheckpoint {
        found: found.to_owned(),
        advice,
    };
    let Some(folder) = folders.next() else {
        return Err(none(
            "a zip archive without one",
            "give the .pt file itself, not an archive that holds it",
        ));
    };
    if folders.next().is_some() {
        return Err(none("a zip archive with several", "give one checkpoint"));
    }
    let code = format!("{folder}/code/");
    if entry(archive, folder, "constants.pkl").is_some()
        || archive.names().any(|n| n.starts_with(&code))
    {
        return Err(none(
            "a TorchScript program",
            "give the checkpoint that it was made from, or export it to ONNX with PyTorch",
        ));
    }
    match entry(archive, folder, "byteorder") {
        Some(order) if order.trim_ascii() != b"little" => Err(none(
            "numbers in big-endian order",
            "save it again on a little-endian machine",
        )),
        _ => Ok(folder),
    }
}

fn entry<'a>(archive: &Archive<'a>, folder: &str, name: &str) -> Option<&'a [u8]> {
    archive.get(&format!("{folder}/{name}"))
}

/// The network of a checkpoint: under `ema` if present, else under `model`, or the root itself.
fn network(arena: &Arena<'_>, root: Id) -> Result<(Id, &'static str)> {
    if let Value::Object { .. } = arena.get(root) {
        return Ok((root, "model"));
    }
    let under = |key: &'static str| {
        let id = arena.entry(root, key)?;
        (*arena.get(id) != Value::None).then_some((id, key))
    };
    let found = under("ema").or_else(|| under("model"));
    if let Some((id, _)) = found
        && let Value::Object { .. } = arena.get(id)
    {
        return found.ok_or_else(|| weights_only(arena, root));
    }
    Err(weights_only(arena, root))
}

fn weights_only(arena: &Arena<'_>, root: Id) -> ImportError {
    let found = match arena.get(root) {
        Value::Dict(_) => {
            "a dictionary without one (the weights alone do not say how the layers are connected)"
                .to_owned()
        }
        other => other.describe(),
    };
    ImportError::Module {
        path: "the checkpoint".to_owned(),
        expected: "a whole network under `ema` or `model`".to_owned(),
        found,
    }
}

fn report(
    network: &Network,
    card: &ModelCard,
    classes: Vec<String>,
    which: &'static str,
    format: Option<&str>,
) -> Report {
    let weights = network.nodes.iter().map(|n| match &n.operation {
        Operation::Conv(c) => c.weight.len() + c.bias.len(),
        _ => 0,
    });
    let head = &network.head;
    let unknown = classes
        .iter()
        .enumerate()
        .filter(|(i, _)| card.class(*i).is_none());
    Report {
        layers: network.layers,
        parameters: weights.sum(),
        norms: network.norms,
        head: if head.implicit {
            HeadKind::ImplicitDetect
        } else {
            HeadKind::Detect
        },
        strides: head.outputs.iter().map(|o| o.stride).collect(),
        left_out: unknown.map(|(_, name)| name.clone()).collect(),
        classes,
        precision: match head.scalar {
            Scalar::Half => Precision::Half,
            Scalar::BFloat16 => Precision::BFloat16,
            Scalar::Double => Precision::Double,
            _ => Precision::Single,
        },
        network: which,
        format: format.map(|v| error::shown(v.trim())),
    }
}

/// Properties of the ONNX file, for users without its card.
fn notes(card: &ModelCard, report: &Report) -> [(&'static str, String); 4] {
    let names = report.classes.iter().enumerate();
    let names: Vec<String> = names.map(|(i, n)| format!("{i}: '{n}'")).collect();
    [
        ("names", format!("{{{}}}", names.join(", "))),
        ("stride", format!("{:?}", card.output.strides)),
        ("anchors", format!("{:?}", card.output.anchors)),
        ("source", report.to_string()),
    ]
}
