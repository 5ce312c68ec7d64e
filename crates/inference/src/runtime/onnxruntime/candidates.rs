//! Possible paths of the shared library of ONNX Runtime. Reads file names only: runs nothing, not even Python, and loads nothing, so a
//! candidate may still be too old or for another architecture.

use std::collections::BTreeSet;
use std::env::consts;
use std::ffi::OsString;
use std::path::{Path, PathBuf};

pub(super) fn candidates(environment: &dyn Fn(&str) -> Option<OsString>) -> Vec<PathBuf> {
    let executable = std::env::current_exe().ok();
    let beside = executable.as_deref().and_then(Path::parent);
    search(environment, beside, &system_folders(), &NAMES)
}

/// File name of the library: `start`, then `end`, with the version in between or behind.
struct Names {
    start: &'static str,
    end: &'static str,
}

const LINUX: Names = Names {
    start: "libonnxruntime",
    end: ".so",
};
const MACOS: Names = Names {
    start: "libonnxruntime",
    end: ".dylib",
};
const WINDOWS: Names = Names {
    start: "onnxruntime",
    end: ".dll",
};
const NAMES: Names = if cfg!(windows) {
    WINDOWS
} else if cfg!(target_vendor = "apple") {
    MACOS
} else {
    LINUX
};

impl Names {
    /// Version of a library's file name, empty if without one; `None` for other files.
    fn version(&self, name: &str) -> Option<Vec<u64>> {
        let rest = name.strip_prefix(self.start)?;
        // libonnxruntime.so.1.31.1, or libonnxruntime.1.31.1.dylib.
        let version = rest
            .strip_prefix(self.end)
            .or_else(|| rest.strip_suffix(self.end))?;
        if version.is_empty() {
            return Some(Vec::new());
        }
        numbers(version.strip_prefix('.')?)
    }
}

fn numbers(text: &str) -> Option<Vec<u64>> {
    text.split('.').map(|n| n.parse().ok()).collect()
}

fn search(
    environment: &dyn Fn(&str) -> Option<OsString>,
    beside: Option<&Path>,
    system: &[PathBuf],
    names: &Names,
) -> Vec<PathBuf> {
    let variable = |name: &str| environment(name).filter(|v| !v.is_empty());
    let path = |name: &str| variable(name).map(PathBuf::from);
    let paths = |name: &str| -> Vec<PathBuf> {
        let value = variable(name).unwrap_or_default();
        // An empty entry denotes the working directory, which is not trusted.
        std::env::split_paths(&value)
            .filter(|p| p.is_absolute())
            .collect()
    };
    let mut folders = Vec::new();
    folders.extend(beside.map(Path::to_owned));
    for prefix in ["VIRTUAL_ENV", "CONDA_PREFIX"].into_iter().filter_map(path) {
        folders.extend(in_python(&prefix));
        // Conda's package for C++.
        folders.push(prefix.join("lib"));
    }
    let pythons = paths("PATH");
    for prefix in pythons.iter().flat_map(|folder| prefixes(folder)) {
        folders.extend(in_python(&prefix));
    }
    if let Some(home) = path("HOME") {
        folders.extend(in_python(&home.join(".local")));
        for version in versions(&home.join("Library/Python"), "") {
            folders.push(capi(&version.join("lib/python/site-packages")));
        }
    }
    if let Some(data) = path("APPDATA") {
        for version in versions(&data.join("Python"), "Python") {
            folders.push(capi(&version.join("site-packages")));
        }
    }
    folders.extend(paths("LD_LIBRARY_PATH"));
    folders.extend(paths("DYLD_LIBRARY_PATH"));
    folders.extend_from_slice(system);

    let mut found = Vec::new();
    match path("ORT_DYLIB_PATH") {
        Some(folder) if folder.is_dir() => found.extend(libraries(&folder, names)),
        file => found.extend(file),
    }
    found.extend(folders.iter().flat_map(|folder| libraries(folder, names)));
    let mut seen = BTreeSet::new();
    found.retain(|file| seen.insert(file.canonicalize().unwrap_or_else(|_| file.clone())));
    found
}

