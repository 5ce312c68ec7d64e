//! `models import`: adds the user's model file to the cache.

use crate::args::models::{ImportArgs, RuntimeChoice};
use crate::detector::file::{Content, ModelFile, is_onnx};
use crate::detector::network::Running;
use crate::detector::tried;
use crate::failure::{Failure, Status};
use crate::models::cache;
use crate::{console, output};
use std::path::Path;
use stillpoint::inference::{Form, Record, check_name, sha256_hex};
use stillpoint::models::import::import_checkpoint;
use stillpoint::models::{known_by_sha256, known_models, licence};

const OPTION: &str = "models import";
/// Signature of zip files, and so of PyTorch checkpoints since 1.6.
const ZIP: &[u8] = b"PK\x03\x04";

pub(crate) fn import(args: &ImportArgs) -> Result<Status, Failure> {
    let file = &args.file;
    if let Some(out) = &args.out {
        check_out(out)?;
    }
    let label = file.display().to_string();
    let published = ModelFile::of_file(&label)
        .read()
        .map_err(|e| Failure::input(format!("{OPTION} {e}")))?;
    let sha256 = sha256_hex(&published.bytes);
    let known = known_by_sha256(&sha256);
    let name = match (&args.name, known) {
        (Some(name), _) => name.clone(),
        (None, Some(known)) => known.name.to_owned(),
        // Only a label: the cache is not written.
        (None, None) if args.out.is_some() => stem(file),
        (None, None) => name_of(file)?,
    };
    let record = match known {
        Some(known) => {
            console::info(&format!("{}: known as {known}", file.display()));
            known.record(&label, &published.bytes)
        }
        None => Record::of(&label, &published.bytes),
    };
    let network = if is_checkpoint(file, &published.bytes) {
        convert(file, &published.bytes, &name)?
    } else {
        published
    };
    // Refuses an unusable model here rather than at the first run.
    let how = Running::new(RuntimeChoice::Rten, 1);
    let tried = tried::load(&label, &network, &how, OPTION)?;
    console::info(&format!(
        "{}: head {}, {} classes",
        file.display(),
        tried.detector.card().head.name(),
        tried.detector.card().class_count()
    ));
    match &args.out {
        Some(out) => write(out, &network),
        None => install(&name, &network, record),
    }
}

fn install(name: &str, network: &Content, record: Record) -> Result<Status, Failure> {
    let cache = cache::user()?;
    let older = cache.find(name).map_err(Failure::input)?;
    let card = network.card.as_ref().map(|(_, text)| text.as_str());
    let model = cache
        .install(name, &network.bytes, card, record)
        .map_err(Failure::input)?;
    if older.is_some_and(|older| older.sha256 != model.sha256) {
        console::info(&format!("it replaces another model of the name {name}"));
    }
    console::report(&format!(
        "{name}: SHA-256 {}\nlicence of the weights: {}\nin {}; use it by --detector {name}\n",
        model.sha256,
        licence(&model).unwrap_or("not known"),
        model.onnx.display()
    ));
    Ok(Status::Ok)
}

/// Refuses an unusable output name before the work.
fn check_out(out: &Path) -> Result<(), Failure> {
    if !is_onnx(&out.display().to_string()) {
        return Err(Failure::input(format!(
            "--out: expected a file whose name ends with .onnx, found {}",
            out.display()
        )));
    }
    Ok(())
}

/// Writes a model to a file, and its card beside it.
fn write(out: &Path, network: &Content) -> Result<Status, Failure> {
    let beside = out.with_extension("toml");
    if network.card.is_none() && beside.symlink_metadata().is_ok() {
        return Err(Failure::input(format!(
            "--out: expected no card beside a model that has none, found {}, which would be taken for its card; move it away, or name another file",
            beside.display()
        )));
    }
    output::write_file(out, &network.bytes)?;
    if let Some((_, card)) = &network.card {
        output::write_file(&beside, card.as_bytes())?;
    }
    console::report(&format!(
        "{}: SHA-256 {}\n",
        out.display(),
        sha256_hex(&network.bytes)
    ));
    Ok(Status::Ok)
}

fn stem(file: &Path) -> String {
    let stem = file.file_stem().unwrap_or_default();
    stem.to_string_lossy().into_owned()
}

fn name_of(file: &Path) -> Result<String, Failure> {
    let published = known_models()
        .iter()
        .find(|m| m.form == Form::Checkpoint && file.file_name() == Some(m.file.as_ref()));
    let name = match published {
        Some(model) => model.name.to_owned(),
        None => stem(file),
    };
    check_name(&name).map_err(|e| Failure::input(format!("{OPTION}: {e} with --name")))?;
    Ok(name)
}

fn is_checkpoint(file: &Path, bytes: &[u8]) -> bool {
    let ending = file.extension().map(|e| e.to_string_lossy().to_lowercase());
    bytes.starts_with(ZIP) || matches!(ending.as_deref(), Some("pt" | "pth"))
}

fn convert(file: &Path, bytes: &[u8], name: &str) -> Result<Content, Failure> {
    let label = file.display();
    let imported = import_checkpoint(bytes, name)
        .map_err(|e| Failure::input(format!("{OPTION} {label}: {e}")))?;
    console::info(&format!("{label}: {}", imported.report));
    Ok(Content {
        bytes: imported.onnx,
        card: Some((format!("card of {label}"), imported.card.to_toml())),
    })
}
