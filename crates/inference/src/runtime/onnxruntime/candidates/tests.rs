//! The search for the library, in made-up folders.

use super::*;
use std::collections::BTreeMap;
use tempfile::TempDir;

fn folder(files: &[&str]) -> TempDir {
    let folder = tempfile::tempdir().unwrap();
    for file in files {
        let file = folder.path().join(file);
        std::fs::create_dir_all(file.parent().unwrap()).unwrap();
        std::fs::write(file, "").unwrap();
    }
    folder
}

/// Paths found within the folder; variables name folders in it.
fn found(root: &TempDir, variables: &[(&str, &str)], beside: &str, system: &str) -> Vec<String> {
    let root = root.path();
    let variables: BTreeMap<&str, OsString> = variables
        .iter()
        .map(|&(name, value)| {
            let folders = value.split(':').map(|v| root.join(v));
            (name, std::env::join_paths(folders).unwrap())
        })
        .collect();
    let environment = |name: &str| variables.get(name).cloned();
    let system = [root.join(system)];
    search(&environment, Some(&root.join(beside)), &system, &LINUX)
        .iter()
        .map(|file| file.strip_prefix(root).unwrap().display().to_string())
        .collect()
}

#[test]
fn library_names_and_versions_are_parsed() {
    for (names, name, version) in [
        (&LINUX, "libonnxruntime.so.1.31.1", Some(vec![1, 31, 1])),
        (&LINUX, "libonnxruntime.so.1", Some(vec![1])),
        (&LINUX, "libonnxruntime.so", Some(vec![])),
        (&MACOS, "libonnxruntime.1.20.1.dylib", Some(vec![1, 20, 1])),
        (&MACOS, "libonnxruntime.dylib", Some(vec![])),
        (&WINDOWS, "onnxruntime.dll", Some(vec![])),
        (&LINUX, "libonnxruntime_providers_shared.so", None),
        (&LINUX, "libonnxruntime.so.1.2.x", None),
        (&LINUX, "libonnxruntime.soo", None),
        (&LINUX, "libonnxruntime.a", None),
        (&LINUX, "onnxruntime_pybind11_state.so", None),
        (&MACOS, "libonnxruntime.so.1.31.1", None),
        (&WINDOWS, "onnxruntime_providers_shared.dll", None),
    ] {
        assert_eq!(names.version(name), version, "{name}");
    }
}

#[test]
fn search_locations_are_ordered() {
    let root = folder(&[
        "named/any_name.so",
        "bin/libonnxruntime.so",
        "venv/lib/python3.11/site-packages/onnxruntime/capi/libonnxruntime.so.1.20.0",
        "conda/lib/python3.12/site-packages/onnxruntime/capi/libonnxruntime.so.1.22.0",
        "conda/lib/libonnxruntime.so.1.22.0",
        "usr/bin/python3",
        "usr/lib/python3.13/site-packages/onnxruntime/capi/libonnxruntime.so.1.23.0",
        "usr/local/lib/python3.13/dist-packages/onnxruntime/capi/libonnxruntime.so.1.24.0",
        "home/.local/lib/python3.9/site-packages/onnxruntime/capi/libonnxruntime.so.1.18.0",
        "loader/libonnxruntime.so.1.17.0",
        "system/libonnxruntime.so.1.16.0",
    ]);
    let variables = [
        ("ORT_DYLIB_PATH", "named/any_name.so"),
        ("VIRTUAL_ENV", "venv"),
        ("CONDA_PREFIX", "conda"),
        ("PATH", "nothing:usr/bin"),
        ("HOME", "home"),
        ("LD_LIBRARY_PATH", "loader"),
    ];
    let capi = |python: &str, version: &str| {
        format!("{python}/onnxruntime/capi/libonnxruntime.so.{version}")
    };
    assert_eq!(
        found(&root, &variables, "bin", "system"),
        [
            "named/any_name.so".to_owned(),
            "bin/libonnxruntime.so".to_owned(),
            capi("venv/lib/python3.11/site-packages", "1.20.0"),
            capi("conda/lib/python3.12/site-packages", "1.22.0"),
            "conda/lib/libonnxruntime.so.1.22.0".to_owned(),
            capi("usr/lib/python3.13/site-packages", "1.23.0"),
            capi("usr/local/lib/python3.13/dist-packages", "1.24.0"),
            capi("home/.local/lib/python3.9/site-packages", "1.18.0"),
            "loader/libonnxruntime.so.1.17.0".to_owned(),
            "system/libonnxruntime.so.1.16.0".to_owned(),
        ]
    );
}

