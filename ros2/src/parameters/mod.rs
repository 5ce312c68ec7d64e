//! The parameters of the node: its own, and the whole configuration of the system under its own names.

mod file;

use crate::arguments::{Request, Setting};
use crate::options::{self, Counts, Options};
use crate::value::Value;
use serde::Deserialize;
use std::collections::BTreeMap;
use stillpoint::slam::Config;

/// A parameter.
#[derive(Clone, Debug, PartialEq)]
pub struct Parameter {
    /// Current value.
    pub value: Value,
    /// When changes take effect.
    pub counts: Counts,
    /// Description.
    pub text: String,
}

/// All parameters.
#[derive(Clone, Debug)]
pub struct Parameters {
    all: BTreeMap<String, Parameter>,
    config: Config,
    /// Whether the node has started, which fixes some parameters.
    started: bool,
}

const WEIGHTS: &str = "motion_weights.";

impl Default for Parameters {
    fn default() -> Self {
        let mut all = BTreeMap::new();
        for described in options::ALL {
            // The table's values are valid YAML.
            let value = Value::parse(described.default).unwrap_or(Value::Text(String::new()));
            all.insert(
                described.name.to_owned(),
                Parameter {
                    value,
                    counts: described.counts,
                    text: described.text.to_owned(),
                },
            );
        }
        let config = Config::default();
        for (name, value) in leaves(&config) {
            all.insert(name, of_config(value));
        }
        Self {
            all,
            config,
            started: false,
        }
    }
}

fn of_config(value: Value) -> Parameter {
    Parameter {
        value,
        counts: Counts::NextRun,
        text: "Of the system: see `stillpoint config print`.".to_owned(),
    }
}

impl Parameters {
    /// Parameters of the command line and its files.
    ///
    /// # Errors
    /// Unreadable files, unknown names, values of wrong type or range.
    pub fn new(request: &Request) -> Result<Self, String> {
        let mut parameters = Self::default();
        for setting in &request.parameters {
            match setting {
                Setting::One(node, name, value) => {
                    if node.as_ref().is_none_or(|n| *n == request.node.name) {
                        parameters.set(name, value)?;
                    }
                }
                Setting::File(path) => {
                    for (name, value) in file::read(path, &request.node)? {
                        parameters
                            .set(&name, &value)
                            .map_err(|e| format!("{}: {e}", path.display()))?;
                    }
                }
            }
        }
        Options::new(&parameters)?;
        Ok(parameters)
    }

    /// Makes parameters read-only that take effect only at the start.
    pub fn start(&mut self) {
        self.started = true;
    }

    /// The value of a parameter.
    #[must_use]
    pub fn get(&self, name: &str) -> Option<&Value> {
        self.all.get(name).map(|p| &p.value)
    }

    /// A parameter with its description.
    #[must_use]
    pub fn parameter(&self, name: &str) -> Option<&Parameter> {
        self.all.get(name)
    }

    /// Whether a parameter can no longer change.
    #[must_use]
    pub fn is_read_only(&self, name: &str) -> bool {
        let counts = self.all.get(name).map(|p| p.counts);
        self.started && counts == Some(Counts::AtStart)
    }

    /// All names, sorted.
    pub fn names(&self) -> impl Iterator<Item = &str> {
        self.all.keys().map(String::as_str)
    }

    /// The configuration of the system.
    #[must_use]
    pub fn config(&self) -> &Config {
        &self.config
    }

    /// Sets several parameters or none.
    ///
    /// # Errors
    /// The first that cannot be set.
    pub fn set_all(&mut self, values: &[(String, Value)]) -> Result<(), String> {
        let mut after = self.clone();
        for (name, value) in values {
            after.set(name, value)?;
        }
        *self = after;
        Ok(())
    }

