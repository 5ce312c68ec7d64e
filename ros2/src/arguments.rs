//! Command line arguments: `stillpoint-ros2 --ros-args -r from:=to -p name:=value --params-file FILE -r __ns:=/robot1`.
//!
//! Parsed as by rcl (design.ros2.org, "ROS Command Line Arguments"). All settings are parameters, so the only options are `--help`,
//! `--version` and `--types`.

use crate::names::{self, NodeName, Remap};
use crate::value::Value;
use std::path::PathBuf;

/// Parsed arguments.
#[derive(Clone, Debug, PartialEq)]
pub enum Arguments {
    /// Run the node.
    Run(Box<Request>),
    /// Print the parameters.
    Help,
    /// Print the version.
    Version,
    /// List the message types and their hashes.
    Types,
}

/// How to run the node.
#[derive(Clone, Debug, PartialEq)]
pub struct Request {
    /// Name of the node.
    pub node: NodeName,
    /// Remapping rules, in the order of the arguments.
    pub remaps: Vec<Remap>,
    /// Sources of parameters, in the order of the arguments; later ones override earlier ones.
    pub parameters: Vec<Setting>,
    /// Minimum level of messages on standard error.
    pub log_level: Level,
}

/// A source of parameters.
#[derive(Clone, Debug, PartialEq)]
pub enum Setting {
    /// `-p name:=value`, for one node or for all.
    One(Option<String>, String, Value),
    /// `--params-file FILE`.
    File(PathBuf),
}

/// Log levels of `rcl_interfaces/msg/Log`.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub enum Level {
    /// For debugging.
    Debug = 10,
    /// Information.
    Info = 20,
    /// Warning.
    Warn = 30,
    /// Error.
    Error = 40,
    /// Fatal error.
    Fatal = 50,
}

impl Level {
    fn of(word: &str) -> Option<Self> {
        Some(match word.to_ascii_lowercase().as_str() {
            "debug" => Self::Debug,
            "info" => Self::Info,
            "warn" => Self::Warn,
            "error" => Self::Error,
            "fatal" => Self::Fatal,
            _ => return None,
        })
    }
}

/// Default name of the node.
pub const NODE: &str = "stillpoint";

/// Parses the arguments after the program's name.
///
/// # Errors
/// Invalid arguments, with advice.
pub fn read(arguments: impl IntoIterator<Item = String>) -> Result<Arguments, String> {
    let mut reading = Reading {
        request: Request {
            node: NodeName {
                namespace: "/".to_owned(),
                name: NODE.to_owned(),
            },
            remaps: Vec::new(),
            parameters: Vec::new(),
            log_level: Level::Info,
        },
    };
    let mut rest = arguments.into_iter();
    let mut of_ros = false;
    while let Some(word) = rest.next() {
        match (of_ros, word.as_str()) {
            (false, "--ros-args") => of_ros = true,
            (false, "-h" | "--help") => return Ok(Arguments::Help),
            (false, "-V" | "--version") => return Ok(Arguments::Version),
            (false, "--types") => return Ok(Arguments::Types),
            (false, _) => {
                return Err(format!(
                    "expected --ros-args, --help, --version or --types, found \"{word}\"; write parameters as --ros-args -p name:=value"
                ));
            }
            (true, "--") => of_ros = false,
            (true, "--ros-args") => {}
            (true, _) => reading.take(&word, &mut rest)?,
        }
    }
    reading.finish()
}

struct Reading {
    request: Request,
}

impl Reading {
    fn take(&mut self, word: &str, rest: &mut impl Iterator<Item = String>) -> Result<(), String> {
        let mut value = || {
            rest.next()
                .ok_or_else(|| format!("{word}: expected a value after it, found none"))
        };
        match word {
            "-r" | "--remap" => {
                let (node, from, to) = rule(word, &value()?)?;
                self.request.remaps.push(Remap { node, from, to });
            }
            "-p" | "--param" => {
                let (node, name, text) = rule(word, &value()?)?;
                let value = Value::parse(&text)
                    .map_err(|e| format!("{word} {name}:={text}: {e}; correct the value"))?;
                self.request
                    .parameters
                    .push(Setting::One(node, name, value));
            }
            "--params-file" => {
                let file = value()?;
                self.request.parameters.push(Setting::File(file.into()));
            }
            "--log-level" => {
                let text = value()?;
                // `name:=level` sets the level of one logger, and the node has only one.
                let word = text.rsplit_once(":=").map_or(text.as_str(), |(_, l)| l);
                self.request.log_level = Level::of(word).ok_or_else(|| {
                    format!(
                        "--log-level: expected debug, info, warn, error or fatal, found \"{text}\""
                    )
                })?;
            }
            "-e" | "--enclave" | "--log-config-file" | "--log-file-name" => {
                value()?;
            }
            _ if word.starts_with("--enable-") || word.starts_with("--disable-") => {}
            // Syntax of older launch files.
            _ if word.contains(":=") => {
                let (node, from, to) = rule(word, word)?;
                self.request.remaps.push(Remap { node, from, to });
            }
            _ => {
                return Err(format!(
                    "expected -r from:=to, -p name:=value, --params-file FILE or --log-level LEVEL after --ros-args, found \"{word}\""
                ));
            }
        }
        Ok(())
    }

