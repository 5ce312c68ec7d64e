//! The user's model cache: names, and the default model.

use crate::detector::file::{ModelFile, is_onnx};
use crate::failure::Failure;
use crate::spelling;
use stillpoint::inference::Cache;
use stillpoint::models::{known, known_models};

/// The model suggested to users who have none.
pub(crate) const SUGGESTED: &str = "yolox-nano";
/// Maximum share of edits for a name to count as mistyped.
const MISTYPED: f64 = 0.4;

/// The cache, as set by the environment.
///
/// # Errors
/// An environment without the user's folders.
pub(crate) fn user() -> Result<Cache, Failure> {
    Cache::of_user(&|name| std::env::var_os(name)).map_err(Failure::input)
}

/// Resolves `argument` of `option`: a file, or a model of the cache.
///
/// # Errors
/// An unknown name.
pub(crate) fn named(argument: &str, option: &str) -> Result<ModelFile, Failure> {
    if is_onnx(argument) {
        return Ok(ModelFile::of_file(argument));
    }
    model(argument, option)
}

/// The model of this name. `option` named it, for messages.
///
/// # Errors
/// An unknown name, or an unreadable cache.
fn model(name: &str, option: &str) -> Result<ModelFile, Failure> {
    let cache = user()?;
    if let Some(model) = cache.find(name).map_err(Failure::input)? {
        return Ok(ModelFile::of_cache(model));
    }
    let here: Vec<String> = cache
        .list()
        .map_err(Failure::input)?
        .into_iter()
        .map(|m| m.name)
        .collect();
    let others = match option {
        "--detector" => "none, scripted:FILE.csv, ",
        _ => "",
    };
    let held = if here.is_empty() {
        "which is empty".to_owned()
    } else {
        here.join(", ")
    };
    Err(Failure::input(format!(
        "{option}: expected {others}FILE.onnx, or the name of a model in the cache ({held}), found \"{name}\"; {}",
        advice(name, &here, !others.is_empty())
    )))
}

/// Advice after an unknown model name. `here` are the names in the cache.
fn advice(name: &str, here: &[String], none: bool) -> String {
    if known(name).is_some() {
        return format!("`stillpoint models pull {name}` gets it");
    }
    let mut names: Vec<&str> = here.iter().map(String::as_str).collect();
    names.extend(known_models().iter().map(|m| m.name));
    if none {
        names.push("none");
    }
    let lower = name.to_lowercase();
    match spelling::near(&lower, &names, MISTYPED) {
        Some(meant) if here.iter().any(|h| h == meant) || meant == "none" => {
            format!("did you mean \"{meant}\"?")
        }
        Some(meant) => {
            format!("did you mean \"{meant}\"? `stillpoint models pull {meant}` gets it")
        }
        None => "`stillpoint models list` shows what there is".to_owned(),
    }
}

pub(crate) enum Preferred {
    Model(ModelFile),
    None(String),
}

/// The model that is used when none is named.
///
/// # Errors
/// A cache that exists but cannot be read: whether it holds a model is unknown.
pub(crate) fn preferred() -> Result<Preferred, Failure> {
    let cache = match Cache::of_user(&|name| std::env::var_os(name)) {
        Ok(cache) => cache,
        Err(e) => return Ok(Preferred::None(format!("no cache: {e}"))),
    };
    let order = known_models().iter().map(|m| m.name);
    let model = cache.preferred(order).map_err(Failure::input)?;
    Ok(match model {
        Some(model) => Preferred::Model(ModelFile::of_cache(model)),
        None => Preferred::None(format!(
            "no model is in the cache; `stillpoint models pull {SUGGESTED}` gets one"
        )),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn mistyped_model_names_get_suggestions() {
        let here = ["office".to_owned()];
        for (name, part) in [
            ("yolox-nano", "`stillpoint models pull yolox-nano` gets it"),
            ("yolox_nano", "\"yolox-nano\"? `stillpoint models pull"),
            ("YOLOv7-tiny", "\"yolov7-tiny\"? `stillpoint"),
            ("ofice", "did you mean \"office\"?"),
            ("None", "did you mean \"none\"?"),
            ("efficientdet", "models list"),
            ("", "models list"),
        ] {
            let said = advice(name, &here, true);
            assert!(said.contains(part), "{name}: {said}");
        }
        assert!(!advice("non", &here, false).contains("none"));
    }
}