    /// Sets a parameter.
    ///
    /// # Errors
    /// Unknown name, wrong type or range, or read-only. Nothing changes then.
    pub fn set(&mut self, name: &str, value: &Value) -> Result<(), String> {
        if self.is_read_only(name) {
            return Err(format!(
                "{name}: counts only when the node starts; start it with --ros-args -p {name}:={value}"
            ));
        }
        let is_weight = name.starts_with(WEIGHTS);
        // Only weights that differ from their defaults are listed, but all may be set.
        let weight = is_weight.then(|| of_config(Value::Double(0.0)));
        let Some(known) = self.all.get(name).cloned().or(weight) else {
            return Err(self.unknown(name));
        };
        let fitting = fit(value, &known.value).ok_or_else(|| {
            format!(
                "{name}: expected {} (as in {}), found {} {value}; correct the value",
                known.value.kind(),
                known.value,
                value.kind()
            )
        })?;
        let mut after = self.clone();
        let new = Parameter {
            value: fitting,
            ..known
        };
        after.all.insert(name.to_owned(), new);
        if options::ALL.iter().any(|d| d.name == name) {
            Options::new(&after)?;
        } else {
            after.config = after.read_config(name)?;
        }
        *self = after;
        Ok(())
    }

    fn unknown(&self, name: &str) -> String {
        let section = name.split('.').next().unwrap_or(name);
        let alike: Vec<&str> = self
            .names()
            .filter(|n| n.split('.').next() == Some(section))
            .collect();
        let hint = if alike.is_empty() {
            "`stillpoint-ros2 --help` and `stillpoint config print` list them".to_owned()
        } else {
            format!("there are {}", alike.join(", "))
        };
        format!("expected the name of a parameter, found \"{name}\"; {hint}")
    }

    fn read_config(&self, changed: &str) -> Result<Config, String> {
        let mut table = toml::Table::new();
        let of_node = |name: &str| options::ALL.iter().any(|d| d.name == name);
        for (name, parameter) in self.all.iter().filter(|(n, _)| !of_node(n)) {
            let mut parts: Vec<&str> = name.split('.').collect();
            let Some(last) = parts.pop() else { continue };
            let mut inner = &mut table;
            for part in parts {
                let entry = inner
                    .entry(part)
                    .or_insert_with(|| toml::Table::new().into());
                let toml::Value::Table(deeper) = entry else {
                    return Err(format!("{changed}: expected a section, found a value"));
                };
                inner = deeper;
            }
            inner.insert(last.to_owned(), to_toml(&parameter.value));
        }
        let config = Config::deserialize(table)
            .map_err(|e| format!("{changed}: {}", e.message().replace('\n', " ")))?;
        config.validate().map_err(|e| e.to_string())?;
        Ok(config)
    }
}

/// Converts a value to the type of another, if possible.
fn fit(value: &Value, like: &Value) -> Option<Value> {
    match (value, like) {
        (Value::Integer(i), Value::Double(_)) => Some(Value::Double(*i as f64)),
        (Value::Integers(l), Value::Doubles(_)) => {
            Some(Value::Doubles(l.iter().map(|i| *i as f64).collect()))
        }
        // A word that YAML parses as another type.
        (Value::Integer(i), Value::Text(_)) => Some(Value::Text(i.to_string())),
        _ if value.type_number() == like.type_number() => Some(value.clone()),
        _ => None,
    }
}

/// The values of the configuration, with dotted names.
fn leaves(config: &Config) -> Vec<(String, Value)> {
    let mut found = Vec::new();
    if let Ok(table) = toml::Table::try_from(config) {
        flatten("", &table, &mut found);
    }
    found
}

/// The configuration as a table, as in logs.
#[must_use]
pub fn to_table(config: &Config) -> toml::Table {
    toml::Table::try_from(config).unwrap_or_default()
}

fn flatten(prefix: &str, table: &toml::Table, to: &mut Vec<(String, Value)>) {
    for (key, value) in table {
        let name = format!("{prefix}{key}");
        match value {
            toml::Value::Table(inner) => flatten(&format!("{name}."), inner, to),
            toml::Value::String(s) => to.push((name, Value::Text(s.clone()))),
            toml::Value::Integer(i) => to.push((name, Value::Integer(*i))),
            toml::Value::Float(x) => to.push((name, Value::Double(*x))),
            toml::Value::Boolean(b) => to.push((name, Value::Bool(*b))),
            toml::Value::Array(items) => {
                let numbers = items.iter().filter_map(|v| match v {
                    toml::Value::Float(x) => Some(*x),
                    toml::Value::Integer(i) => Some(*i as f64),
                    _ => None,
                });
                to.push((name, Value::Doubles(numbers.collect())));
            }
            toml::Value::Datetime(_) => {}
        }
    }
}

