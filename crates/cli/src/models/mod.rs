//! `models`: lists and manages models and runtimes.

pub(crate) mod cache;
pub(crate) mod check;
mod grey;
pub(crate) mod import;
pub(crate) mod pull;
pub(crate) mod trial;

use crate::args::models::ModelsCommand;
use crate::console;
use crate::detector::runtime::Libraries;
use crate::download::megabytes;
use crate::failure::{Failure, Status};
use crate::models::cache::Preferred;
use std::path::Path;
use stillpoint::evaluation::{Align, Table};
use stillpoint::inference::{Cache, CachedModel, State};
use stillpoint::models::{known_models, licence};

pub(crate) fn models(command: &ModelsCommand) -> Result<Status, Failure> {
    match command {
        ModelsCommand::List(_) => list(),
        ModelsCommand::Pull(a) => pull::pull(a),
        ModelsCommand::Import(a) => import::import(a),
        ModelsCommand::Check(a) => check::check(a),
    }
}

fn list() -> Result<Status, Failure> {
    let cache = cache::user()?;
    let here = cache.list().map_err(Failure::input)?;
    let mut text = known_text(&here);
    text += &cache_text(&cache, &here)?;
    text += &match cache::preferred()? {
        Preferred::Model(model) => format!("without --detector: {}\n", model.name),
        Preferred::None(reason) => format!("without --detector: none ({reason})\n"),
    };
    text += &runtimes_text(&Libraries::find());
    console::print(&text);
    Ok(Status::Ok)
}

fn known_text(here: &[CachedModel]) -> String {
    let mut table = Table::new(["known", "size", "licence", "here", "about"])
        .align(2, Align::Left)
        .align(3, Align::Left)
        .align(4, Align::Left);
    for model in known_models() {
        let is_here = here.iter().any(|m| m.name == model.name);
        table.row([
            model.name.to_owned(),
            model.bytes.map_or_else(|| "?".to_owned(), megabytes),
            model.licence.to_owned(),
            if is_here { "yes" } else { "no" }.to_owned(),
            model.about.to_owned(),
        ]);
    }
    format!(
        "{}`stillpoint models pull NAME` gets one of them\n\n",
        table.to_text()
    )
}

fn cache_text(cache: &Cache, here: &[CachedModel]) -> Result<String, Failure> {
    let mut text = format!("cache: {}\n", cache.folder().display());
    if here.is_empty() {
        text += "no models\n";
    } else {
        let mut table = Table::new(["model", "size", "licence", "SHA-256", "from"])
            .align(2, Align::Left)
            .align(3, Align::Left)
            .align(4, Align::Left);
        for model in here {
            let record = model.record.as_ref();
            let from = record.and_then(|r| r.source.clone());
            table.row([
                model.name.clone(),
                megabytes(model.bytes),
                licence(model).unwrap_or("?").to_owned(),
                model.sha256.clone(),
                from.unwrap_or_else(|| "put there by hand".to_owned()),
            ]);
        }
        text += &table.to_text();
    }
    for model in here {
        if let State::Damaged(reason) = &model.state {
            text += &format!("damaged: {}: {reason}\n", model.name);
        }
    }
    for stray in cache.strays().map_err(Failure::input)? {
        let name = Path::new(&stray.path).file_name().unwrap_or_default();
        text += &format!(
            "also there: {} ({}): {}\n",
            name.display(),
            megabytes(stray.bytes),
            stray.what
        );
    }
    Ok(text + "\n")
}

fn runtimes_text(libraries: &Libraries) -> String {
    let mut text = "runtimes: rten (built in)".to_owned();
    match &libraries.usable {
        Some(library) => {
            text += &format!(
                ", ONNX Runtime {} ({})\n",
                library.version(),
                library.library().display()
            );
        }
        None => text += "; no library of ONNX Runtime (`pip install onnxruntime` brings one)\n",
    }
    for refused in &libraries.refused {
        text += &format!("not used: {refused}\n");
    }
    text
}
