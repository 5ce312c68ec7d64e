//! `lab constants`: writes docs/reference/constants.md, the numeric constants of tracking, mapping, static filter and objects, from the
//! sources.
//!
//! Unit and origin are found by keywords in the comment. Rows of lab/results/constants.jsonl (file, constant, effect), if it exists, fill a
//! column: which figure changes when a constant is halved or doubled.

use crate::results::{Line, read};
use crate::{Failure, document, origin};
use regex_lite::Regex;
use std::collections::BTreeMap;
use std::fmt::Write;
use std::path::{Path, PathBuf};
use std::process::ExitCode;

pub(crate) const RESULT: &str = "constants";
const PAGE: &str = "docs/reference/constants.md";
const FOLDERS: [(&str, &str); 4] = [
    ("slam", "crates/slam/src/"),
    ("estimation", "crates/estimation/src/"),
    ("features", "crates/features/src/"),
    ("detection: objects", "crates/detection/src/objects/"),
];
const INTRODUCTION: &str = include_str!("constants.md");
const HEAD: &str = "| constant | value | unit | meaning | from |";
const NUMBER: &str = r"^\s*(?:pub(?:\([a-z]+\))?\s+)?const\s+([A-Z][A-Z0-9_]*)\s*:\s*(f32|f64|u8|u16|u32|u64|usize|i32|i64|u128|\[[^\]]*(?:f32|f64|usize|u32|i32)[^\]]*\])\s*=(.*)";
/// The beginning of a file's tests.
const TESTS: &str = r"(?m)^\s*#\[cfg\((?:all\()?test(?:.*\n){1,2}?\s*mod \w+";
/// Keywords of each kind of source; a percentage indicates a relation.
const SOURCES: [(&str, &str); 7] = [
    ("measurement", "measured|median|percentile|ablation"),
    ("distribution", "quantile|chi|sigma|standard deviation"),
    ("data sheet", "data sheet|datasheet"),
    ("publication", r"et al|19\d\d|20\d\d|ORB-SLAM\d?"),
    ("document", "decisions?|section|equation|docs/"),
    (
        "relation",
        "half of|twice|equals|sum of|(?:three|four|five|ten) times|an? (?:third|quarter|fifth|tenth) of",
    ),
    (CHOICE, "chosen"),
];
/// Origin of a value with only a reason in its comment.
const CHOICE: &str = "choice";
const UNITS: &str = r"rad/s/sqrt\(Hz\)|(?:rad|s)/sqrt\(s\)|(?:rad|m)/s(?:\^2)?|m/rad|1/m|rad|ms?|s|px|cells|samples|bytes|grey levels";
/// A unit after a comma, or in a continued comment.
const STATED: &str = r"(?:, |^\.\.\. (?:and )?)((?:UNITS)(?: and (?:UNITS))?)(?:[^\w/^]|$)";

struct Constant {
    name: String,
    kind: String,
    value: String,
    comment: String,
}

struct Parser {
    number: Regex,
    tests: Regex,
    link: Regex,
    units: [Regex; 3],
    sources: Vec<(&'static str, Regex)>,
}

impl Parser {
    fn new() -> Result<Self, Failure> {
        let source = |(kind, words): (_, &str)| -> Result<_, Failure> {
            Ok((kind, Regex::new(&format!(r"(?i)\b(?:{words})\b"))?))
        };
        Ok(Self {
            number: Regex::new(NUMBER)?,
            tests: Regex::new(TESTS)?,
            link: Regex::new(r"\[(`[^`]+`)\](?:\([^)]*\))?")?,
            units: [
                Regex::new(&STATED.replace("UNITS", UNITS))?,
                Regex::new(r"_((?:RAD|M|PX|MS|S)(?:_S)?|SHARE|FACTOR|SIGMAS|ODDS|COSINE)$")?,
                Regex::new(r"(?i)\b(log odds|share|factor|standard deviations|weight|odds)\b")?,
            ],
            sources: SOURCES.into_iter().map(source).collect::<Result<_, _>>()?,
        })
    }

    /// Skips constants of tests.
    fn constants(&self, text: &str) -> Vec<Constant> {
        let product = self.tests.find(text).map_or(text, |m| &text[..m.start()]);
        let lines: Vec<&str> = product.lines().collect();
        let constant = |(i, line): (usize, &&str)| {
            let (_, [name, kind, value]) = self.number.captures(line)?.extract();
            let (mut value, mut rest) = (value.trim().to_owned(), lines[i + 1..].iter());
            while let (false, Some(next)) = (value.ends_with(';'), rest.next()) {
                value = format!("{value} {}", next.trim()).trim().to_owned();
            }
            let before = lines[..i].iter().rev();
            let comment = before.map_while(|l| l.trim().strip_prefix("///"));
            let mut comment: Vec<&str> = comment.map(str::trim).collect();
            comment.reverse();
            Some(Constant {
                name: name.to_owned(),
                kind: kind.to_owned(),
                value: value.trim_end_matches(';').to_owned(),
                comment: comment.join(" "),
            })
        };
        lines.iter().enumerate().filter_map(constant).collect()
    }

    /// The unit, from the comment, the name or the type.
    fn unit(&self, c: &Constant) -> String {
        let [stated, named, told] = &self.units;
        let find = |e: &Regex, text: &str| Some(e.captures(text)?.get(1)?.as_str().to_owned());
        let other = || find(named, &c.name).or_else(|| find(told, &c.comment));
        let other = || other().map(|u| u.to_lowercase().replace('_', "/"));
        let whole = ["number", ""][usize::from(c.kind.contains('f'))];
        let unit = find(stated, &c.comment).or_else(other);
        unit.unwrap_or_else(|| whole.to_owned())
    }

