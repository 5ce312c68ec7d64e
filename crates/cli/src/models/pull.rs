//! `models pull`: downloads a known model into the cache.

use crate::args::models::PullArgs;
use crate::console;
use crate::download::{Bar, about, came};
use crate::failure::{Failure, Status};
use crate::interrupt::Interrupt;
use crate::models::cache;
use crate::spelling;
use std::ops::ControlFlow;
use stillpoint::models::{
    FetchError, KnownModel, Progress, PullError, PullOptions, Pulled, known, known_models,
    pull as get,
};

pub(crate) fn pull(args: &PullArgs) -> Result<Status, Failure> {
    let model = named(&args.name)?;
    let cache = cache::user()?;
    let options = PullOptions {
        base: args.mirror.clone(),
        again: args.again,
        ..PullOptions::default()
    };
    if let Some(note) = licence_note(model) {
        console::info(&note);
    }
    let interrupt = Interrupt::listen();
    let mut bar = Bar::default();
    let result = get(model, &cache, &options, &mut |progress| {
        show(&mut bar, &progress);
        if interrupt.requested() {
            ControlFlow::Break(())
        } else {
            ControlFlow::Continue(())
        }
    });
    bar.finish();
    match result {
        Ok(pulled) => {
            console::report(&text(model, &pulled));
            Ok(Status::Ok)
        }
        Err(e @ PullError::Fetch(FetchError::Stopped { .. })) => Err(Failure::criteria(e)),
        Err(e) => Err(Failure::input(e)),
    }
}

fn named(name: &str) -> Result<&'static KnownModel, Failure> {
    known(name).ok_or_else(|| {
        let names: Vec<&str> = known_models().iter().map(|m| m.name).collect();
        let advice = match spelling::near(&name.to_lowercase(), &names, 0.4) {
            Some(meant) => format!("did you mean \"{meant}\"?"),
            None => {
                "a file of your own is put into the cache by `stillpoint models import`".to_owned()
            }
        };
        Failure::input(format!(
            "models pull: expected a known model ({}), found \"{name}\"; {advice}",
            names.join(", ")
        ))
    })
}

/// A note on licences with obligations beyond attribution.
fn licence_note(model: &KnownModel) -> Option<String> {
    model.licence.starts_with("GPL").then(|| {
        format!(
            "the weights of {model} are their makers', under {}: this project's licence does not cover them, and who passes them on has to keep to theirs",
            model.licence
        )
    })
}

fn text(model: &KnownModel, pulled: &Pulled) -> String {
    let here = &pulled.model;
    let checksum = about(pulled.checksum);
    let came = came(pulled.transferred, pulled.resumed, &pulled.url);
    format!(
        "{model}: {came}\nSHA-256 {} ({checksum})\nlicence of the weights: {}\nin {}; use it by --detector {model}\n",
        pulled.sha256,
        model.licence,
        here.onnx.display()
    )
}

fn show(bar: &mut Bar, progress: &Progress) {
    match progress {
        Progress::Connecting { url } => console::info(&format!("asking {url}")),
        Progress::Receiving {
            received,
            total,
            resumed,
        } => bar.receiving(*received, *total, *resumed),
        Progress::Converting => {
            bar.finish();
            console::info("turning the checkpoint into ONNX");
        }
        _ => bar.finish(),
    }
}
