//! The dependency table is the law: which crate of the workspace may import which. Crates exist so that a forbidden import is
//! impossible; an edge that is not in the table fails this test and needs a decision first.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Crate, and the crates it may import, without the prefix `stillpoint-`. `stillpoint` is the facade.
const NORMAL: &[(&str, &[&str])] = &[
    ("geometry", &[]),
    ("imaging", &["geometry"]),
    ("features", &["geometry", "imaging"]),
    ("estimation", &["geometry"]),
    ("map", &["geometry", "features"]),
    ("place", &["features"]),
    (
        "slam",
        &[
            "geometry",
            "imaging",
            "features",
            "estimation",
            "map",
            "place",
            "detection",
        ],
    ),
    ("detection", &["geometry", "imaging"]),
    // Threads and clocks, and nothing else: what is computed is the stages' business.
    (
        "live",
        &["geometry", "imaging", "map", "place", "detection", "slam"],
    ),
    // How a model is read is said beside it in the cache.
    ("models", &["detection"]),
    // A subscriber: of the system it reads events only.
    ("view", &["geometry", "imaging", "detection", "slam"]),
    ("datasets", &["geometry", "imaging"]),
    ("simulator", &["geometry", "imaging"]),
    // The judge does not know the player.
    ("evaluation", &["geometry"]),
    (
        "stillpoint",
        &[
            "geometry",
            "imaging",
            "features",
            "estimation",
            "map",
            "place",
            "detection",
            "models",
            "slam",
            "live",
            "view",
            "datasets",
            "simulator",
            "evaluation",
        ],
    ),
    ("cli", &["stillpoint"]),
    // What every crate's tests may ask for recordings.
    ("testdata", &[]),
];

/// What tests, benchmarks and examples may import beyond that: the simulator and the data sets as input, the judge for
/// scores, the command line for none.
const TESTS_MAY_ADD: &[(&str, &[&str])] = &[
    ("features", &["simulator", "datasets"]),
    ("map", &["imaging"]),
    ("place", &["simulator", "datasets", "imaging", "geometry"]),
    ("detection", &["simulator", "datasets"]),
    ("slam", &["simulator", "datasets", "evaluation"]),
    ("live", &["simulator"]),
    ("view", &["simulator"]),
    // How much the simulator's images are like real ones is measured in terms of features.
    ("simulator", &["features", "datasets"]),
];

/// What no crate of the core may import, directly or not: threads, files and judges stay outside.
const CORE: &[&str] = &[
    "geometry",
    "imaging",
    "features",
    "estimation",
    "map",
    "place",
    "detection",
    "slam",
];
const OUTSIDE: &[&str] = &[
    "live",
    "models",
    "datasets",
    "simulator",
    "evaluation",
    "view",
    "stillpoint",
    "cli",
    "testdata",
];

type Edges = BTreeSet<(String, String)>;

fn short(name: &str) -> String {
    name.strip_prefix("stillpoint-").unwrap_or(name).to_owned()
}

/// Names of all crates, normal and build edges, edges of tests.
fn workspace() -> (BTreeSet<String>, Edges, Edges) {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args([
            "metadata",
            "--no-deps",
            "--format-version",
            "1",
            "--offline",
        ])
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")))
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    let metadata: serde_json::Value = serde_json::from_slice(&output.stdout).unwrap();
    let packages = metadata["packages"].as_array().unwrap();
    let text = |v: &serde_json::Value| short(v.as_str().unwrap());
    let names: BTreeSet<String> = packages.iter().map(|p| text(&p["name"])).collect();
    let (mut normal, mut tests) = (Edges::new(), Edges::new());
    for package in packages {
        for dependency in package["dependencies"].as_array().unwrap() {
            let edge = (text(&package["name"]), text(&dependency["name"]));
            if !names.contains(&edge.1) {
                continue;
            }
            if dependency["kind"] == "dev" {
                tests.insert(edge);
            } else {
                normal.insert(edge);
            }
        }
    }
    (names, normal, tests)
}

fn allowed(table: &[(&str, &[&str])]) -> Edges {
    let edge = |from: &str, to: &&str| (from.to_owned(), (*to).to_owned());
    table
        .iter()
        .flat_map(|(from, to)| to.iter().map(move |to| edge(from, to)))
        .collect()
}

#[test]
fn every_edge_is_in_the_table() {
    let (names, normal, tests) = workspace();
    let table = allowed(NORMAL);
    let known: BTreeSet<String> = NORMAL.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(names, known, "crates of the workspace and of the table");
    let forbidden: Vec<_> = normal.difference(&table).collect();
    assert!(
        forbidden.is_empty(),
        "imports that the table does not allow (from, to): {forbidden:?}"
    );
    let table: Edges = table.union(&allowed(TESTS_MAY_ADD)).cloned().collect();
    let tests = tests.into_iter().filter(|(_, to)| to != "testdata");
    let tests: Edges = tests.collect();
    let forbidden: Vec<_> = tests.difference(&table).collect();
    assert!(
        forbidden.is_empty(),
        "imports by tests that the table does not allow (from, to): {forbidden:?}"
    );
}

#[test]
fn the_core_reaches_nothing_outside() {
    let (_, normal, _) = workspace();
    let mut next: BTreeMap<&str, Vec<&str>> = BTreeMap::new();
    for (from, to) in &normal {
        next.entry(from).or_default().push(to);
    }
    for start in CORE {
        let (mut seen, mut open) = (BTreeSet::new(), vec![*start]);
        while let Some(name) = open.pop() {
            assert!(!OUTSIDE.contains(&name), "{start} reaches {name}");
            if seen.insert(name) {
                open.extend(next.get(name).into_iter().flatten());
            }
        }
    }
}

/// A crate's `clippy.toml` replaces that of the workspace, so each core crate holds a copy of the bans.
#[test]
fn core_crates_hold_the_same_bans() {
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let read = |path: &str| {
        std::fs::read_to_string(root.join(path)).unwrap_or_else(|e| panic!("{path}: {e}"))
    };
    let first = read("crates/geometry/clippy.toml");
    for ban in [
        "std::time::Instant",
        "std::collections::HashMap",
        "f64::sin",
        "f32::mul_add",
    ] {
        assert!(first.contains(ban), "{ban} is not banned");
    }
    for line in read("clippy.toml").lines() {
        assert!(first.contains(line), "the core's clippy.toml lacks {line}");
    }
    for name in CORE {
        assert_eq!(
            read(&format!("crates/{name}/clippy.toml")),
            first,
            "crates/{name}/clippy.toml"
        );
    }
}