    /// The table cells of a constant, without the comment's links to code.
    fn cells(&self, c: &Constant) -> Vec<String> {
        let short: String = c.value.chars().take(60).collect();
        let more = ["", " ..."][usize::from(short.len() < c.value.len())];
        let said = self.link.replace_all(&c.comment, "$1").replace('|', "\\|");
        let (name, value) = (format!("`{}`", c.name), format!("`{short}{more}`"));
        let related = |kind: &str| kind == "relation" && said.contains('%');
        let states = |(kind, words): &&(&str, Regex)| words.is_match(&said) || related(kind);
        let from = self.sources.iter().filter(states).map(|(kind, _)| *kind);
        let from = from.collect::<Vec<_>>().join(", ");
        vec![name, value, self.unit(c), said, from]
    }
}

/// Sorted, without tests.
fn files(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let mut found = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(|e| format!("{}: {e}", folder.display()))? {
        let path = entry?.path();
        if path.is_dir() && !path.ends_with("tests") {
            found.extend(files(&path)?);
        } else if path.extension().is_some_and(|e| e == "rs") && !path.ends_with("tests.rs") {
            found.push(path);
        }
    }
    found.sort();
    Ok(found)
}

/// The page. `effects` by file and constant.
fn page(root: &Path, effects: &BTreeMap<[String; 2], String>) -> Result<String, Failure> {
    let parser = Parser::new()?;
    let column = [" halved or doubled |", "---|"];
    let [more, rule] = column.map(|c| if effects.is_empty() { "" } else { c });
    let mut counts =
        "| crate | constants | with a source | chosen |\n|---|---:|---:|---:|\n".to_owned();
    let (mut tables, mut bare) = (String::new(), String::new());
    for (title, folder) in FOLDERS {
        let (mut all, mut unknown, mut chosen) = (0, 0, 0);
        write!(tables, "\n## {title}\n")?;
        for path in files(&root.join(folder))? {
            let found = parser.constants(&std::fs::read_to_string(&path)?);
            let Some(_) = found.first() else { continue };
            let file = path.strip_prefix(root)?.display().to_string();
            let name = &file[folder.len()..];
            writeln!(tables, "\n### {name}\n\n{HEAD}{more}")?;
            writeln!(tables, "|---|---|---|---|---|{rule}")?;
            let rows: Vec<Vec<String>> = found.iter().map(|c| parser.cells(c)).collect();
            let is_bare = |r: &&Vec<String>| r[4].is_empty();
            let without: Vec<&str> = rows.iter().filter(is_bare).map(|r| &*r[0]).collect();
            for (c, cells) in found.iter().zip(&rows) {
                write!(tables, "| {} |", cells.join(" | "))?;
                if !more.is_empty() {
                    let effect = effects.get(&[file.clone(), c.name.clone()]);
                    write!(tables, " {} |", effect.map_or("", String::as_str))?;
                }
                tables.push('\n');
            }
            (all, unknown) = (all + found.len(), unknown + without.len());
            chosen += rows.iter().filter(|r| r[4] == CHOICE).count();
            if !without.is_empty() {
                writeln!(bare, "- `{file}`: {}", without.join(", "))?;
            }
        }
        let sourced = all - unknown - chosen;
        writeln!(counts, "| {title} | {all} | {sourced} | {chosen} |")?;
    }
    counts += &tables;
    Ok(format!(
        "{INTRODUCTION}\n{counts}\n## Without a source\n\n{bare}"
    ))
}

pub(crate) fn run(arguments: &document::Arguments) -> Result<ExitCode, Failure> {
    let root = arguments.root.clone().unwrap_or_else(origin::root);
    let results = root.join(format!("lab/results/{RESULT}.jsonl"));
    let lines = results.is_file().then(|| read(&results)).transpose()?;
    let mut effects = BTreeMap::new();
    for line in lines.unwrap_or_default() {
        if let Line::Row { cells } = line
            && let Ok([file, name, effect]) = <[String; 3]>::try_from(cells)
        {
            effects.insert([file, name], effect);
        }
    }
    let (file, fresh) = (root.join(PAGE), page(&root, &effects)?);
    if std::fs::read_to_string(&file).is_ok_and(|kept| kept == fresh) {
        return Ok(ExitCode::SUCCESS);
    }
    if arguments.check {
        println!("{PAGE}: differs from the sources; `lab constants` writes it");
        return Ok(ExitCode::FAILURE);
    }
    document::write(&file, &fresh)?;
    println!("{PAGE}: written");
    Ok(ExitCode::SUCCESS)
}

#[cfg(test)]
mod tests {
    use super::*;

    const TEXT: &str = "/// How far, m:
/// measured by [`A`](b).
pub(super) const FAR: f64 = 4.0;
    /// ... and rad/s (Wald 1945), [`B`], a|b.
    const PAIRS: [(i32, i32); 2] =
        [(0, 1)];
const NAME: &str = \"1\";
/// Intersection, machine; 95 %.
const A_PX: f32 = 1.0;
#[cfg(test)]
mod tests {
    const HIDDEN: f64 = 1.0;
}
";

    #[test]
    fn constants_are_listed_with_unit_and_source() {
        let parser = Parser::new().unwrap();
        let found = parser.constants(TEXT);
        let cells: Vec<String> = found.iter().map(|c| parser.cells(c).join(" | ")).collect();
        let expected = [
            "`FAR` | `4.0` | m | How far, m: measured by `A`. | measurement",
            r"`PAIRS` | `[(0, 1)]` | rad/s | ... and rad/s (Wald 1945), `B`, a\|b. | publication",
            "`A_PX` | `1.0` | px | Intersection, machine; 95 %. | relation",
        ];
        assert_eq!(cells, expected);
    }
}
