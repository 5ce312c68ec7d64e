//! The configuration: defaults, then the file, then `--set`, then `--seed`; later ones win.
//!
//! Answers: what the system is run with, and which line or argument is wrong when something is. What values mean and
//! which are valid is the business of the crates that use them.

use crate::args::{ConfigArgs, PrintArgs};
use crate::config_docs::doc_of;
use crate::console;
use crate::failure::{Failure, Status};
use serde::Deserialize;
use std::path::Path;
use stillpoint::imaging::Simd;
use stillpoint::slam::Config;
use toml::de::{DeTable, DeValue};
use toml::{Table, Value};

/// `config print`.
pub(crate) fn print(args: &PrintArgs) -> Result<Status, Failure> {
    console::print(&to_text(&resolve(&args.config)?)?);
    Ok(Status::Ok)
}

/// The configuration that the arguments ask for, checked.
pub(crate) fn resolve(args: &ConfigArgs) -> Result<Config, Failure> {
    let mut layers = Layers::new()?;
    if let Some(path) = &args.config {
        let text = std::fs::read_to_string(path).map_err(|e| {
            Failure::input(format!(
                "{}: expected a configuration file, found: {e}; check the path",
                path.display()
            ))
        })?;
        layers.add(&text, &Origin::File(path))?;
    }
    for set in &args.set {
        layers.add(set, &Origin::Set(set))?;
    }
    if let Some(seed) = args.seed {
        let text = format!("seed={seed}");
        layers.add(&text, &Origin::Set(&text))?;
    }
    let config = layers.config;
    config.validate().map_err(Failure::input)?;
    Ok(config)
}

/// The instruction set: that of the machine, or portable code when the environment says `STILLPOINT_SIMD=scalar`. The
/// results are the same to the bit; only the speed differs.
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

/// The configuration as TOML, every value with its meaning as a comment.
pub(crate) fn to_text(config: &Config) -> Result<String, Failure> {
    let plain = plain_text(config)?;
    let mut text =
        String::from("# Configuration of Stillpoint. What is left out keeps its default.\n");
    let mut section = String::new();
    for line in plain.lines() {
        if let Some(name) = line.strip_prefix('[').and_then(|l| l.strip_suffix(']')) {
            section = format!("{name}.");
            comment(&mut text, name);
        } else if let Some((key, _)) = line.split_once(" = ") {
            comment(&mut text, &format!("{section}{key}"));
        }
        text.push_str(line);
        text.push('\n');
    }
    Ok(text)
}

/// Adds the meaning of a key, wrapped to lines of 100 characters.
fn comment(text: &mut String, key: &str) {
    const WIDTH: usize = 100;
    let Some(doc) = doc_of(key) else { return };
    let mut line = String::from("#");
    for word in doc.split_whitespace() {
        if line.chars().count() + 1 + word.chars().count() > WIDTH {
            text.push_str(&line);
            text.push('\n');
            line = String::from("#");
        }
        line.push(' ');
        line.push_str(word);
    }
    text.push_str(&line);
    text.push('\n');
}

fn plain_text(config: &Config) -> Result<String, Failure> {
    toml::to_string(config)
        .map_err(|e| Failure::input(format!("the configuration cannot be written as TOML: {e}")))
}

/// Where values come from, for messages.
enum Origin<'a> {
    File(&'a Path),
    Set(&'a str),
}

impl Origin<'_> {
    /// The place of byte `at` of the text.
    fn place(&self, text: &str, at: usize) -> String {
        match self {
            Self::File(path) => {
                let before = &text.as_bytes()[..at.min(text.len())];
                let line = before.iter().filter(|b| **b == b'\n').count() + 1;
                format!("{}:{line}", path.display())
            }
            Self::Set(argument) => format!("--set {argument}"),
        }
    }
}

/// The values so far, as a table and as what it means.
struct Layers {
    table: Table,
    config: Config,
}

impl Layers {
    fn new() -> Result<Self, Failure> {
        let config = Config::default();
        // By way of the text, so that 32-bit values keep their short decimal form.
        let table = plain_text(&config)?
            .parse::<Table>()
            .map_err(Failure::input)?;
        Ok(Self { table, config })
    }

