//! The configuration: defaults, a file, or keys and values.

use crate::arguments::{path, value, words as text, wrong_type};
use pyo3::exceptions::PyValueError;
use pyo3::prelude::*;
use pyo3::types::{PyBool, PyDict, PyFloat, PyInt, PyString};
use std::path::PathBuf;
use stillpoint::slam::Config as Values;
use stillpoint_cli::front;

/// Configuration of the system: the defaults, overridden by a file (TOML), overridden by single values.
///
/// Args:
///     file: a configuration file; settings not given keep their defaults.
///     set: values by their dotted keys, or by sections as nested dicts.
///
/// Raises:
///     ValueError: an unreadable file, an unknown key, or a value out of range; the message names it.
///
/// >>> Config({"features.features": 1500}) == Config({"features": {"features": 1500}})
/// True
/// >>> Config({"features.features": -1})
/// Traceback (most recent call last):
/// ...
/// ValueError: config: --set features.features=-1: expected another value for features.features (as in features.features = 1000), found -1: invalid value: integer `-1`, expected usize; correct the value
#[pyclass(frozen, eq, module = "stillpoint_slam")]
#[derive(Clone, PartialEq)]
pub(crate) struct Config {
    pub(crate) values: Values,
}

impl Config {
    /// Accepts None, a [`Config`], a file, or values.
    pub(crate) fn from_any(found: Option<&Bound<'_, PyAny>>) -> PyResult<Values> {
        let Some(found) = found else {
            return Ok(Self::resolve(None, None)?.values);
        };
        if let Ok(config) = found.cast::<Self>() {
            return Ok(config.get().values.clone());
        }
        if let Ok(set) = found.cast::<PyDict>() {
            return Ok(Self::resolve(None, Some(set))?.values);
        }
        if found.extract::<PathBuf>().is_err() {
            return Err(wrong_type(
                "config",
                "a Config, a TOML file or a dict of values",
                found,
            ));
        }
        Ok(Self::resolve(Some(path("config", found)?), None)?.values)
    }

    fn resolve(file: Option<PathBuf>, set: Option<&Bound<'_, PyDict>>) -> PyResult<Self> {
        let mut words = Vec::new();
        if let Some(set) = set {
            flatten(set, "", 0, &mut words)?;
        }
        let values = front::config(file.as_deref(), &words).map_err(|e| value("config", e))?;
        Ok(Self { values })
    }
}

/// Maximum depth of nested sections; the configuration has two.
const DEEPEST: usize = 8;

/// Values in the form of `--set`.
fn flatten(
    set: &Bound<'_, PyDict>,
    prefix: &str,
    depth: usize,
    words: &mut Vec<String>,
) -> PyResult<()> {
    for (key, found) in set {
        let path = format!("{prefix}{}", text("config", &key)?);
        if let Ok(section) = found.cast::<PyDict>() {
            if depth == DEEPEST {
                return Err(value(
                    "config",
                    format!("expected values, found sections within sections at {path}"),
                ));
            }
            flatten(section, &format!("{path}."), depth + 1, words)?;
            continue;
        }
        let text = if found.is_instance_of::<PyBool>() {
            found.extract::<bool>()?.to_string()
        } else if found.is_instance_of::<PyInt>() {
            found.str()?.to_str()?.to_owned()
        } else if found.is_instance_of::<PyFloat>() {
            format!("{:?}", found.extract::<f64>()?)
        } else if found.is_instance_of::<PyString>() {
            let word = text("config", &found)?;
            let escaped = word
                .replace('\\', "\\\\")
                .replace('"', "\\\"")
                .replace('\n', "\\n");
            format!("\"{escaped}\"")
        } else {
            return Err(wrong_type(
                "config",
                &format!("a number, a word or a bool for {path}"),
                &found,
            ));
        };
        words.push(format!("{path}={text}"));
    }
    Ok(())
}

#[pymethods]
impl Config {
    #[new]
    #[pyo3(signature = (set=None, *, file=None))]
    fn new(set: Option<&Bound<'_, PyAny>>, file: Option<&Bound<'_, PyAny>>) -> PyResult<Self> {
        let file = file.map(|f| path("file", f)).transpose()?;
        let values = match set {
            None => None,
            Some(found) => match found.cast::<PyDict>() {
                Ok(values) => Some(values),
                Err(_) => return Err(wrong_type("set", "a dict of values", found)),
            },
        };
        Self::resolve(file, values)
    }

    /// All settings with their descriptions, as TOML.
    fn to_toml(&self) -> PyResult<String> {
        front::config_text(&self.values).map_err(|e| PyValueError::new_err(e.to_string()))
    }

    fn __repr__(&self) -> String {
        let default = self.values == Values::default();
        format!(
            "<Config: {}>",
            if default {
                "the defaults"
            } else {
                "see to_toml()"
            }
        )
    }
}
