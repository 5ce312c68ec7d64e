//! `lab document`: generates the tables in the documents from result files.
//!
//! The text between `<!-- lab: NAME -->` and `<!-- /lab -->` is generated from `lab/results/NAME.jsonl`. `NAME 2` is the second table of
//! that file; `NAME bare` omits the line about the table's origin.

mod regions;

use crate::markdown::Kept;
use crate::results::{Line, Made, Run, read, runs};
use crate::{Failure, constants, origin, peers, views};
use regions::{Region, View, replace};
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::process::ExitCode;
use stillpoint_files::write_atomic;

/// Writes the tables of the documents from the files in lab/results
///
/// With --check nothing is written, and the exit code is 1 if a document differs from its files.
#[derive(clap::Args)]
pub(crate) struct Arguments {
    /// Write nothing; exit code 1 if a document differs from its files
    #[arg(long)]
    pub(crate) check: bool,
    /// The project's folder [default: this checkout]
    #[arg(long, value_name = "DIR")]
    pub(crate) root: Option<PathBuf>,
}

fn results(root: &Path) -> PathBuf {
    root.join("lab/results")
}

/// Atomic.
pub(crate) fn save(name: &str, lines: impl Iterator<Item = Line>) -> Result<(), Failure> {
    let folder = results(&origin::root());
    std::fs::create_dir_all(&folder)?;
    let file = folder.join(format!("{name}.jsonl"));
    let mut text = String::new();
    for line in lines {
        text += &serde_json::to_string(&line)?;
        text.push('\n');
    }
    write(&file, &text)?;
    eprintln!("written to {}", file.display());
    Ok(())
}

pub(crate) fn write(file: &Path, text: &str) -> Result<(), Failure> {
    write_atomic(file, text.as_bytes()).map_err(|e| {
        format!(
            "{}: expected a file that can be written, found: {e}",
            file.display()
        )
        .into()
    })
}

fn documents(root: &Path) -> Vec<PathBuf> {
    let (mut open, mut found) = (vec![root.join("docs")], vec![root.join("README.md")]);
    while let Some(folder) = open.pop() {
        for entry in std::fs::read_dir(folder).into_iter().flatten().flatten() {
            let path = entry.path();
            if path.is_dir() {
                open.push(path);
            } else if path.extension().is_some_and(|e| e == "md") {
                found.push(path);
            }
        }
    }
    found.sort();
    found
}

fn render(root: &Path, region: &Region) -> Result<String, Failure> {
    let lines = read(&results(root).join(format!("{}.jsonl", region.name)))?;
    let all = runs(&lines);
    let (origin, table) = if all.is_empty() {
        let (made, kept) = nth_table(&lines, region)?;
        (said(&made, &[]), kept.table())
    } else {
        let of_peers = all.iter().any(|r| peers::is_peer(&r.key.variant));
        let table = match region.view {
            Some(View::Variants) => views::variants(&all, views::position),
            Some(View::Motion) => views::variants(&all, views::motion),
            Some(View::Errors) => views::errors(&all),
            Some(View::Stages) => views::stages(&all),
            Some(View::Latency) => views::latency(&all),
            None if of_peers => views::peers(&all, &peers::titles()),
            None => views::sweep(&all),
        };
        (said(&made(&lines), &all), table)
    };
    Ok(if region.bare {
        table.to_markdown()
    } else {
        format!("{origin}\n\n{}", table.to_markdown())
    })
}

/// The file's origin, its commands joined.
fn made(lines: &[Line]) -> Made {
    let mut all = lines.iter().filter_map(|l| match l {
        Line::Made(made) => Some(made.clone()),
        _ => None,
    });
    let first = all.next().unwrap_or_default();
    all.fold(first, |made, next| Made {
        command: format!("{}`, `{}", made.command, next.command),
        ..made
    })
}

