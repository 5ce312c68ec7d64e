//! Module imports inside `slam` must be acyclic. The test parses the sources, since no tool lists imports between
//! modules.

use std::collections::{BTreeMap, BTreeSet};
use std::path::{Path, PathBuf};

type Edges = BTreeMap<String, BTreeSet<String>>;

fn sources(folder: &Path, found: &mut Vec<PathBuf>) {
    for entry in std::fs::read_dir(folder).unwrap() {
        let path = entry.unwrap().path();
        if path.is_dir() {
            sources(&path, found);
        } else if path.extension().is_some_and(|e| e == "rs") {
            found.push(path);
        }
    }
}

/// Modules named in a source file: the first part of each path `crate::...`, without comments and tests.
fn named(text: &str) -> BTreeSet<String> {
    let code = text.split("#[cfg(test)]\nmod ").next().unwrap_or_default();
    let lines = code.lines().map(str::trim_start);
    let code: String = lines
        .filter(|line| !line.starts_with("//"))
        .collect::<Vec<_>>()
        .join("\n");
    let name = |s: &str| -> String {
        let part = |c: &char| c.is_alphanumeric() || *c == '_';
        s.trim_start().chars().take_while(part).collect()
    };
    let mut names = BTreeSet::new();
    for rest in code.split("crate::").skip(1) {
        match rest.strip_prefix('{') {
            None => names.extend([name(rest)]),
            Some(list) => names.extend(top_level(list).into_iter().map(name)),
        }
    }
    names
}

/// The items of a list `a, b::{c, d}}` after its opening brace.
fn top_level(list: &str) -> Vec<&str> {
    let (mut depth, mut start, mut parts) = (0, 0, Vec::new());
    for (i, c) in list.char_indices() {
        match c {
            '{' => depth += 1,
            '}' if depth > 0 => depth -= 1,
            ',' | '}' if depth == 0 => {
                parts.push(&list[start..i]);
                start = i + 1;
                if c == '}' {
                    break;
                }
            }
            _ => {}
        }
    }
    parts
}

fn edges(src: &Path) -> Edges {
    let mut files = Vec::new();
    sources(src, &mut files);
    let mut edges = Edges::new();
    for file in files {
        let inner = file.strip_prefix(src).unwrap();
        let first = inner.components().next().unwrap().as_os_str();
        let module = first.to_str().unwrap().trim_end_matches(".rs").to_owned();
        let is_test = file.file_stem().is_some_and(|s| s == "tests");
        // `synthetic` contains helpers of unit tests.
        let is_test = is_test || module == "synthetic";
        if module == "lib" || is_test || inner.components().any(|c| c.as_os_str() == "tests") {
            continue;
        }
        let names = named(&std::fs::read_to_string(&file).unwrap());
        edges.entry(module).or_default().extend(names);
    }
    edges
}

fn cycle(edges: &Edges) -> Option<Vec<String>> {
    fn search(edges: &Edges, way: &mut Vec<String>, done: &mut BTreeSet<String>) -> bool {
        let at = way.last().cloned().unwrap();
        for next in edges.get(&at).into_iter().flatten() {
            // A module may name itself.
            if *next == at || done.contains(next) {
                continue;
            }
            if let Some(begin) = way.iter().position(|w| w == next) {
                way.drain(..begin);
                way.push(next.clone());
                return true;
            }
            way.push(next.clone());
            if search(edges, way, done) {
                return true;
            }
            way.pop();
        }
        done.insert(at);
        false
    }
    let mut done = BTreeSet::new();
    edges.keys().find_map(|module| {
        let mut way = vec![module.clone()];
        search(edges, &mut way, &mut done).then_some(way)
    })
}

#[test]
fn slam_module_imports_are_acyclic() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("../slam/src");
    let edges = edges(&src);
    for stage in ["tracking", "mapping", "looping", "static_filter"] {
        assert!(edges[stage].contains("validation"), "{stage} has no edges");
    }
    // Paths must name the defining module, not re-exports at the crate root.
    for (module, names) in &edges {
        for name in names {
            assert!(
                edges.contains_key(name),
                "{module} names crate::{name}: expected one of the crate's modules; write crate::MODULE::{name}"
            );
        }
    }
    if let Some(way) = cycle(&edges) {
        panic!(
            "slam's modules import each other in a circle: {}; move what both need below them",
            way.join(" -> ")
        );
    }
}

#[test]
fn stages_do_not_import_configuration_or_each_other() {
    let src = Path::new(env!("CARGO_MANIFEST_DIR")).join("../slam/src");
    let edges = edges(&src);
    for stage in ["tracking", "mapping", "looping", "static_filter"] {
        for above in ["config", "health", "mapping", "looping", "tracking"] {
            assert!(
                above == stage || !edges[stage].contains(above),
                "{stage} imports {above}"
            );
        }
    }
}

#[test]
fn imports_and_cycles_are_parsed() {
    let text = "use crate::a::B;\n// crate::comment::X\nuse crate::{b::{C, D}, c::E};\nfn f() { crate::d::g(); }\n\
        #[cfg(test)]\nmod tests { use crate::test::T; }";
    let names: Vec<String> = named(text).into_iter().collect();
    assert_eq!(names, ["a", "b", "c", "d"]);
    let edges = |pairs: &[(&str, &str)]| {
        let mut edges = Edges::new();
        for (a, b) in pairs {
            edges
                .entry((*a).to_owned())
                .or_default()
                .insert((*b).to_owned());
            edges.entry((*b).to_owned()).or_default();
        }
        edges
    };
    assert_eq!(
        cycle(&edges(&[("a", "b"), ("b", "c"), ("a", "c"), ("a", "a")])),
        None
    );
    let round = cycle(&edges(&[("x", "a"), ("a", "b"), ("b", "c"), ("c", "a")]));
    assert_eq!(round.unwrap(), ["a", "b", "c", "a"]);
}