    fn finish(self) -> Result<Arguments, String> {
        let mut request = self.request;
        for rule in &request.remaps {
            match rule.from.as_str() {
                "__node" | "__name" => {
                    names::check(&rule.to).map_err(|e| format!("{}: {e}", rule.from))?;
                    request.node.name.clone_from(&rule.to);
                }
                "__ns" => {
                    let given = rule.to.trim_end_matches('/');
                    if !given.is_empty() {
                        names::check(given).map_err(|e| format!("__ns: {e}"))?;
                    }
                    request.node.namespace = format!("/{}", given.trim_start_matches('/'));
                }
                _ => {
                    for name in [&rule.from, &rule.to] {
                        let bare = name.trim_start_matches("rostopic://");
                        names::check(bare.trim_start_matches("rosservice://"))
                            .map_err(|e| format!("-r {}:={}: {e}", rule.from, rule.to))?;
                    }
                }
            }
        }
        Ok(Arguments::Run(Box::new(request)))
    }
}

/// `[node:]from:=to`.
fn rule(option: &str, text: &str) -> Result<(Option<String>, String, String), String> {
    let Some((from, to)) = text.split_once(":=").filter(|(f, _)| !f.is_empty()) else {
        return Err(format!(
            "{option}: expected name:=value, found \"{text}\"; write both and := between them"
        ));
    };
    let scheme = from.contains("://");
    let (node, from) = match from.split_once(':').filter(|_| !scheme) {
        Some((node, from)) => (Some(node.to_owned()), from),
        None => (None, from),
    };
    Ok((node, from.to_owned(), to.to_owned()))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn read_words(words: &str) -> Result<Request, String> {
        match read(words.split_whitespace().map(str::to_owned))? {
            Arguments::Run(request) => Ok(*request),
            other => Err(format!("{other:?}")),
        }
    }

    #[test]
    fn typical_command_line_is_parsed() {
        let request = read_words(
            "--ros-args -r __ns:=/robot1 --remap __node:=eyes -r stillpoint:color/image_raw:=/front/image -p dense:=true --param tracking.max_gap:=3 \
             --params-file a.yaml --log-level debug --disable-rosout-logs -- ",
        )
        .unwrap();
        assert_eq!(request.node.full(), "/robot1/eyes");
        assert_eq!(request.remaps.len(), 3);
        assert_eq!(request.remaps[2].node.as_deref(), Some("stillpoint"));
        assert_eq!(request.remaps[2].to, "/front/image");
        assert_eq!(
            request.parameters,
            [
                Setting::One(None, "dense".into(), Value::Bool(true)),
                Setting::One(None, "tracking.max_gap".into(), Value::Integer(3)),
                Setting::File("a.yaml".into()),
            ]
        );
        assert_eq!(request.log_level, Level::Debug);
        assert_eq!(read_words("").unwrap().node.full(), "/stillpoint");
        assert_eq!(read(["--help".to_owned()]), Ok(Arguments::Help));
    }

    #[test]
    fn invalid_arguments_are_reported() {
        for (words, part) in [
            ("--live", "--ros-args"),
            ("--ros-args -r", "a value after it"),
            ("--ros-args -p dense", "name:=value"),
            ("--ros-args --params", "--params-file"),
            ("--ros-args -r __ns:=1x", "__ns"),
            ("--ros-args -r a:=b-c", "letters"),
            ("--ros-args --log-level loud", "debug"),
            ("--ros-args -p a:=[1,", "correct the value"),
        ] {
            let told = read_words(words).unwrap_err();
            assert!(told.contains(part), "{words}: {told}");
        }
    }
}
