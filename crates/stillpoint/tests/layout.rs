//! How tests lie in the workspace: one binary per crate, because every binary is linked with all that its crate uses, and because
//! binaries run one after the other while the tests of one binary share the cores.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The folders of the workspace's crates that have a folder `tests`.
fn crates() -> Vec<PathBuf> {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut crates: Vec<PathBuf> = fs::read_dir(root)
        .unwrap()
        .map(|entry| entry.unwrap().path())
        .filter(|path| path.join("tests").is_dir())
        .collect();
    crates.sort();
    crates
}

/// The modules that a folder offers: its files, and its folders with a `mod.rs`.
fn offered(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries
        .filter(|path| path.join("mod.rs").is_file() || path.extension() == Some("rs".as_ref()))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .filter(|name| name != "main" && name != "mod")
        .collect()
}

/// The modules that a file declares, whatever they are conditional on.
fn declared(file: &Path) -> BTreeSet<String> {
    let text = fs::read_to_string(file).unwrap();
    text.lines()
        .filter_map(|line| {
            let line = line.trim_start_matches("pub ");
            line.strip_prefix("mod ")?.strip_suffix(';')
        })
        .map(str::to_owned)
        .collect()
}

#[test]
fn every_crate_has_one_test_binary() {
    let crates = crates();
    assert!(crates.len() > 10, "{crates:?}");
    for krate in crates {
        let manifest = krate.join("Cargo.toml");
        let text = fs::read_to_string(&manifest).unwrap();
        let tests = text.lines().filter(|line| line.trim() == "[[test]]");
        assert!(
            text.contains("\nautotests = false\n") && tests.count() == 1,
            "{}: expected `autotests = false` and one `[[test]]` with the path tests/main.rs",
            manifest.display()
        );
    }
}

/// Cargo does not look for tests by itself here, so a file that no module declares would never be built.
#[test]
fn every_file_of_tests_is_built() {
    for krate in crates() {
        let tests = krate.join("tests");
        let mut folders = vec![(tests.clone(), tests.join("main.rs"))];
        while let Some((folder, file)) = folders.pop() {
            let offered = offered(&folder);
            assert_eq!(
                offered,
                declared(&file),
                "the modules in {} (left) and those that {} declares (right)",
                folder.display(),
                file.display()
            );
            for name in offered {
                let inner = folder.join(name);
                if inner.join("mod.rs").is_file() {
                    folders.push((inner.clone(), inner.join("mod.rs")));
                }
            }
        }
    }
}
