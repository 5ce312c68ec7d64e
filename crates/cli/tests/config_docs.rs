//! Compares `src/config/docs.txt` with the doc comments of the configuration structs. After a change of those, renew it by
//! `STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --test all config_docs`, then the files of the test `golden`, which contain the same
//! text.

use std::collections::BTreeMap;
use std::path::{Path, PathBuf};

type Fields = Vec<(String, String, String)>;

fn rust_files(folder: &Path, files: &mut Vec<PathBuf>) {
    let mut entries: Vec<PathBuf> = std::fs::read_dir(folder)
        .unwrap()
        .map(|e| e.unwrap().path())
        .collect();
    entries.sort();
    for path in entries {
        if path.is_dir() {
            rust_files(&path, files);
        } else if path.extension().is_some_and(|e| e == "rs") {
            files.push(path);
        }
    }
}

/// The public structs of a source file with their public fields.
fn structs(source: &str, all: &mut BTreeMap<String, Fields>) {
    let (mut name, mut doc) = (None::<String>, String::new());
    for line in source.lines().map(str::trim) {
        if let Some(rest) = line.strip_prefix("pub struct ") {
            name = rest.strip_suffix(" {").map(str::to_owned);
            doc.clear();
        } else if line == "}" {
            name = None;
        } else if let Some(text) = line.strip_prefix("///") {
            doc.push_str(text);
        } else if let Some((field, kind)) =
            line.strip_prefix("pub ").and_then(|l| l.split_once(": "))
        {
            if let Some(name) = &name {
                let doc = doc.split_whitespace().collect::<Vec<_>>().join(" ");
                let kind = kind.trim_end_matches(',').to_owned();
                let fields = all.entry(name.clone()).or_default();
                fields.push((field.to_owned(), kind, doc));
            }
            doc.clear();
        } else if !line.starts_with("#[") {
            doc.clear();
        }
    }
}

fn describe(all: &BTreeMap<String, Fields>, name: &str, prefix: &str, text: &mut String) {
    for (field, kind, doc) in &all[name] {
        assert!(!doc.is_empty(), "{name}.{field} has no documentation");
        *text += &format!("{prefix}{field}\t{doc}\n");
        if all.contains_key(kind) {
            describe(all, kind, &format!("{prefix}{field}."), text);
        }
    }
}

#[test]
fn settings_documentation_matches_the_source() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let mut files = Vec::new();
    for folder in ["slam", "features", "detection"] {
        rust_files(&here.join("..").join(folder).join("src"), &mut files);
    }
    let mut all = BTreeMap::new();
    for file in files {
        structs(&std::fs::read_to_string(file).unwrap(), &mut all);
    }
    let mut expected = String::new();
    describe(&all, "Config", "", &mut expected);
    let path = here.join("src/config/docs.txt");
    if std::env::var_os("STILLPOINT_BLESS").is_some() {
        std::fs::write(&path, &expected).unwrap();
    }
    let found = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(
        found, expected,
        "renew it: STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --test all config_docs"
    );
}
