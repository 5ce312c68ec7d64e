//! Layout of tests: one binary per crate, because each is linked with all dependencies of its crate, and binaries run
//! sequentially while the tests of one binary share the cores.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};

/// The folders of crates with a folder `tests`.
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

/// The modules in a folder: files, and folders with a `mod.rs`.
fn offered(folder: &Path) -> BTreeSet<String> {
    let entries = fs::read_dir(folder).unwrap().map(|e| e.unwrap().path());
    entries
        .filter(|path| path.join("mod.rs").is_file() || path.extension() == Some("rs".as_ref()))
        .map(|path| path.file_stem().unwrap().to_str().unwrap().to_owned())
        .filter(|name| name != "main" && name != "mod")
        .collect()
}

/// The modules declared in a file, under any condition.
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

/// Test discovery is disabled here, so a file that no module declares would never be built.
#[test]
fn every_test_file_is_declared_as_a_module() {
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

/// Whether a source has a documentation example that doc tests would compile.
fn has_example(text: &str) -> bool {
    let mut inside = false;
    let mut found = false;
    for line in text.lines().map(str::trim_start) {
        let doc = line.strip_prefix("//!").or(line.strip_prefix("///"));
        if let Some(language) = doc.and_then(|d| d.trim_start().strip_prefix("```")) {
            let rust = language.split(',').all(|word| {
                let word = word.trim();
                matches!(
                    word,
                    "" | "rust" | "no_run" | "should_panic" | "compile_fail"
                )
            });
            found |= rust && !inside;
            inside = !inside;
        }
    }
    found
}

/// Searching for examples takes seconds per crate: crates without any disable doc tests, and must enable them with
/// their first example.
#[test]
fn doc_tests_are_enabled_where_examples_exist() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("..");
    let mut looked_through = 0;
    for entry in fs::read_dir(root).unwrap() {
        let krate = entry.unwrap().path();
        let (mut open, mut examples) = (vec![krate.join("src")], false);
        if !krate.join("src/lib.rs").is_file() {
            continue;
        }
        while let Some(path) = open.pop() {
            if path.is_dir() {
                open.extend(fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
            } else if path.extension() == Some("rs".as_ref()) {
                examples |= has_example(&fs::read_to_string(&path).unwrap());
            }
        }
        let manifest = fs::read_to_string(krate.join("Cargo.toml")).unwrap();
        let off = manifest.contains("\n[lib]\ndoctest = false\n");
        assert_eq!(
            off,
            !examples,
            "{}: `[lib] doctest = false` (left) goes with documentation that has no examples (right)",
            krate.display()
        );
        looked_through += usize::from(!off);
    }
    assert!(looked_through > 4, "{looked_through} crates");
}

#[test]
fn doc_examples_are_distinguished_from_other_text() {
    assert!(has_example("/// ```\n/// let x = 1;\n/// ```\n"));
    assert!(has_example("    //! ```no_run\n"));
    assert!(!has_example(
        "/// ```text\n/// a\n/// ```\nlet s = \"```\";\n"
    ));
    assert!(!has_example("/// ```toml\n/// a = 1\n/// ```\n"));
}
