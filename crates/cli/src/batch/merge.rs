//! `batch merge`: joins the tables of several batches; the results stay in place.

use crate::args::batch::BatchMergeArgs;
use crate::batch::lock::Lock;
use crate::batch::result;
use crate::batch::row::Row;
use crate::batch::table::{Batch, FILE, ShardJson};
use crate::bench::command_line;
use crate::console;
use crate::failure::{Failure, Status};
use crate::machine::Machine;
use std::collections::{BTreeMap, BTreeSet};
use std::path::{Component, Path, PathBuf};

pub(crate) fn merge(args: &BatchMergeArgs) -> Result<Status, Failure> {
    let parts: Result<Vec<(PathBuf, Batch)>, Failure> = args
        .folders
        .iter()
        .map(|folder| Ok((folder.clone(), Batch::read(folder)?)))
        .collect();
    let parts = parts?;
    if args.out.join(FILE).exists() && Batch::read(&args.out)?.merged.is_empty() {
        return Err(Failure::input(format!(
            "{}: expected a folder without the table of a batch, found one; name another with --out",
            args.out.display()
        )));
    }
    let _lock = Lock::take(&args.out)?;
    let batch = join(&parts, &args.out)?;
    result::write(&batch, &args.out)?;
    result::print(&batch, &args.out, args.json)
}

fn join(parts: &[(PathBuf, Batch)], out: &Path) -> Result<Batch, Failure> {
    let Some((first_folder, first)) = parts.first() else {
        return Err(Failure::input("expected folders of batches, found none"));
    };
    let mut rows: BTreeMap<String, (&Path, Row)> = BTreeMap::new();
    for (folder, part) in parts {
        if part.method != first.method {
            return Err(different(first_folder, first, folder, part));
        }
        for row in &part.recordings {
            let moved = Row {
                folder: relative(&folder.join(&row.folder), out),
                ..row.clone()
            };
            if let Some((other, _)) = rows.insert(row.name.clone(), (folder, moved)) {
                return Err(Failure::input(format!(
                    "expected batches of different recordings, found {} in {} and in {}; name each batch once",
                    row.name,
                    other.display(),
                    folder.display()
                )));
            }
        }
    }
    let missing = missing(parts)?;
    let ended_early = parts.iter().filter(|(_, p)| !p.is_complete);
    for (folder, _) in ended_early.clone() {
        console::line(&format!(
            "{}: ended early: run its batch again, which goes on",
            folder.display()
        ));
    }
    if !missing.is_empty() {
        let missing: Vec<String> = missing.iter().map(ToString::to_string).collect();
        console::line(&format!("shards that are missing: {}", missing.join(", ")));
    }
    Ok(Batch {
        command: command_line(),
        machine: Machine::here(),
        method: first.method.clone(),
        shard: None,
        merged: parts.iter().map(|(f, _)| f.display().to_string()).collect(),
        is_complete: missing.is_empty() && ended_early.count() == 0,
        skipped: parts.iter().map(|(_, p)| p.skipped).sum(),
        workers: parts.iter().map(|(_, p)| p.workers).max().unwrap_or(0),
        seconds: parts.iter().map(|(_, p)| p.seconds).sum(),
        recordings: rows.into_values().map(|(_, row)| row).collect(),
    })
}

/// Error: two batches differ in program or configuration.
fn different(one: &Path, first: &Batch, other: &Path, second: &Batch) -> Failure {
    let (a, b) = (&first.method, &second.method);
    let what = match a.program_sha256 == b.program_sha256 {
        true => "configuration",
        false => "program",
    };
    Failure::input(format!(
        "expected batches of one program and configuration, found another {what} in {} (Stillpoint {}) than in {} (Stillpoint {}); run one of them again with --replace",
        other.display(),
        b.stillpoint,
        one.display(),
        a.stillpoint
    ))
}

