//! Possible paths of librealsense's shared library. Reads file names only.

use std::collections::BTreeSet;
use std::env::consts;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

/// The variable with the path of the library or of its folder.
pub const VARIABLE: &str = "STILLPOINT_REALSENSE";

/// Beginnings of the library's file name: a version may follow.
const NAMES: &[&str] = if cfg!(windows) {
    &["realsense2.dll"]
} else if cfg!(target_vendor = "apple") {
    &["librealsense2.dylib", "librealsense2."]
} else {
    &["librealsense2.so"]
};

/// Files to try, in order: only the variable's, if set, else those of ROS, the linker's variables and the system.
pub(crate) fn candidates(environment: &dyn Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
    search(environment, Path::new("/opt/ros"), &system())
}

fn search(
    environment: &dyn Fn(&str) -> Option<OsString>,
    ros: &Path,
    system: &[PathBuf],
) -> Vec<PathBuf> {
    let variable = |name: &str| environment(name).filter(|v| !v.is_empty());
    if let Some(named) = variable(VARIABLE).map(PathBuf::from) {
        return if named.is_dir() {
            libraries(&named)
        } else {
            vec![named]
        };
    }
    let paths = |name: &str| -> Vec<PathBuf> {
        let value = variable(name).unwrap_or_default();
        // An empty entry denotes the working directory, which is not trusted.
        let absolute = std::env::split_paths(&value).filter(|p| p.is_absolute());
        absolute.collect()
    };
    let mut folders = Vec::new();
    for prefix in paths("AMENT_PREFIX_PATH") {
        folders.extend(libs(&prefix));
    }
    folders.extend(paths("LD_LIBRARY_PATH"));
    folders.extend(paths("DYLD_LIBRARY_PATH"));
    folders.extend_from_slice(system);
    for distribution in entries(ros) {
        folders.extend(libs(&distribution));
    }
    let mut seen = BTreeSet::new();
    let mut found: Vec<PathBuf> = folders.iter().flat_map(|f| libraries(f)).collect();
    found.retain(|file| seen.insert(file.canonicalize().unwrap_or_else(|_| file.clone())));
    found
}

/// Library folders below a prefix.
fn libs(prefix: &Path) -> Vec<PathBuf> {
    let lib = prefix.join("lib");
    let machine = lib.join(format!("{}-linux-gnu", consts::ARCH));
    vec![machine, lib]
}

fn system() -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = ["/usr/local", "/usr", "/opt/homebrew"]
        .iter()
        .flat_map(|p| libs(Path::new(p)))
        .collect();
    folders.push("/usr/lib64".into());
    folders.push("C:\\Program Files (x86)\\Intel RealSense SDK 2.0\\bin\\x64".into());
    folders
}

fn entries(folder: &Path) -> Vec<PathBuf> {
    let found = std::fs::read_dir(folder).into_iter().flatten().flatten();
    let mut found: Vec<PathBuf> = found.map(|e| e.path()).collect();
    found.sort();
    found.reverse();
    found
}

/// The libraries in a folder, the highest version first.
fn libraries(folder: &Path) -> Vec<PathBuf> {
    let is_one = |file: &PathBuf| {
        let name = file.file_name().unwrap_or_default().to_string_lossy();
        NAMES.iter().any(|n| name.starts_with(n)) && file.is_file()
    };
    entries(folder).into_iter().filter(is_one).collect()
}

#[cfg(all(test, unix, not(target_vendor = "apple")))]
mod tests {
    use super::*;

    #[test]
    fn named_library_is_the_only_candidate() {
        let root = tempfile::tempdir().unwrap();
        let make = |path: &str| {
            let file = root.path().join(path);
            std::fs::create_dir_all(file.parent().unwrap()).unwrap();
            std::fs::write(&file, "").unwrap();
            file
        };
        let own = make("own/librealsense2.so.2.56.3");
        let old = make("own/librealsense2.so.2.50.0");
        let ros = make("ros/jazzy/lib/librealsense2.so.2.55");
        let elsewhere = make("sys/librealsense2.so");
        make("sys/libother.so");
        let system = [root.path().join("sys")];
        let found = |named: Option<&Path>| {
            let named = named.map(|n| n.as_os_str().to_owned());
            let environment = |name: &str| (name == VARIABLE).then(|| named.clone()).flatten();
            search(&environment, &root.path().join("ros"), &system)
        };
        assert_eq!(found(None), [elsewhere, ros]);
        assert_eq!(found(Some(&root.path().join("own"))), [own.clone(), old]);
        assert_eq!(found(Some(&own)), [own]);
        // A missing named file is reported, not replaced.
        let gone = root.path().join("gone.so");
        assert_eq!(found(Some(&gone)), [gone]);
    }
}
