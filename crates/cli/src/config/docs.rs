//! The configuration as commented text, for `config print` and result folders.
//!
//! The comments are the doc comments of the fields in the source; a test compares the two and can renew the file.

use crate::failure::Failure;
use stillpoint::slam::Config;

/// One line per value: its path, a tab, its meaning.
const DOCS: &str = include_str!("docs.txt");

/// The meaning of a value or section, e.g. of `tracking.min_inliers`.
pub(crate) fn doc_of(path: &str) -> Option<&'static str> {
    DOCS.lines()
        .filter_map(|line| line.split_once('\t'))
        .find(|(p, _)| *p == path)
        .map(|(_, doc)| doc)
}

/// The configuration as TOML, every value with its meaning as a comment.
pub(crate) fn to_text(config: &Config) -> Result<String, Failure> {
    let plain = with_list_last(&plain_text(config)?, "[motion_weights]");
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

/// Moves a section to the end: a list of 80 short lines would separate the sections around it.
fn with_list_last(text: &str, heading: &str) -> String {
    let (mut rest, mut list) = (String::new(), String::new());
    let mut inside = false;
    for line in text.lines() {
        if line.starts_with('[') {
            inside = line == heading;
        }
        let part = if inside { &mut list } else { &mut rest };
        part.push_str(line);
        part.push('\n');
    }
    format!("{}\n\n{}\n", rest.trim_end(), list.trim_end())
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

/// The configuration as TOML.
pub(crate) fn plain_text(config: &Config) -> Result<String, Failure> {
    toml::to_string(config)
        .map_err(|e| Failure::input(format!("the configuration cannot be written as TOML: {e}")))
}