/// Shards that none of the parts covers.
fn missing(parts: &[(PathBuf, Batch)]) -> Result<Vec<u32>, Failure> {
    let shards: Vec<(&Path, ShardJson)> = parts
        .iter()
        .filter_map(|(f, p)| Some((f.as_path(), p.shard?)))
        .collect();
    let Some((first, ShardJson { of, .. })) = shards.first() else {
        return Ok(Vec::new());
    };
    if let Some((other, shard)) = shards.iter().find(|(_, s)| s.of != *of) {
        return Err(Failure::input(format!(
            "expected shards of one batch, found one of {of} in {} and one of {} in {}",
            first.display(),
            shard.of,
            other.display()
        )));
    }
    let found: BTreeSet<u32> = shards.iter().map(|(_, s)| s.index).collect();
    Ok((1..=*of).filter(|i| !found.contains(i)).collect())
}

/// A path relative to a folder; absolute where they have no common root.
fn relative(path: &Path, from: &Path) -> String {
    let full = |p: &Path| p.canonicalize().or_else(|_| std::path::absolute(p));
    let (Ok(path_full), Ok(from)) = (full(path), full(from)) else {
        return path.display().to_string();
    };
    let a: Vec<Component<'_>> = path_full.components().collect();
    let b: Vec<Component<'_>> = from.components().collect();
    let common = a.iter().zip(&b).take_while(|(x, y)| x == y).count();
    if common == 0 {
        return path_full.display().to_string();
    }
    let up = b[common..].iter().map(|_| Component::ParentDir);
    let relative: PathBuf = up.chain(a[common..].iter().copied()).collect();
    relative.display().to_string()
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;
    use crate::batch::row::Outcome;
    use crate::batch::row::tests::row;

    pub(crate) fn batch(shard: Option<(u32, u32)>, recordings: Vec<Row>) -> Batch {
        Batch {
            command: "stillpoint batch".to_owned(),
            machine: Machine::here(),
            method: row("", Outcome::Ok, None, None).method,
            shard: shard.map(|(index, of)| ShardJson { index, of }),
            merged: Vec::new(),
            is_complete: true,
            skipped: 0,
            workers: 2,
            seconds: 3.0,
            recordings,
        }
    }

    fn well(name: &str) -> Row {
        row(name, Outcome::Ok, Some(1.0), None)
    }

    #[test]
    fn shards_are_merged() {
        let dir = tempfile::tempdir().unwrap();
        let parts = [
            (dir.path().join("1"), batch(Some((1, 3)), vec![well("b")])),
            (dir.path().join("2"), batch(Some((2, 3)), vec![well("a")])),
        ];
        let all = join(&parts, &dir.path().join("all")).unwrap();
        let folders: Vec<&str> = all.recordings.iter().map(|r| r.folder.as_str()).collect();
        assert_eq!(folders, ["../2/a", "../1/b"]);
        assert!(!all.is_complete, "the third is missing");
        assert_eq!(missing(&parts).unwrap(), [3]);
        let third = (dir.path().join("3"), batch(Some((3, 3)), Vec::new()));
        let [one, two] = parts;
        assert!(join(&[one, two, third], dir.path()).unwrap().is_complete);
    }

    #[test]
    fn incompatible_batches_are_refused() {
        let of = |name: &str, batch: Batch| (PathBuf::from(name), batch);
        let refused = |parts: &[(PathBuf, Batch)], words: &[&str]| {
            let e = join(parts, Path::new("all")).unwrap_err().to_string();
            for part in words {
                assert!(e.contains(part), "{e}");
            }
        };
        let one = of("x", batch(None, vec![well("a")]));
        refused(
            &[one.clone(), of("y", batch(None, vec![well("a")]))],
            &["a in x and in y"],
        );
        let mut newer = batch(None, vec![well("b")]);
        newer.method.program_sha256 = "q".to_owned();
        newer.method.stillpoint = "1.3.0".to_owned();
        refused(
            &[one, of("y", newer)],
            &["another program in y (Stillpoint 1.3.0)", "--replace"],
        );
        refused(
            &[
                of("x", batch(Some((1, 2)), Vec::new())),
                of("y", batch(Some((2, 3)), Vec::new())),
            ],
            &["one of 2 in x and one of 3 in y"],
        );
    }
}
