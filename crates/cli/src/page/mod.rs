//! `report`: remakes the page of a run, or makes one of several runs.

pub(crate) mod data;

use crate::args::report::ReportArgs;
use crate::console;
use crate::failure::{Failure, Status};
use crate::output::StreamedFile;
use std::io::Write;
use std::path::PathBuf;
use stillpoint::view::report::to_html;

pub(crate) const FILE: &str = "report.html";
const COMPARISON: &str = "comparison.html";

pub(crate) fn report(args: &ReportArgs) -> Result<Status, Failure> {
    let runs = args.results.iter().map(|folder| data::of_folder(folder));
    let runs = runs.collect::<Result<Vec<_>, _>>()?;
    let out = args.out.clone().unwrap_or_else(|| match &args.results[..] {
        [folder] => folder.join(FILE),
        _ => PathBuf::from(COMPARISON),
    });
    let mut file = StreamedFile::create(&out, "--out")?;
    file.write(|w| w.write_all(to_html(&runs).as_bytes()))?;
    file.finish()?;
    console::report(&format!("report in {}\n", out.display()));
    Ok(Status::Ok)
}

/// The command line, quoted for a shell.
pub(crate) fn typed() -> String {
    let quoted = crate::typed().map(|a| quoted(&a.to_string_lossy()));
    let words: Vec<String> = std::iter::once("stillpoint".to_owned())
        .chain(quoted)
        .collect();
    words.join(" ")
}

fn quoted(word: &str) -> String {
    let plain = |c: char| c.is_ascii_alphanumeric() || "-_./=:,+@%".contains(c);
    if !word.is_empty() && word.chars().all(plain) {
        return word.to_owned();
    }
    format!("'{}'", word.replace('\'', "'\\''"))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn words_are_quoted_for_the_shell() {
        for (word, expected) in [
            ("--set=a.b=1", "--set=a.b=1"),
            ("my run", "'my run'"),
            ("", "''"),
            ("it's", "'it'\\''s'"),
            ("$HOME", "'$HOME'"),
        ] {
            assert_eq!(quoted(word), expected);
        }
    }
}
