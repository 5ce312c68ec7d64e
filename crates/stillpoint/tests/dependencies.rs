//! The dependency table is the law: which crate of the workspace may import which. Crates exist so that a forbidden import is
//! impossible; an edge that is not in the table fails this test and needs a decision first, and so does a permission that no
//! crate uses.

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
    // Threads and clocks, and nothing else: what is computed is the stages' business.
    (
        "live",
        &["geometry", "imaging", "map", "place", "detection", "slam"],
    ),
    // Bytes under their names, and checksums.
    ("files", &[]),
    // Opens files and loads libraries, so that the core does not.
    ("inference", &["detection", "imaging", "files"]),
    // The network, and nothing of what comes over it.
    ("fetch", &["files"]),
    // How a model is read is said beside it in the cache.
    ("models", &["detection", "inference", "fetch"]),
    // What it draws it is given as values and events; palette and typeface are those of the plots.
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
    // Frames in, findings out; from where they come is not its business.
    ("doctor", &["geometry", "imaging", "features", "estimation"]),
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
    // Bytes and what they mean, for recordings and nodes.
    ("ros-messages", &[]),
    // Events and views in, messages out; it neither writes nor sends them.
    (
        "ros-events",
        &["ros-messages", "geometry", "detection", "map", "slam"],
    ),
    // Files of messages as frames; folders go through it to the data sets.
    (
        "recordings",
        &["ros-messages", "imaging", "geometry", "datasets"],
    ),
    // A camera that runs is one more kind of input.
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
    // What every crate's tests may ask for recordings.
    ("testdata", &[]),
];

/// What tests and benchmarks may import beyond that: the simulator and the data sets as input, the judge for
/// scores, the command line for none.
const TESTS_MAY_ADD: &[(&str, &[&str])] = &[
    ("features", &["geometry", "simulator"]),
    ("place", &["simulator", "datasets", "imaging", "geometry"]),
    ("detection", &["simulator", "datasets"]),
    ("slam", &["simulator"]),
    ("live", &["simulator"]),
    ("view", &["simulator"]),
    // Rooms whose surfaces are known exactly.
    ("dense", &["simulator"]),
    ("ros-events", &["simulator", "features", "imaging"]),
    // Streams without faults, and with those that are put into them.
    ("doctor", &["simulator", "datasets"]),
    // Rooms that look alike, in terms of features.
    ("simulator", &["features"]),
];

/// Packages for other languages: folders beside `crates/`, each a workspace of its own with its own lock file. They hold the facade, and where users are to have
/// the same words there as in the command line, the command line.
pub(crate) const FRONT_ENDS: &[(&str, &[&str])] = &[
    ("python", &["stillpoint", "cli"]),
    // The laboratory, whose tests drive the command line.
    ("lab", &["stillpoint", "files", "cli"]),
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

/// What cargo prints.
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

/// Edges of `found` that are not in `table`, and permissions of `table` that `found` does not use.
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
fn every_edge_is_in_the_table_and_every_permission_is_used() {
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

/// What a manifest names and no source mentions holds a permission open for nobody.
#[test]
fn every_import_is_mentioned_in_the_source() {
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

/// Whether a Rust file in the folder or below it is as asked.
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

/// Names of all crates that the facade brings with these features.
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
fn the_facade_brings_networks_and_tls_only_where_they_are_asked_for() {
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