/// The region's table, and its origin.
fn nth_table(lines: &[Line], region: &Region) -> Result<(Made, Kept), Failure> {
    let (mut made, mut found): (Made, Vec<(Made, Kept)>) = (Made::default(), Vec::new());
    for line in lines {
        match line {
            Line::Made(m) => made = m.clone(),
            Line::Table(columns) => {
                let columns = columns.clone();
                let rows = Vec::new();
                found.push((made.clone(), Kept { columns, rows }));
            }
            Line::Row { cells } => {
                let (_, kept) = found.last_mut().ok_or("a row before any table")?;
                kept.rows.push(cells.clone());
            }
            Line::Run(_) => {}
        }
    }
    let count = found.len();
    let table = found.into_iter().nth(region.number - 1);
    table.ok_or_else(|| {
        format!(
            "{}: expected table {}, found {count} in its file",
            region.name, region.number
        )
        .into()
    })
}

/// The line about a table's origin: command, commit, machine, seeds.
fn said(made: &Made, all: &[Run]) -> String {
    let each = |of: &dyn Fn(&Run) -> String| -> BTreeSet<String> { all.iter().map(of).collect() };
    let joined = |values: Vec<String>| (!values.is_empty()).then(|| values.join(" and "));
    // Packages of other projects have a version (`pyorbslam3==0.1.1`) instead of a commit.
    let programs = each(&|r| r.commit.clone()).into_iter();
    let (others, own): (Vec<String>, Vec<String>) = programs.partition(|c| c.contains("=="));
    let own = joined(own).map(|own| match joined(others) {
        Some(others) => format!("{own} beside {}", others.replace("==", " ")),
        None => own,
    });
    let commit = made.commit.clone().or(own);
    let machines = each(&|r| r.machine.to_string()).into_iter().collect();
    let machine = made.machine.clone().or(joined(machines));
    let seeds = all.iter().map(|r| r.key.seed);
    let range = seeds.clone().min().zip(seeds.max());
    let seeds = made.seeds.clone().or(range.map(|(first, last)| {
        if first == last {
            format!("seed {first}")
        } else {
            format!("seeds {first} to {last}")
        }
    }));
    let unknown = |what: &str| format!("{what} not noted");
    format!(
        "Made by `{}`, {} {}; {}; {}.",
        made.command,
        if made.from_document {
            "noted in commit"
        } else {
            "commit"
        },
        commit.unwrap_or_else(|| unknown("which was")),
        machine.unwrap_or_else(|| unknown("machine")),
        seeds.unwrap_or_else(|| unknown("seeds")),
    )
}

pub(crate) fn run(arguments: &Arguments) -> Result<ExitCode, Failure> {
    let root = arguments.root.clone().unwrap_or_else(origin::root);
    // The table of constants reads its result file itself.
    let mut shown = BTreeSet::from([constants::RESULT.to_owned()]);
    let (mut differ, mut tables) = (Vec::new(), 0);
    for file in documents(&root) {
        let name = file.strip_prefix(&root).unwrap_or(&file).display();
        let text = std::fs::read_to_string(&file)?;
        let fresh = replace(&text, |region| {
            shown.insert(region.name.clone());
            tables += 1;
            render(&root, region)
        });
        let fresh = fresh.map_err(|e| format!("{name}: {e}"))?;
        if fresh == text {
            continue;
        }
        differ.push(name.to_string());
        if !arguments.check {
            write(&file, &fresh)?;
        }
    }
    for entry in std::fs::read_dir(results(&root)).into_iter().flatten() {
        let path = entry?.path();
        let stem = path.file_stem().map(|s| s.to_string_lossy().into_owned());
        if let Some(name) = stem.filter(|s| !shown.contains(s)) {
            eprintln!("lab/results/{name}.jsonl: no document shows it");
        }
    }
    let words = if arguments.check {
        "differs from its result files; `lab document` writes it"
    } else {
        "written"
    };
    for name in &differ {
        println!("{name}: {words}");
    }
    println!("{tables} tables of {} result files", shown.len() - 1);
    Ok(if arguments.check && !differ.is_empty() {
        ExitCode::FAILURE
    } else {
        ExitCode::SUCCESS
    })
}
