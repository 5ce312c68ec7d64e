//! The configuration: defaults, then the file, then `--set`, then `--seed`; later ones override.
//!
//! Resolves the configuration and locates errors (line or argument). The crates that use the values define their meaning and validity.

pub(crate) mod docs;
mod removed;
#[cfg(test)]
mod tests;

use crate::args::{ConfigArgs, PrintArgs};
use crate::config::docs::plain_text;
pub(crate) use crate::config::docs::to_text;
use crate::console;
use crate::failure::{Failure, Status};
use crate::spelling::nearest;
use serde::Deserialize;
use std::path::Path;
use stillpoint::datasets::read_regular_text;
use stillpoint::detection::ClassId;
use stillpoint::imaging::{Simd, Workers};
use stillpoint::slam::Config;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

pub(crate) fn print(args: &PrintArgs) -> Result<Status, Failure> {
    console::print(&to_text(&resolve(&args.config)?)?);
    Ok(Status::Ok)
}

/// The configuration that the arguments ask for, checked.
pub(crate) fn resolve(args: &ConfigArgs) -> Result<Config, Failure> {
    over(Layers::new()?, args)
}

/// The configuration that the arguments ask for, on top of that of a log.
pub(crate) fn resolve_over(
    logged: &Table,
    log: &Path,
    args: &ConfigArgs,
) -> Result<Config, Failure> {
    let mut layers = Layers::new()?;
    let text = toml::to_string(logged).map_err(Failure::input)?;
    layers.add(&text, &Origin::Log(log))?;
    over(layers, args)
}

/// The configuration as a table. Converted from the text, so that a log holds what `config print` shows.
pub(crate) fn to_table(config: &Config) -> Result<Table, Failure> {
    plain_text(config)?.parse().map_err(Failure::input)
}

/// Maximum size of a configuration, bytes: one with all fields has some ten thousand.
const LARGEST: u64 = 1 << 22;

fn over(mut layers: Layers, args: &ConfigArgs) -> Result<Config, Failure> {
    if let Some(path) = &args.config {
        let text = read_regular_text(path, LARGEST).map_err(|e| {
            Failure::input(format!(
                "{}: expected a configuration file, found: {e}; check the path",
                path.display()
            ))
        })?;
        layers.add(&text, &Origin::File(path))?;
    }
    for set in &args.set {
        let text = layers.quoted(set);
        layers.add(&text, &Origin::Set(set))?;
    }
    if let Some(seed) = args.seed {
        let text = format!("seed={seed}");
        layers.add(&text, &Origin::Set(&text))?;
    }
    let config = layers.config;
    config.validate().map_err(Failure::input)?;
    Ok(config)
}

/// The instruction set: that of the machine, or portable code if `STILLPOINT_SIMD=scalar` is set. The results are the same to the bit.
pub(crate) fn simd() -> Result<Simd, Failure> {
    match std::env::var_os("STILLPOINT_SIMD") {
        None => Ok(Simd::detect()),
        Some(v) if v == "scalar" => Ok(Simd::Scalar),
        Some(v) if v == "auto" || v.is_empty() => Ok(Simd::detect()),
        Some(v) => Err(Failure::input(format!(
            "STILLPOINT_SIMD: expected scalar or auto, found {v:?}; unset it or correct it"
        ))),
    }
}

/// Maximum number of threads per frame: more gain nothing.
const MOST_WORKERS: usize = 4;

/// Worker threads per frame: `STILLPOINT_WORKERS`, else the spare cores of the machine. One core reads images ahead; in a live run
/// detection and mapping need cores too. A worker that shares a core with them is late, and costs more than it saves. The results are the
/// same to the bit.
pub(crate) fn workers(live: bool) -> Result<Workers, Failure> {
    let cores = std::thread::available_parallelism().map_or(1, usize::from);
    let spare = if live { cores / 2 } else { cores - 1 };
    let threads = match std::env::var_os("STILLPOINT_WORKERS") {
        Some(v) if !v.is_empty() && v != "auto" => v
            .to_str()
            .and_then(|v| v.parse().ok())
            .filter(|n| (1..=64).contains(n))
            .ok_or_else(|| {
                Failure::input(format!(
                    "STILLPOINT_WORKERS: expected 1 to 64 or auto, found {v:?}; unset it or correct it"
                ))
            })?,
        _ => spare.clamp(1, MOST_WORKERS),
    };
    Workers::new(threads).map_err(Failure::thread)
}

