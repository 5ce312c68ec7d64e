//! Requirements of registries and releases: crate metadata, included files, and names shared by two files.

use std::collections::BTreeSet;
use std::fs;
use std::path::{Path, PathBuf};
use std::process::Command;

/// Categories in use, as spelled by crates.io, which rejects others.
const CATEGORIES: &[&str] = &[
    "algorithms",
    "command-line-utilities",
    "computer-vision",
    "concurrency",
    "data-structures",
    "encoding",
    "filesystem",
    "hardware-support",
    "mathematics",
    "multimedia::images",
    "parser-implementations",
    "science::robotics",
    "simulation",
    "visualization",
];

fn root() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("../..")
}

fn read(path: &Path) -> String {
    fs::read_to_string(path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// All published packages of the workspace, as described by cargo.
fn published() -> Vec<serde_json::Value> {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args([
            "metadata",
            "--no-deps",
            "--format-version",
            "1",
            "--offline",
        ])
        .current_dir(root())
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    // `publish = false` is an empty list of registries.
    let published = |p: &&serde_json::Value| p["publish"].is_null();
    packages.iter().filter(published).cloned().collect()
}

fn folder(package: &serde_json::Value) -> PathBuf {
    let manifest = Path::new(package["manifest_path"].as_str().unwrap());
    manifest.parent().unwrap().to_owned()
}

fn strings(list: &serde_json::Value) -> Vec<&str> {
    let list = list.as_array().unwrap().iter();
    list.map(|s| s.as_str().unwrap()).collect()
}

#[test]
fn crates_have_registry_metadata() {
    let packages = published();
    assert!(packages.len() > 20, "{} packages", packages.len());
    for package in &packages {
        let name = package["name"].as_str().unwrap();
        for field in ["description", "license", "repository", "rust_version"] {
            let text = package[field].as_str().unwrap_or_default();
            assert!(!text.is_empty(), "{name} has no {field}");
        }
        let keywords = strings(&package["keywords"]);
        assert!((1..=5).contains(&keywords.len()), "{name}: {keywords:?}");
        for keyword in keywords {
            let allowed = |c: char| c.is_ascii_alphanumeric() || "_-+".contains(c);
            let begins = keyword.starts_with(|c: char| c.is_ascii_alphanumeric());
            assert!(
                begins && keyword.len() <= 20 && keyword.chars().all(allowed),
                "{name}: keyword {keyword}"
            );
        }
        let categories = strings(&package["categories"]);
        assert!(
            (1..=5).contains(&categories.len()),
            "{name}: {categories:?}"
        );
        for category in categories {
            assert!(CATEGORIES.contains(&category), "{name}: {category}");
        }
    }
}

#[test]
fn crates_have_readme_and_licences() {
    for package in published() {
        let name = package["name"].as_str().unwrap();
        let folder = folder(&package);
        assert_eq!(package["readme"], "README.md", "{name}");
        let readme = read(&folder.join("README.md"));
        assert!(
            readme.starts_with(&format!("# {name}\n\n")) && readme.lines().count() < 40,
            "{name}: expected a short README.md that begins with the crate's name"
        );
        // Links out of the crate are broken on the registry's page.
        assert!(!readme.contains("](../"), "{name}: README.md");
        for licence in ["LICENSE-MIT", "LICENSE-APACHE"] {
            // Symbolic links to one text; checkouts without symbolic links contain the path instead.
            let (here, there) = (read(&folder.join(licence)), read(&root().join(licence)));
            assert!(
                here == there || here.trim() == format!("../../{licence}"),
                "{name}: {licence} is not that of the workspace"
            );
        }
    }
}

/// A published crate contains only files of its own folder.
#[test]
fn sources_include_only_files_of_their_crate() {
    let mut included = 0;
    for package in published() {
        let folder = folder(&package);
        let mut open = vec![folder.join("src")];
        while let Some(path) = open.pop() {
            if path.is_dir() {
                open.extend(fs::read_dir(&path).unwrap().map(|e| e.unwrap().path()));
                continue;
            }
            let text = read(&path);
            for part in text.split("include_").skip(1) {
                let quoted = part.split_once("!(").filter(|(kind, _)| kind.len() <= 5);
                let Some(file) = quoted.and_then(|(_, rest)| rest.split('"').nth(1)) else {
                    continue;
                };
                let file = path.parent().unwrap().join(file);
                let file = file
                    .canonicalize()
                    .unwrap_or_else(|e| panic!("{}: {}: {e}", path.display(), file.display()));
                assert!(
                    file.starts_with(folder.canonicalize().unwrap()),
                    "{}: {} lies outside of its crate",
                    path.display(),
                    file.display()
                );
                included += 1;
            }
        }
    }
    assert!(included > 20, "{included} includes");
}

/// Crates are published in the order of dependencies. Tests depend on later crates: a versioned dependency would be
/// required by the registry, a path alone is omitted when publishing.
#[test]
fn crates_can_be_published_in_dependency_order() {
    let packages = published();
    let own: BTreeSet<&str> = packages
        .iter()
        .map(|p| p["name"].as_str().unwrap())
        .collect();
    let mut needs: Vec<(&str, BTreeSet<&str>)> = Vec::new();
    for package in &packages {
        let (name, version) = (package["name"].as_str().unwrap(), &package["version"]);
        let mut asked = BTreeSet::new();
        for dependency in package["dependencies"].as_array().unwrap() {
            let other = dependency["name"].as_str().unwrap();
            let required = dependency["req"].as_str().unwrap();
            if required == "*" {
                let only_tests = dependency["kind"] == "dev";
                assert!(only_tests, "{name} needs {other} without a version");
            } else if own.contains(other) {
                let expected = format!("^{}", version.as_str().unwrap());
                assert_eq!(required, expected, "{name} needs {other}");
                asked.insert(other);
            }
        }
        needs.push((name, asked));
    }
    let mut there = BTreeSet::new();
    while there.len() < needs.len() {
        let next = needs.iter().find(|(name, asked)| {
            !there.contains(name) && asked.iter().all(|other| there.contains(other))
        });
        let left: Vec<_> = needs.iter().filter(|(n, _)| !there.contains(n)).collect();
        let (name, _) = next.unwrap_or_else(|| panic!("these need each other: {left:?}"));
        there.insert(*name);
    }
}

#[test]
fn release_archives_match_the_installer_metadata() {
    let packages = published();
    let cli = packages.iter().find(|p| p["name"] == "stillpoint-cli");
    let installer = &cli.unwrap()["metadata"]["binstall"];
    let script = read(&root().join("tools/package"));
    assert!(script.contains("name=\"stillpoint-v$version-$target\""));
    let archive = "/releases/download/v{ version }/stillpoint-v{ version }-{ target }";
    let url = installer["pkg-url"].as_str().unwrap();
    assert_eq!(url, format!("{{ repo }}{archive}.tar.gz"));
    let windows = &installer["overrides"]["x86_64-pc-windows-msvc"]["pkg-url"];
    assert_eq!(*windows, format!("{{ repo }}{archive}.zip"));
    assert_eq!(
        installer["bin-dir"],
        "stillpoint-v{ version }-{ target }/{ bin }{ binary-ext }"
    );
    let workflow = read(&root().join(".github/workflows/release.yml"));
    for target in [
        "x86_64-unknown-linux-gnu",
        "aarch64-unknown-linux-gnu",
        "x86_64-apple-darwin",
        "aarch64-apple-darwin",
        "x86_64-pc-windows-msvc",
    ] {
        assert!(
            workflow.contains(&format!("target: {target}\n")),
            "{target}"
        );
    }
}

/// Archives, packages and the image contain the same documents, and those named by a package exist.
#[test]
fn every_package_contains_its_notices() {
    let packages = published();
    let cli = packages.iter().find(|p| p["name"] == "stillpoint-cli");
    let deb = &cli.unwrap()["metadata"]["deb"];
    let assets: Vec<Vec<&str>> = deb["assets"]
        .as_array()
        .unwrap()
        .iter()
        .map(strings)
        .collect();
    let folder = root().join("crates/cli");
    for asset in &assets {
        // Files written by `tools/package` do not exist in a checkout.
        let written = asset[0].starts_with("target/") || asset[0].starts_with("../../target/");
        assert!(written || folder.join(asset[0]).is_file(), "{asset:?}");
    }
    let (script, image) = (
        read(&root().join("tools/package")),
        read(&root().join("Dockerfile")),
    );
    for name in ["LICENSE-MIT", "LICENSE-APACHE", "NOTICES.md"] {
        let source = format!("../../{name}");
        let packed = assets
            .iter()
            .any(|a| a[0] == source && a[1] == "usr/share/doc/stillpoint/");
        assert!(
            packed && script.contains(name) && image.contains(name),
            "{name}"
        );
    }
    for place in [
        "usr/bin/",
        "usr/share/man/man1/",
        "usr/share/bash-completion/completions/stillpoint",
    ] {
        assert!(assets.iter().any(|a| a[1] == place), "{place}");
    }
}

/// Mutable names are unsafe for releases: actions are pinned by commit, and the image is built by the oldest supported
/// compiler.
#[test]
fn release_tools_are_pinned() {
    let mut actions = 0;
    for file in ["ci.yml", "nightly.yml", "release.yml"] {
        let workflow = read(&root().join(".github/workflows").join(file));
        for action in workflow.lines().filter_map(|l| l.split("uses: ").nth(1)) {
            let commit = action.split(['@', ' ']).nth(1).unwrap_or_default();
            let is_commit = commit.len() == 40 && commit.chars().all(|c| c.is_ascii_hexdigit());
            assert!(is_commit, "{file}: {action}");
            actions += 1;
        }
    }
    assert!(actions > 10, "{actions} actions");
    let (image, manifest) = (
        read(&root().join("Dockerfile")),
        read(&root().join("Cargo.toml")),
    );
    let version = manifest.split("rust-version = \"").nth(1).unwrap();
    let version = version.split('"').next().unwrap();
    assert!(image.contains(&format!("\nFROM rust:{version}-slim-bookworm")));
    assert!(image.contains("\nUSER 65532:65532\n"));
    let workflow = read(&root().join(".github/workflows/release.yml"));
    assert!(workflow.contains("run: tools/images --check\n"));
}

/// Panics in networks are converted to errors, which requires unwinding.
#[test]
fn panics_unwind_in_every_profile() {
    let manifest = read(&root().join("Cargo.toml"));
    assert!(manifest.contains("\n[profile.dist]\n"));
    assert!(
        !manifest.contains("panic ="),
        "a profile changes what panics do"
    );
}