#[test]
fn newest_library_and_python_come_first() {
    let root = folder(&[
        "system/libonnxruntime.so",
        "system/libonnxruntime.so.1.9.0",
        "system/libonnxruntime.so.1.31.1",
        "system/libonnxruntime.so.1.31",
        "venv/lib/python3.9/site-packages/onnxruntime/capi/libonnxruntime.so.1.19.0",
        "venv/lib/python3.10/site-packages/onnxruntime/capi/libonnxruntime.so.1.18.0",
        "venv/lib/python2.7/site-packages/onnxruntime/capi/libonnxruntime.so.1.0.0",
    ]);
    assert_eq!(
        found(&root, &[("VIRTUAL_ENV", "venv")], "bin", "system"),
        [
            "venv/lib/python3.10/site-packages/onnxruntime/capi/libonnxruntime.so.1.18.0",
            "venv/lib/python3.9/site-packages/onnxruntime/capi/libonnxruntime.so.1.19.0",
            "system/libonnxruntime.so.1.31.1",
            "system/libonnxruntime.so.1.31",
            "system/libonnxruntime.so.1.9.0",
            "system/libonnxruntime.so",
        ]
    );
}

#[test]
fn named_file_is_kept_and_named_folder_is_searched() {
    let root = folder(&["lib/libonnxruntime.so.1.20.0"]);
    let named = |path| found(&root, &[("ORT_DYLIB_PATH", path)], "bin", "system");
    assert_eq!(named("missing.so"), ["missing.so"]);
    assert_eq!(named("lib"), ["lib/libonnxruntime.so.1.20.0"]);
    assert_eq!(found(&root, &[], "bin", "system"), [""; 0]);
}

#[test]
fn empty_and_relative_path_entries_are_ignored() {
    let environment = |name: &str| match name {
        "PATH" | "LD_LIBRARY_PATH" => Some(OsString::from(":.:src")),
        _ => Some(OsString::new()),
    };
    assert!(search(&environment, None, &[], &LINUX).is_empty());
}

#[cfg(unix)]
#[test]
fn symlinks_to_pythons_and_libraries_are_followed() {
    use std::os::unix::fs::symlink;
    let base = "opt/python/lib/python3.12/site-packages/onnxruntime/capi/libonnxruntime.so.1.21.0";
    let pyenv = "pyenv/versions/3.11.4/lib/python3.11/site-packages/onnxruntime/capi/libonnxruntime.so.1.20.0";
    let root = folder(&[
        "opt/python/bin/python3.12",
        base,
        "usr/bin/x",
        "pyenv/shims/python",
        pyenv,
    ]);
    let at = |path: &str| root.path().join(path);
    symlink(at("opt/python/bin/python3.12"), at("usr/bin/python3")).unwrap();
    symlink(at(base), at("usr/libonnxruntime.so")).unwrap();
    assert_eq!(
        found(&root, &[("PATH", "pyenv/shims:usr/bin")], "bin", "usr"),
        [pyenv, base]
    );
    // The same file once, by the first name.
    assert_eq!(found(&root, &[], "bin", "usr"), ["usr/libonnxruntime.so"]);
}

#[test]
#[allow(clippy::disallowed_methods)] // Tests may read the environment.
fn search_on_this_machine_is_deterministic() {
    let environment = |name: &str| std::env::var_os(name);
    let found = candidates(&environment);
    assert_eq!(found, candidates(&environment));
    // The file named by a variable need not exist.
    let named = usize::from(std::env::var_os("ORT_DYLIB_PATH").is_some());
    assert!(found.iter().skip(named).all(|file| file.is_file()));
}