/// Where values come from, for messages.
enum Origin<'a> {
    File(&'a Path),
    /// The log of a run, which contains the configuration.
    Log(&'a Path),
    Set(&'a str),
}

impl Origin<'_> {
    /// The location of byte `at` of the text.
    fn place(&self, text: &str, at: usize) -> String {
        match self {
            Self::File(path) => {
                let before = &text.as_bytes()[..at.min(text.len())];
                let line = before.iter().filter(|b| **b == b'\n').count() + 1;
                format!("{}:{line}", path.display())
            }
            Self::Log(path) => path.display().to_string(),
            Self::Set(argument) => format!("--set {argument}"),
        }
    }
}

/// The layers applied up to this point, as a table and as a `Config`.
struct Layers {
    table: Table,
    config: Config,
}

impl Layers {
    fn new() -> Result<Self, Failure> {
        let config = Config::default();
        let table = to_table(&config)?;
        Ok(Self { table, config })
    }

    /// Overrides values with those of `text` (TOML).
    fn add(&mut self, text: &str, origin: &Origin<'_>) -> Result<(), Failure> {
        let fail = |e: toml::de::Error| {
            let at = e.span().map_or(0, |s| s.start);
            let hint = match origin {
                Origin::File(_) | Origin::Log(_) => "correct the file",
                Origin::Set(_) => {
                    "write --set section.key=value; words need quotes: --set 'a.b=\"word\"'"
                }
            };
            Failure::input(format!(
                "{}: expected TOML, found: {}; {hint}",
                origin.place(text, at),
                e.message().replace('\n', " ")
            ))
        };
        let values: Table = text.parse().map_err(fail)?;
        let spans = DeTable::parse(text).map_err(fail)?;
        if values.is_empty() && matches!(origin, Origin::Set(_)) {
            return Err(Failure::input(format!(
                "{}: expected KEY=VALUE, found no value; write --set section.key=value",
                origin.place(text, 0)
            )));
        }
        let mut leaves = Vec::new();
        flatten(&values, Some(spans.get_ref()), "", &mut leaves);
        for (path, value, at) in leaves {
            let place = origin.place(text, at);
            self.set(&path, value, &place)?;
        }
        Ok(())
    }

    /// Sets one value.
    fn set(&mut self, path: &str, value: &Value, place: &str) -> Result<(), Failure> {
        if let Some(instead) = removed::instead_of(path) {
            return Err(Failure::input(format!(
                "{place}: expected a key of this version, found \"{path}\", which is gone: {instead}; take it out"
            )));
        }
        self.name_weight(path, place)?;
        let known = self.leaf_mut(path);
        let Some(old) = known else {
            let mut all = Vec::new();
            flatten(&self.table, None, "", &mut all);
            let names: Vec<&str> = all.iter().map(|l| l.0.as_str()).collect();
            let nearest = nearest(path, &among(path, &names)).join("\" or \"");
            return Err(Failure::input(format!(
                "{place}: expected a known key, found \"{path}\"; did you mean \"{nearest}\"? stillpoint config print lists all keys"
            )));
        };
        if !fits(old, value) {
            return Err(Failure::input(format!(
                "{place}: expected {} for {path} (as in {path} = {old}), found {} {value}; correct the value",
                kind(old),
                kind(value)
            )));
        }
        let previous = std::mem::replace(old, value.clone());
        match Config::deserialize(self.table.clone()) {
            Ok(config) => {
                self.config = config;
                Ok(())
            }
            Err(e) => {
                let message = format!(
                    "{place}: expected another value for {path} (as in {path} = {previous}), found {value}: {}; correct the value",
                    e.message().replace('\n', " ")
                );
                Err(Failure::input(message))
            }
        }
    }

    /// Adds the weight of a class to the values, which hold only those that differ from their defaults.
    fn name_weight(&mut self, path: &str, place: &str) -> Result<(), Failure> {
        let Some(name) = path.strip_prefix("motion_weights.") else {
            return Ok(());
        };
        let mut weights = self.config.motion_weights.clone();
        // Any weight will do: an invalid one from the user is reported when it is set.
        weights
            .set(name, 0.0)
            .map_err(|e| Failure::input(format!("{place}: {e}")))?;
        if let Some(Value::Table(set)) = self.table.get_mut("motion_weights") {
            let class = ClassId::from_name(name);
            let weight = class.map_or(0.0, |c| self.config.motion_weights.get(c));
            set.entry(name).or_insert(Value::Float(weight));
        }
        Ok(())
    }

    /// Quotes the value of `KEY=WORD` where needed, since shells remove quotes: if the setting is a string, or if the word is not valid
    /// TOML, whose parser would guess its type from the first letter.
    fn quoted(&mut self, set: &str) -> String {
        let bare = |c: char| c.is_ascii_alphanumeric() || "_-.".contains(c);
        let is_value = |word: &str| format!("x={word}").parse::<Table>().is_ok();
        match set.split_once('=').map(|(k, w)| (k.trim(), w.trim())) {
            Some((key, word))
                if !word.is_empty()
                    && word.chars().all(bare)
                    && (matches!(self.leaf_mut(key), Some(Value::String(_)))
                        || !is_value(word)) =>
            {
                format!("{key}=\"{word}\"")
            }
            _ => set.to_owned(),
        }
    }

    fn leaf_mut(&mut self, path: &str) -> Option<&mut Value> {
        let mut parts = path.split('.');
        let mut value = self.table.get_mut(parts.next()?)?;
        for part in parts {
            value = value.as_table_mut()?.get_mut(part)?;
        }
        (!value.is_table()).then_some(value)
    }
}

/// All values with their dotted paths and the positions of their keys in the text.
fn flatten<'a>(
    table: &'a Table,
    spans: Option<&DeTable<'_>>,
    prefix: &str,
    leaves: &mut Vec<(String, &'a Value, usize)>,
) {
    for (key, value) in table {
        let path = format!("{prefix}{key}");
        let span = spans.and_then(|s| s.iter().find(|(k, _)| k.get_ref() == key));
        let at = span.map_or(0, |(k, _)| k.span().start);
        match value {
            Value::Table(inner) if !inner.is_empty() => {
                let inner_spans = span.and_then(|(_, v)| match v.get_ref() {
                    DeValue::Table(t) => Some(t),
                    _ => None,
                });
                flatten(inner, inner_spans, &format!("{path}."), leaves);
            }
            // An empty section sets nothing.
            Value::Table(_) => {}
            _ => leaves.push((path, value, at)),
        }
    }
}

/// Candidates for a mistyped key: those of its section, if the section exists.
fn among<'a>(path: &str, names: &[&'a str]) -> Vec<&'a str> {
    let section = path.rfind('.').map_or("", |end| &path[..=end]);
    let same: Vec<&str> = names
        .iter()
        .copied()
        .filter(|name| !section.is_empty() && name.starts_with(section))
        .collect();
    if same.is_empty() {
        names.to_vec()
    } else {
        same
    }
}

/// Whole numbers may stand for floats; otherwise the types must match.
fn fits(old: &Value, new: &Value) -> bool {
    old.same_type(new) || (old.is_float() && new.is_integer())
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::String(_) => "a word",
        Value::Integer(_) => "a whole number",
        Value::Float(_) => "a number",
        Value::Boolean(_) => "true or false",
        Value::Datetime(_) => "a date",
        Value::Array(_) => "a list",
        Value::Table(_) => "a section",
    }
}