    /// Lays the values of `text` (TOML) over those so far.
    fn add(&mut self, text: &str, origin: &Origin<'_>) -> Result<(), Failure> {
        let fail = |e: toml::de::Error| {
            let at = e.span().map_or(0, |s| s.start);
            let hint = match origin {
                Origin::File(_) => "correct the file",
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
        let known = self.leaf_mut(path);
        let Some(old) = known else {
            let mut all = Vec::new();
            flatten(&self.table, None, "", &mut all);
            let names: Vec<&str> = all.iter().map(|l| l.0.as_str()).collect();
            let nearest = nearest(path, &names).unwrap_or_default();
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

    fn leaf_mut(&mut self, path: &str) -> Option<&mut Value> {
        let mut parts = path.split('.');
        let mut value = self.table.get_mut(parts.next()?)?;
        for part in parts {
            value = value.as_table_mut()?.get_mut(part)?;
        }
        (!value.is_table()).then_some(value)
    }
}

/// All values with their dotted paths and where their keys stand in the text.
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
            // An empty section says nothing.
            Value::Table(_) => {}
            _ => leaves.push((path, value, at)),
        }
    }
}

/// Whole numbers may stand for others; everything else needs its own kind.
fn fits(old: &Value, new: &Value) -> bool {
    old.same_type(new) || (old.is_float() && new.is_integer())
}

fn kind(value: &Value) -> &'static str {
    match value {
        Value::String(_) => "a word in quotes",
        Value::Integer(_) => "a whole number",
        Value::Float(_) => "a number",
        Value::Boolean(_) => "true or false",
        Value::Datetime(_) => "a date",
        Value::Array(_) => "a list",
        Value::Table(_) => "a section",
    }
}

/// The name that takes the fewest edits to become `path`; a path without its section counts as nearly right.
fn nearest<'a>(path: &str, names: &[&'a str]) -> Option<&'a str> {
    let last = |p: &str| p.rsplit('.').next().unwrap_or_default().to_owned();
    names.iter().copied().min_by_key(|name| {
        let whole = distance(path, name);
        whole.min(distance(&last(path), &last(name)) + 1)
    })
}

/// Levenshtein distance.
fn distance(a: &str, b: &str) -> usize {
    let b: Vec<char> = b.chars().collect();
    let mut row: Vec<usize> = (0..=b.len()).collect();
    for (i, x) in a.chars().enumerate() {
        let mut diagonal = row[0];
        row[0] = i + 1;
        for (j, y) in b.iter().enumerate() {
            let replaced = diagonal + usize::from(x != *y);
            diagonal = row[j + 1];
            row[j + 1] = replaced.min(row[j] + 1).min(diagonal + 1);
        }
    }
    row[b.len()]
}

#[cfg(test)]
mod tests {
    use super::*;

    fn layered(texts: &[(&str, bool)]) -> Result<Config, String> {
        let mut layers = Layers::new().unwrap();
        for (text, is_file) in texts {
            let origin = if *is_file {
                Origin::File(Path::new("my.toml"))
            } else {
                Origin::Set(text)
            };
            layers.add(text, &origin).map_err(|e| e.to_string())?;
        }
        Ok(layers.config)
    }

    #[test]
    fn later_layers_win_and_leave_the_rest() {
        let c = layered(&[
            ("seed = 3\n[tracking]\nmin_inliers = 40\n", true),
            ("tracking.min_inliers=50", false),
        ])
        .unwrap();
        assert_eq!((c.seed, c.tracking.min_inliers), (3, 50));
        assert_eq!(c.mapping, Config::default().mapping);
    }

    #[test]
    fn whole_numbers_stand_for_others() {
        let c = layered(&[("sensor.max_depth=6", false)]).unwrap();
        assert_eq!(c.sensor.max_depth, 6.0);
    }

    #[test]
    fn mistakes_name_place_path_and_remedy() {
        for (text, is_file, parts) in [
            (
                "[tracking]\nmin_inlier = 40\n",
                true,
                &[
                    "my.toml:2",
                    "tracking.min_inlier\"",
                    "\"tracking.min_inliers\"",
                ][..],
            ),
            (
                "min_inliers=4",
                false,
                &["--set min_inliers=4", "\"tracking.min_inliers\""],
            ),
            (
                "tracking.min_inliers=true",
                false,
                &["a whole number", "true or false", "tracking.min_inliers"],
            ),
            (
                "tracking.min_inliers=-5",
                false,
                &["tracking.min_inliers", "-5"],
            ),
            (
                "tracking.min_inliers=4.5",
                false,
                &["a whole number", "4.5"],
            ),
            ("tracking=4", false, &["found \"tracking\""]),
            ("seed", false, &["--set seed", "TOML"]),
            ("seed=many", false, &["--set seed=many", "quotes"]),
            ("\n\nseed = \n", true, &["my.toml:3"]),
            ("", false, &["no value"]),
        ] {
            let e = layered(&[(text, is_file)]).unwrap_err();
            for part in parts {
                assert!(e.contains(part), "{e:?} lacks {part:?}");
            }
        }
    }

    #[test]
    fn the_printed_configuration_reads_back() {
        let mut config = Config {
            seed: 9,
            ..Config::default()
        };
        config.sensor.max_depth = 5.5;
        let text = to_text(&config).unwrap();
        assert_eq!(toml::from_str::<Config>(&text).unwrap(), config);
        assert_eq!(layered(&[(&text, true)]).unwrap(), config);
    }

    #[test]
    fn every_value_has_its_meaning() {
        let table = Layers::new().unwrap().table;
        let mut leaves = Vec::new();
        flatten(&table, None, "", &mut leaves);
        for (path, ..) in leaves {
            assert!(
                doc_of(&path).is_some(),
                "{path} lacks a line in config_docs.txt"
            );
        }
    }
}
