//! Packages for other languages, beside the workspace: their imports, and whether their lock files are up to date. They
//! are neither compiled nor locked here.

use crate::dependencies::{FRONT_ENDS, cargo, short, workspace};
use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;

/// A package of a lock file: its versions and the names of its dependencies.
type Locked = BTreeMap<String, (BTreeSet<String>, BTreeSet<String>)>;

/// The packages of a lock file by name, merging versions.
fn locked(folder: &Path) -> Locked {
    let text = std::fs::read_to_string(folder.join("Cargo.lock")).unwrap();
    let mut packages = Locked::new();
    for package in text.split("[[package]]").skip(1) {
        let field = |key: &str| {
            let line = package.lines().find_map(|l| l.strip_prefix(key));
            line.unwrap_or_default().trim_matches('"').to_owned()
        };
        let entry = packages.entry(field("name = ")).or_default();
        entry.0.insert(field("version = "));
        let needs = package.lines().filter_map(|l| l.strip_prefix(" \""));
        let name = |l: &str| l.split(['"', ' ']).next().unwrap_or_default().to_owned();
        entry.1.extend(needs.map(name));
    }
    packages
}

fn described(manifest: &Path) -> Vec<serde_json::Value> {
    let text = cargo(&[
        "metadata",
        "--no-deps",
        "--format-version",
        "1",
        "--offline",
        "--manifest-path",
        manifest.to_str().unwrap(),
    ]);
    let metadata: serde_json::Value = serde_json::from_str(&text).unwrap();
    metadata["packages"].as_array().unwrap().clone()
}

#[test]
fn front_ends_are_separate_workspaces_on_the_facade() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (names, ..) = workspace();
    for (folder, allowed) in FRONT_ENDS {
        let packages = described(&root.join(folder).join("Cargo.toml"));
        let inside = |p: &serde_json::Value| names.contains(&short(p["name"].as_str().unwrap()));
        assert!(!packages.iter().any(inside), "{folder} is in the workspace");
        let needs = |p: &serde_json::Value| p["dependencies"].as_array().unwrap().clone();
        let imports: BTreeSet<String> = packages
            .iter()
            .flat_map(needs)
            .map(|d| short(d["name"].as_str().unwrap()))
            .filter(|name| names.contains(name))
            .collect();
        let allowed: BTreeSet<String> = allowed.iter().map(|s| (*s).to_owned()).collect();
        assert_eq!(imports, allowed, "what {folder} imports, and what it may");
    }
}

/// A front end must be released and tested with the versions of the workspace. As it is not compiled here, only this
/// test detects a mismatch.
#[test]
fn front_end_lock_files_match_the_workspace() {
    const AGAIN: &str = "see \"The Python package\" in CONTRIBUTING.md";
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let (ours, crates) = (locked(&root), described(&root.join("Cargo.toml")));
    for (folder, _) in FRONT_ENDS {
        let theirs = locked(&root.join(folder));
        assert!(theirs.len() > 50, "{folder}: {} packages", theirs.len());
        for (name, (versions, _)) in &theirs {
            let own = ours.get(name).map_or(versions, |own| &own.0);
            assert!(
                !versions.is_disjoint(own),
                "{folder}/Cargo.lock has {name} {versions:?}, Cargo.lock {own:?}: {AGAIN}"
            );
        }
        for package in &crates {
            let name = package["name"].as_str().unwrap();
            let Some((_, found)) = theirs.get(name) else {
                continue;
            };
            for need in package["dependencies"].as_array().unwrap() {
                let always = need["kind"] != "dev" && need["optional"] == false;
                let what = need["name"].as_str().unwrap();
                assert!(
                    !always || found.contains(what),
                    "{folder}/Cargo.lock does not know that {name} needs {what}: {AGAIN}"
                );
            }
        }
    }
}