fn to_toml(value: &Value) -> toml::Value {
    match value.clone() {
        Value::Bool(b) => b.into(),
        Value::Integer(i) => i.into(),
        Value::Double(x) => x.into(),
        Value::Text(t) => t.into(),
        Value::Integers(l) => l.into(),
        Value::Doubles(l) => l.into(),
        Value::Texts(l) => l.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::arguments::{Arguments, read};

    fn parameters(words: &str) -> Result<Parameters, String> {
        match read(words.split_whitespace().map(str::to_owned))? {
            Arguments::Run(request) => Parameters::new(&request),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn configuration_settings_are_parameters() {
        let mut p = parameters("--ros-args -p seed:=7 -p motion_weights.chair:=2").unwrap();
        assert_eq!(p.config().seed, 7);
        assert_ne!(p.config().motion_weights, Config::default().motion_weights);
        let names: Vec<&str> = p.names().collect();
        for (name, _) in leaves(&Config::default()) {
            assert!(names.contains(&name.as_str()), "{name}");
        }
        let stride = Value::Integer(3);
        p.set("detector.stride", &stride).unwrap();
        assert_eq!(p.config().detector.stride, 3);
        assert_eq!(p.get("detector.stride"), Some(&stride));
        let before = p.config().clone();
        let refused = p.set("detector.stride", &Value::Integer(0)).unwrap_err();
        assert!(refused.contains("detector.stride"), "{refused}");
        assert_eq!(*p.config(), before);
        assert_eq!(p.get("detector.stride"), Some(&stride));
    }

    #[test]
    fn parameter_files_follow_ros_rules() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.yaml");
        let text = "/**:\n  ros__parameters:\n    max_dt: 0.03\n    seed: 1\nrobot1:\n  eyes:\n    ros__parameters:\n      seed: 2\n      detector: {stride: 4}\n/other:\n  ros__parameters:\n    seed: 9\n    nonsense: 1\n/*/eyes:\n  ros__parameters:\n    dense: true\n";
        std::fs::write(&path, text).unwrap();
        let words = format!(
            "--ros-args -r __ns:=/robot1 -r __node:=eyes --params-file {}",
            path.display()
        );
        // The configuration has a section with the name of a node parameter.
        let p = parameters(&words).unwrap();
        assert_eq!(p.config().seed, 2);
        assert_eq!(p.config().detector.stride, 4);
        assert_eq!(p.get("max_dt"), Some(&Value::Double(0.03)));
        assert_eq!(p.get("dense"), Some(&Value::Bool(true)));
        let words = format!("--ros-args --params-file {} -p seed:=5", path.display());
        assert_eq!(parameters(&words).unwrap().config().seed, 5);
    }

    #[test]
    fn invalid_parameters_are_reported_and_change_nothing() {
        for (words, part) in [
            (
                "-p colour_transport:=raw",
                "expected the name of a parameter",
            ),
            ("-p detector.strid:=1", "detector.stride"),
            ("-p seed:=much", "a whole number"),
            ("-p reliability:=always", "best_effort or reliable"),
            ("-p base_frame:=''", "the name of a frame"),
            ("--params-file /no/such.yaml", "/no/such.yaml: expected"),
            ("-p dense_voxel:=9", "0.002 to 0.5"),
        ] {
            let told = parameters(&format!("--ros-args {words}")).unwrap_err();
            assert!(told.contains(part), "{words}: {told}");
        }
        let mut p = Parameters::default();
        let both = [
            ("seed".to_owned(), Value::Integer(3)),
            ("seeds".to_owned(), Value::Integer(3)),
        ];
        assert!(p.set_all(&both).is_err());
        assert_eq!(p.config().seed, Config::default().seed);
        p.start();
        let told = p.set("reliability", &Value::Text("reliable".into()));
        assert!(told.unwrap_err().contains("when the node starts"));
        p.set("map_file", &Value::Text("a.spmap".into())).unwrap();
    }
}
