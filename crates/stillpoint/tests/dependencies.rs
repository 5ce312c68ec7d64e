//! Allowed imports between the crates of the workspace. An edge that is not in the table, or an unused permission,
//! fails this test and needs a decision.

use std::collections::{BTreeMap, BTreeSet};
use std::path::Path;
use std::process::Command;

/// Crate, and the crates it may import, without the prefix `stillpoint-`. `stillpoint` is the facade.
const NORMAL: &[(&str, &[&str])] = &[
    ("geometry", &[]),
    ("imaging", &[]),
    ("features", &["imaging"]),
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
    // Threads and clocks only: computations are in the stages.
    (
        "live",
        &["geometry", "imaging", "map", "place", "detection", "slam"],
    ),
    ("files", &[]),
    // Opens files and loads libraries, to keep both out of the core.
    ("inference", &["detection", "imaging", "files"]),
    // Network access without interpreting the content.
    ("fetch", &["files"]),
    // The cache describes how a model is read.
    ("models", &["detection", "inference", "fetch"]),
    // Draws values and events it is given, with the palette and typeface of the plots.
    (
        "view",
        &[
            "geometry",
            "imaging",
            "detection",
            "map",
            "slam",
            "evaluation",
        ],
    ),
    // A subscriber that fuses: events and views in, surfaces out.
    (
        "dense",
        &["detection", "geometry", "imaging", "map", "slam"],
    ),
    ("datasets", &["geometry", "imaging", "files"]),
    ("simulator", &["geometry", "imaging"]),
    // Frames in, findings out, independent of their source.
    ("doctor", &["geometry", "imaging", "features", "estimation"]),
    // Evaluation is independent of the system.
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
            "inference",
            "fetch",
            "models",
            "slam",
            "live",
            "view",
            "dense",
            "datasets",
            "recordings",
            "realsense",
            "ros-messages",
            "ros-events",
            "simulator",
            "doctor",
            "evaluation",
        ],
    ),
    ("ros-messages", &[]),
    // Events and views in, messages out; neither writes nor sends them.
    (
        "ros-events",
        &["ros-messages", "geometry", "detection", "map", "slam"],
    ),
    // Files of messages as frames; folders are opened through data sets.
    (
        "recordings",
        &["ros-messages", "imaging", "geometry", "datasets"],
    ),
    (
        "realsense",
        &[
            "recordings",
            "ros-messages",
            "imaging",
            "geometry",
            "datasets",
        ],
    ),
    ("cli", &["stillpoint"]),
    // Finds recordings for the tests of every crate.
    ("testdata", &[]),
];

/// Additional imports of tests and benchmarks: simulator and data sets as input, evaluation for scores.
const TESTS_MAY_ADD: &[(&str, &[&str])] = &[
    ("features", &["geometry", "simulator"]),
    ("place", &["simulator", "datasets", "imaging", "geometry"]),
    ("detection", &["simulator", "datasets"]),
    ("slam", &["simulator"]),
    ("live", &["simulator"]),
    ("view", &["simulator"]),
    // Rooms with exact surfaces.
    ("dense", &["simulator"]),
    ("ros-events", &["simulator", "features", "imaging"]),
    // Streams with and without faults.
    ("doctor", &["simulator", "datasets"]),
    // Similarity of rooms in terms of features.
    ("simulator", &["features"]),
];

/// Packages for other languages: folders beside `crates/`, each a workspace with its own lock file. They use the
/// facade, and the command line where both share the same terms.
pub(crate) const FRONT_ENDS: &[(&str, &[&str])] = &[
    ("python", &["stillpoint", "cli"]),
    // The laboratory, whose tests run the command line.
    ("lab", &["stillpoint", "files", "cli"]),
];

/// Crates without direct or indirect access to threads, files and evaluation.
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
    "files",
    "inference",
    "fetch",
    "models",
    "datasets",
    "recordings",
    "realsense",
    "ros-messages",
    "ros-events",
    "simulator",
    "doctor",
    "evaluation",
    "view",
    "dense",
    "stillpoint",
    "cli",
    "testdata",
];

pub(crate) type Edges = BTreeSet<(String, String)>;

pub(crate) fn short(name: &str) -> String {
    name.strip_prefix("stillpoint-").unwrap_or(name).to_owned()
}

pub(crate) fn cargo(arguments: &[&str]) -> String {
    let cargo = std::env::var_os("CARGO").unwrap_or_else(|| "cargo".into());
    let output = Command::new(cargo)
        .args(arguments)
        .current_dir(Path::new(env!("CARGO_MANIFEST_DIR")))
        .output()
        .unwrap();
    assert!(
        output.status.success(),
        "{}",
        String::from_utf8_lossy(&output.stderr)
    );
    String::from_utf8(output.stdout).unwrap()
}

