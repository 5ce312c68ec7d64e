//! Expands paths, patterns and lists to recordings, each with the name of its result folder.

use crate::args::batch::{BatchArgs, Shard};
use crate::console;
use crate::failure::Failure;
use std::collections::{BTreeMap, HashSet};
use std::path::{Path, PathBuf};
use stillpoint::datasets::read_regular_text;

/// Maximum size of a list, bytes: ten million paths of 100 bytes.
const LARGEST_LIST: u64 = 1 << 30;

/// Names in a batch folder that no result may have, in lower case.
const RESERVED: [&str; 4] = [".batch.lock", "batch.json", "batch.parquet", "batch.html"];

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Item {
    /// As given by the user.
    pub(crate) path: PathBuf,
    pub(crate) name: String,
}

/// All recordings that the arguments name, sorted by name, so that every shard sees the same order.
///
/// # Errors
/// An unreadable list, a pattern without a match, two recordings with the same result folder.
pub(crate) fn find(args: &BatchArgs) -> Result<Vec<Item>, Failure> {
    let mut paths = Vec::new();
    for input in &args.inputs {
        match input.to_str().and_then(|i| i.strip_prefix('@')) {
            Some(list) if !input.exists() => read_list(list.as_ref(), &mut paths)?,
            _ => expand(input, &mut paths)?,
        }
    }
    for list in &args.list {
        read_list(list, &mut paths)?;
    }
    named(paths, args.name_parts.into())
}

/// The items of a share; without a share all of them.
pub(crate) fn share(items: Vec<Item>, shard: Option<Shard>) -> Vec<Item> {
    let Some(Shard { index, of }) = shard else {
        return items;
    };
    let mine = items
        .into_iter()
        .enumerate()
        .filter(|(i, _)| i % of as usize + 1 == index as usize);
    mine.map(|(_, item)| item).collect()
}

/// Reads a list; relative paths are relative to the working directory, as in a shell.
fn read_list(list: &Path, paths: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let wrong = |found: &dyn std::fmt::Display| {
        Failure::input(format!(
            "{}: expected a list of recordings, one a line, found {found}",
            list.display()
        ))
    };
    let text = read_regular_text(list, LARGEST_LIST).map_err(|e| wrong(&e))?;
    let before = paths.len();
    let lines = text.lines().map(str::trim);
    for line in lines.filter(|l| !l.is_empty() && !l.starts_with('#')) {
        expand(line.as_ref(), paths).map_err(|e| e.at(&list.display().to_string()))?;
    }
    if paths.len() == before {
        return Err(wrong(&"none"));
    }
    Ok(())
}

/// Expands a pattern. An existing path is taken literally, even if it looks like a pattern.
fn expand(input: &Path, paths: &mut Vec<PathBuf>) -> Result<(), Failure> {
    let pattern = input
        .to_str()
        .filter(|t| t.contains(['*', '?', '[']) && !input.exists());
    let Some(pattern) = pattern else {
        paths.push(input.to_owned());
        return Ok(());
    };
    let wrong = |found: &dyn std::fmt::Display| {
        Failure::input(format!(
            "{pattern}: expected a pattern that matches recordings, found {found}; check the path"
        ))
    };
    let before = paths.len();
    for found in glob::glob(pattern).map_err(|e| wrong(&e))? {
        paths.push(found.map_err(|e| wrong(&e))?);
    }
    if paths.len() == before {
        return Err(wrong(&"none that does"));
    }
    Ok(())
}

fn named(paths: Vec<PathBuf>, parts: usize) -> Result<Vec<Item>, Failure> {
    let mut seen = HashSet::new();
    let mut twice = 0;
    // File systems of Windows and macOS ignore case.
    let mut items: BTreeMap<String, Item> = BTreeMap::new();
    for path in paths {
        let full = path.canonicalize().unwrap_or_else(|_| path.clone());
        if !seen.insert(full.clone()) {
            twice += 1;
            continue;
        }
        let name = name_of(&path, &full, parts);
        if RESERVED.contains(&name.to_lowercase().as_str()) {
            return Err(Failure::input(format!(
                "{}: expected a recording whose result folder can be named after it, found one named as a file of the batch; --name-parts 2 names it by its folder, too",
                path.display()
            )));
        }
        if let Some(other) = items.get(&name.to_lowercase()) {
            return Err(Failure::input(format!(
                "expected recordings whose result folders have different names, found {} and {}, both {name}; --name-parts {} names them by their folders, too",
                other.path.display(),
                path.display(),
                parts + 1
            )));
        }
        items.insert(name.to_lowercase(), Item { path, name });
    }
    if twice > 0 {
        let n = console::counted(twice, "input");
        console::info(&format!("{n} left out: named before"));
    }
    Ok(items.into_values().collect())
}

/// The last parts of a path, without the file extension.
fn name_of(path: &Path, full: &Path, parts: usize) -> String {
    let is_file = full.is_file();
    let mut names: Vec<String> = full
        .components()
        .rev()
        .filter_map(|c| match c {
            std::path::Component::Normal(name) => Some(name.to_string_lossy().into_owned()),
            _ => None,
        })
        .take(parts)
        .collect();
    // A link keeps its own name.
    if let (Some(last), Some(name)) = (names.first_mut(), path.file_name()) {
        *last = name.to_string_lossy().into_owned();
    }
    if let Some(last) = names.first_mut().filter(|_| is_file)
        && let Some(stem) = Path::new(last.as_str()).file_stem()
    {
        *last = stem.to_string_lossy().into_owned();
    }
    names.reverse();
    if names.is_empty() {
        return "run".to_owned();
    }
    names.join("_")
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(paths: &[&str], parts: usize) -> Result<Vec<String>, String> {
        let items = named(paths.iter().map(PathBuf::from).collect(), parts);
        let items = items.map_err(|e| e.to_string())?;
        Ok(items.into_iter().map(|i| i.name).collect())
    }

    #[test]
    fn result_names_derive_from_paths_and_are_unique() {
        assert_eq!(
            names(&["/r/b", "/r/a.bag/", "/r/b"], 1).unwrap(),
            ["a.bag", "b"]
        );
        let e = names(&["/r/1/walk", "/r/2/walk"], 1).unwrap_err();
        for part in ["/r/1/walk and /r/2/walk", "--name-parts 2"] {
            assert!(e.contains(part), "{e}");
        }
        assert_eq!(
            names(&["/r/1/walk", "/r/2/walk"], 2).unwrap(),
            ["1_walk", "2_walk"]
        );
        assert!(names(&["/r/Walk", "/s/walk"], 1).is_err());
        let e = names(&["/r/batch.json"], 1).unwrap_err();
        assert!(e.contains("a file of the batch"), "{e}");
    }

    #[test]
    fn file_extensions_are_dropped_from_names() {
        let dir = tempfile::tempdir().unwrap();
        let file = dir.path().join("walk.mcap");
        std::fs::write(&file, "").unwrap();
        let items = named(vec![file], 1).unwrap();
        assert_eq!(items[0].name, "walk");
    }

    #[test]
    fn shards_are_disjoint_and_complete() {
        let items: Vec<Item> = (0..10)
            .map(|i| Item {
                path: i.to_string().into(),
                name: i.to_string(),
            })
            .collect();
        let mut all = Vec::new();
        for index in 1..=3 {
            all.extend(share(items.clone(), Some(Shard { index, of: 3 })));
        }
        all.sort_by(|a, b| a.name.cmp(&b.name));
        assert_eq!(all, items);
        assert_eq!(share(items.clone(), None), items);
    }
}
