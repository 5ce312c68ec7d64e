//! `lab record`: runs an experiment and saves its tables as a result file for the documents.

use crate::markdown::tables;
use crate::origin::{self, Machine};
use crate::results::{Line, Made};
use crate::{Failure, document};
use std::io::{BufRead, BufReader};
use std::process::{Command, ExitCode, Stdio};

/// Runs an experiment and saves the tables that it prints in lab/results/NAME.jsonl, with command, commit and machine
///
/// The exit code is the experiment's; nothing is saved if it is neither 0 nor 1.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Name of the result file, as documents have it between `<!-- lab: NAME -->` and `<!-- /lab -->`
    name: String,
    /// The experiment and its arguments
    #[arg(
        required = true,
        trailing_var_arg = true,
        allow_hyphen_values = true,
        value_name = "EXPERIMENT"
    )]
    experiment: Vec<String>,
}

fn seeds(text: &str) -> Option<String> {
    let words: Vec<&str> = text.split_whitespace().collect();
    let pair = words.windows(2).find(|w| {
        let word = w[1].trim_end_matches([',', ';', ':', '.']);
        ["seed", "seeds"].contains(&word) && w[0].parse::<u32>().is_ok()
    })?;
    Some(format!("{} seeds", pair[0]))
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let mut command = Command::new(std::env::current_exe()?);
    command.args(&arguments.experiment);
    let mut child = command
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .spawn()?;
    let mut text = String::new();
    for line in BufReader::new(child.stdout.take().ok_or("no stdout")?).lines() {
        let line = line?;
        println!("{line}");
        text += &line;
        text.push('\n');
    }
    let status = child.wait()?;
    let typed = format!("lab {}", arguments.experiment.join(" "));
    let code = match status.code() {
        Some(code @ (0 | 1)) => code as u8,
        _ => return Err(format!("{typed}: expected exit code 0 or 1, found {status}").into()),
    };
    let found = tables(&text);
    if found.is_empty() {
        return Err(format!("{typed}: expected a table on its stdout, found none").into());
    }
    let made = Line::Made(Made {
        command: typed,
        commit: Some(origin::commit(&origin::root())),
        machine: Some(Machine::here().to_string()),
        seeds: seeds(&text),
        from_document: false,
    });
    let lines = std::iter::once(made).chain(found.iter().flat_map(|t| t.lines()));
    document::save(&arguments.name, lines)?;
    Ok(ExitCode::from(code))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn seed_count_is_read_from_the_text() {
        let said = |text| seeds(text).unwrap_or_default();
        assert_eq!(said("10 seeds, 150 frames; ATE in mm"), "10 seeds");
        assert_eq!(said("of 3 seeds: x"), "3 seeds");
        assert_eq!(said("many seeds"), "");
    }
}