/// Names of all crates, normal and build edges, edges of tests.
pub(crate) fn workspace() -> (BTreeSet<String>, Edges, Edges) {
    let text = cargo(&[
        "metadata",
        "--no-deps",
        "--format-version",
        "1",
        "--offline",
    ]);
    let metadata: serde_json::Value = serde_json::from_str(&text).unwrap();
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

/// Edges of `found` missing in `table`, and permissions of `table` unused in `found`.
fn compare(what: &str, found: &Edges, table: &Edges) {
    let forbidden: Vec<_> = found.difference(table).collect();
    assert!(
        forbidden.is_empty(),
        "{what} that the table does not allow (from, to): {forbidden:?}"
    );
    let unused: Vec<_> = table.difference(found).collect();
    assert!(
        unused.is_empty(),
        "{what} that the table allows and no crate has (from, to): {unused:?}; take them out of the table"
    );
}

#[test]
fn crate_dependencies_match_the_allowed_table() {
    let (names, normal, tests) = workspace();
    let known: BTreeSet<String> = NORMAL.iter().map(|(name, _)| (*name).to_owned()).collect();
    assert_eq!(names, known, "crates of the workspace and of the table");
    let (table, tests_table) = (allowed(NORMAL), allowed(TESTS_MAY_ADD));
    compare("imports", &normal, &table);
    let added = tests.difference(&table).filter(|(_, to)| to != "testdata");
    let added: Edges = added.cloned().collect();
    compare("imports by tests", &added, &tests_table);
    let twice: Vec<_> = tests_table.intersection(&table).collect();
    assert!(
        twice.is_empty(),
        "imports that tests may add and the crate has anyway (from, to): {twice:?}"
    );
}

/// A manifest entry without use in the source keeps a permission open.
#[test]
fn every_dependency_is_used_in_the_source() {
    let (_, normal, tests) = workspace();
    let root = Path::new(env!("CARGO_MANIFEST_DIR")).join("../..");
    let mentioned = |(from, to): &(String, String), folders: &[&str]| {
        let library = match to.as_str() {
            "stillpoint" => "stillpoint::".to_owned(),
            to => format!("stillpoint_{}", to.replace('-', "_")),
        };
        let folders = folders.iter();
        folders
            .map(|folder| root.join("crates").join(from).join(folder))
            .any(|folder| any_source(&folder, &|text| text.contains(&library)))
    };
    let everywhere = ["src", "tests", "benches"];
    let normal_only = normal.iter().filter(|edge| !mentioned(edge, &["src"]));
    let of_tests = tests.difference(&normal);
    let of_tests = of_tests.filter(|edge| !mentioned(edge, &everywhere));
    let idle: Vec<_> = normal_only.chain(of_tests).collect();
    assert!(
        idle.is_empty(),
        "imports that no source mentions (from, to): {idle:?}; take them out of Cargo.toml"
    );
}

/// Whether any Rust file in the folder or below it satisfies the predicate.
fn any_source(folder: &Path, asked: &dyn Fn(&str) -> bool) -> bool {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    entries.map(|entry| entry.unwrap().path()).any(|path| {
        if path.is_dir() {
            return any_source(&path, asked);
        }
        let rust = path.extension().is_some_and(|e| e == "rs");
        rust && asked(&std::fs::read_to_string(&path).unwrap())
    })
}

/// Names of all crates included by the facade with these features.
fn brought_by_the_facade(features: &str) -> BTreeSet<String> {
    let text = cargo(&[
        "tree",
        "--package",
        "stillpoint",
        "--features",
        features,
        "--edges",
        "normal",
        "--prefix",
        "none",
        "--offline",
    ]);
    let name = |line: &str| line.split(' ').next().unwrap_or_default().to_owned();
    text.lines().map(name).collect()
}

#[test]
fn facade_pulls_heavy_dependencies_only_by_feature() {
    let heavy = [
        ("inference", "rten"),
        ("onnxruntime", "ort"),
        ("models", "stillpoint-models"),
        ("pull", "ureq"),
        ("pull", "rustls"),
        ("sqlite", "rusqlite"),
    ];
    let plain = brought_by_the_facade("");
    assert!(plain.contains("stillpoint-slam"), "{plain:?}");
    for (feature, name) in heavy {
        assert!(!plain.contains(name), "{name} without features: {plain:?}");
        assert!(
            brought_by_the_facade(feature).contains(name),
            "{name} with {feature}"
        );
    }
    let pull = brought_by_the_facade("pull");
    for name in ["ring", "aws-lc-sys", "openssl-sys", "cc"] {
        assert!(!pull.contains(name), "{name} is not pure Rust: {pull:?}");
    }
    let models = brought_by_the_facade("onnxruntime,models");
    assert!(
        !models.contains("ureq") && !models.contains("rustls"),
        "TLS without `pull`: {models:?}"
    );
}

#[test]
fn core_crates_do_not_reach_outer_crates() {
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

/// A crate's `clippy.toml` replaces that of the workspace, so each core crate has a copy of the bans.
#[test]
fn core_crates_share_the_same_clippy_bans() {
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