/// The libraries in a folder, newest first; names without a version, which are mostly links, last.
fn libraries(folder: &Path, names: &Names) -> Vec<PathBuf> {
    let mut found: Vec<(Vec<u64>, PathBuf)> = entries(folder)
        .filter_map(|(name, file)| Some((names.version(&name)?, file)))
        .filter(|(_, file)| file.is_file())
        .collect();
    found.sort_by(|a, b| b.cmp(a));
    found.into_iter().map(|(_, file)| file).collect()
}

/// Folders of the library in the Python installed under this prefix.
fn in_python(prefix: &Path) -> Vec<PathBuf> {
    // Windows, and Debian's own packages.
    let mut packages = vec![
        prefix.join("Lib/site-packages"),
        prefix.join("lib/python3/dist-packages"),
    ];
    for lib in ["lib", "lib64", "local/lib"] {
        for python in versions(&prefix.join(lib), "python") {
            packages.extend(["site-packages", "dist-packages"].map(|p| python.join(p)));
        }
    }
    packages.iter().map(|p| capi(p)).collect()
}

/// Folder of the library in the package `onnxruntime`.
fn capi(packages: &Path) -> PathBuf {
    packages.join("onnxruntime/capi")
}

/// Installation prefixes of the Pythons in a folder of `PATH`: of the folder itself, and of their link targets, because an environment's
/// Python links to the one that created it.
fn prefixes(folder: &Path) -> Vec<PathBuf> {
    let mut found = Vec::new();
    for name in ["python3", "python", "python3.exe", "python.exe"] {
        let python = folder.join(name);
        if !python.is_file() {
            continue;
        }
        // Scripts of pyenv that select a version when they run.
        if folder.ends_with("shims") {
            found.extend(versions(&folder.with_file_name("versions"), ""));
            continue;
        }
        let links = [Some(python.clone()), python.canonicalize().ok()];
        for folder in links.iter().flatten().filter_map(|p| p.parent()) {
            let programs = folder.ends_with("bin") || folder.ends_with("Scripts");
            let prefix = if programs {
                folder.parent()
            } else {
                Some(folder)
            };
            found.extend(prefix.map(Path::to_owned));
        }
    }
    found
}

/// Entries of a folder named `start` and a version of 3, newest first.
fn versions(folder: &Path, start: &str) -> Vec<PathBuf> {
    let mut found: Vec<(Vec<u64>, PathBuf)> = entries(folder)
        .filter_map(|(name, path)| Some((numbers(name.strip_prefix(start)?)?, path)))
        // Windows has Python313.
        .filter(|(version, _)| version[0] == 3 || (300..400).contains(&version[0]))
        .collect();
    found.sort_by(|a, b| b.cmp(a));
    found.into_iter().map(|(_, path)| path).collect()
}

/// Names and paths in a folder; none if it cannot be read.
fn entries(folder: &Path) -> impl Iterator<Item = (String, PathBuf)> {
    let read = std::fs::read_dir(folder).into_iter().flatten().flatten();
    read.filter_map(|e| Some((e.file_name().into_string().ok()?, e.path())))
}

fn system_folders() -> Vec<PathBuf> {
    let mut folders: Vec<PathBuf> = if cfg!(windows) {
        vec![
            "C:/Program Files/onnxruntime/lib".into(),
            "C:/Windows/System32".into(),
        ]
    } else {
        ["/usr/local/lib", "/usr/local/lib64", "/opt/homebrew/lib"]
            .map(PathBuf::from)
            .to_vec()
    };
    if cfg!(unix) {
        // Debian's folders per architecture, e.g. x86_64-linux-gnu.
        let usr = PathBuf::from("/usr/lib");
        let mut machine: Vec<PathBuf> = entries(&usr)
            .filter(|(name, _)| name.starts_with(consts::ARCH) && name.contains("-linux-"))
            .map(|(_, path)| path)
            .collect();
        machine.sort();
        folders.extend(machine);
        folders.extend(["/usr/lib64".into(), usr]);
    }
    folders
}

#[cfg(test)]
mod tests;
