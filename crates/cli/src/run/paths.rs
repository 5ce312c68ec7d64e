//! Checks that all outputs of a run have different paths: otherwise the later of two would replace the earlier at the end of a run.

use crate::failure::Failure;
use crate::output::is_result_file;
use std::path::{Component, Path, PathBuf};
use stillpoint::recordings::Input;

/// File extensions of data sets. An existing file with one of them in a data set counts as a part of it; other files there may come from an
/// earlier run.
const DATA: [&str; 11] = [
    "txt", "png", "jpg", "jpeg", "webp", "yaml", "yml", "bag", "mcap", "db3", "zstd",
];

/// Refuses two outputs on one path, and an output on the path of a result file or of one of `inputs`, which are read. All are given with
/// their names for messages.
///
/// # Errors
/// The two options and the path.
pub(crate) fn check_run(
    files: &[(&str, &Path)],
    out: &Path,
    inputs: &[(&str, &Path)],
) -> Result<(), Failure> {
    check(files, inputs)?;
    let out = place(out);
    for &(option, path) in files {
        let place = place(path);
        let name = place.file_name().and_then(|n| n.to_str());
        let in_result = place.parent() == Some(&*out) && name.is_some_and(is_result_file);
        // That is the default place of the log.
        if in_result && !(option == "--log" && name == Some("run.log")) {
            return Err(twice(path, option, "a file of the result"));
        }
    }
    Ok(())
}

/// Refuses two of `files` on one path, and a file on the path of one of `inputs`, which are read.
///
/// # Errors
/// The two options and the path.
pub(crate) fn check(files: &[(&str, &Path)], inputs: &[(&str, &Path)]) -> Result<(), Failure> {
    let mut taken: Vec<(&str, PathBuf)> = inputs.iter().map(|(o, p)| (*o, place(p))).collect();
    for &(option, path) in files {
        // Devices and pipes are not replaced.
        if path.exists() && !path.is_file() {
            continue;
        }
        let place = place(path);
        if let Some((other, _)) = taken.iter().find(|(_, p)| *p == place) {
            return Err(twice(path, option, &format!("that of {other}")));
        }
        taken.push((option, place));
    }
    Ok(())
}

/// Refuses outputs that would change the input at `path`: files of the data set or recording, and folders of its images, where a run would
/// replace and remove files by name. `results` are output folders, `files` output files, each with its option.
///
/// # Errors
/// The option and the path.
pub(crate) fn check_outputs(
    results: &[(&str, &Path)],
    files: &[(&str, &Path)],
    path: &Path,
    input: &Input,
) -> Result<(), Failure> {
    let read = place(path);
    let mut folders: Vec<PathBuf> = Vec::new();
    if path.is_dir() {
        folders.push(read.clone());
    }
    if let Input::Folder(dataset) = input {
        let images = dataset.entries().iter().flat_map(|e| [&e.colour, &e.depth]);
        let mut parents: Vec<&Path> = images.filter_map(|i| i.parent()).collect();
        parents.dedup();
        parents.sort_unstable();
        parents.dedup();
        folders.extend(parents.into_iter().map(place));
    }
    let spoils = |path: &Path, option| {
        Failure::input(format!(
            "{}: expected a path outside of the data set for {option}, found one that would replace files of it; name another with {option}",
            path.display()
        ))
    };
    for &(option, folder) in results {
        if folders.contains(&place(folder)) {
            return Err(spoils(folder, option));
        }
    }
    for &(option, file) in files {
        let place = place(file);
        let ending = place.extension().and_then(|e| e.to_str()).unwrap_or("");
        let is_data = DATA.contains(&ending.to_ascii_lowercase().as_str()) && place.is_file();
        let is_within = place
            .parent()
            .is_some_and(|p| folders.iter().any(|f| f == p));
        if place == read || (is_data && is_within) {
            return Err(spoils(file, option));
        }
    }
    Ok(())
}

pub(crate) fn named<'a, const N: usize>(
    files: [(&'static str, Option<&'a Path>); N],
) -> Vec<(&'static str, &'a Path)> {
    files
        .into_iter()
        .filter_map(|(o, p)| Some((o, p?)))
        .collect()
}

pub(crate) fn is_in(file: &Path, folder: &Path) -> bool {
    place(file).parent() == Some(&*place(folder))
}

fn twice(path: &Path, option: &str, other: &str) -> Failure {
    Failure::input(format!(
        "{}: expected a path of its own for {option}, found {other}, which one of the two would take the place of; name another with {option}",
        path.display()
    ))
}

/// The canonical path, existing or not: links are resolved as far as it exists, `.` and `..` beyond that.
fn place(path: &Path) -> PathBuf {
    if let Ok(found) = path.canonicalize() {
        return found;
    }
    let absolute = std::path::absolute(path).unwrap_or_else(|_| path.to_owned());
    let mut clean = PathBuf::new();
    for component in absolute.components() {
        match component {
            Component::ParentDir => drop(clean.pop()),
            Component::CurDir => {}
            other => clean.push(other),
        }
        if let Ok(found) = clean.canonicalize() {
            clean = found;
        }
    }
    clean
}

#[cfg(test)]
mod tests {
    use super::*;

    /// The files of `--verdicts`, `--save-map` and `--trace` that are given.
    fn files(paths: [Option<&str>; 3], folder: &Path) -> Vec<(&'static str, PathBuf)> {
        let [verdicts, trace, save_map] = paths.map(|p| p.map(|p| folder.join(p)));
        let all = [
            ("--verdicts", verdicts),
            ("--save-map", save_map),
            ("--trace", trace),
        ];
        all.into_iter().filter_map(|(o, p)| Some((o, p?))).collect()
    }

    fn check_files(
        files: &[(&'static str, PathBuf)],
        out: &Path,
        inputs: &[(&str, &Path)],
    ) -> Result<(), Failure> {
        let files: Vec<(&str, &Path)> = files.iter().map(|(o, p)| (*o, &**p)).collect();
        check_run(&files, out, inputs)
    }

    #[test]
    fn two_outputs_on_one_path_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path();
        std::fs::create_dir(root.join("sub")).unwrap();
        let out = root.join("out");
        let said = |paths, log: Option<&str>, inputs: &[(&str, &Path)]| {
            let mut files = files(paths, root);
            files.extend(log.map(|l| ("--log", root.join(l))));
            match check_files(&files, &out, inputs) {
                Ok(()) => String::new(),
                Err(e) => e.to_string(),
            }
        };
        assert_eq!(said([Some("a"), Some("b"), Some("c")], Some("d"), &[]), "");
        let found = said([None, Some("f"), Some("f")], None, &[]);
        assert!(
            found.contains("for --trace, found that of --save-map"),
            "{found}"
        );
        let found = said([Some("no/f"), None, Some("no/f")], None, &[]);
        assert!(
            found.contains("--save-map, found that of --verdicts"),
            "{found}"
        );
        // In any spelling, whether or not its folder exists.
        for other in ["sub/../f", "./f", "no/../f"] {
            assert!(
                said([Some("f"), Some(other), None], None, &[]).contains("f"),
                "{other}"
            );
        }
        assert!(said([None, None, Some("f")], Some("f"), &[]).contains("--log"));
        // A file of the result.
        let found = said([Some("out/frames.csv"), None, None], None, &[]);
        assert!(found.contains("a file of the result"), "{found}");
        assert_eq!(
            said(
                [Some("out/verdicts.csv"), None, None],
                Some("out/run.log"),
                &[]
            ),
            ""
        );
        // An input.
        let log = root.join("f");
        assert!(said([Some("f"), None, None], None, &[("the log", &log)]).contains("the log"));
    }

    #[test]
    #[cfg(unix)]
    fn links_to_one_file_conflict_and_devices_do_not() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path();
        std::fs::write(root.join("f"), "old").unwrap();
        std::os::unix::fs::symlink(root.join("f"), root.join("link")).unwrap();
        let out = root.join("out");
        let link = files([Some("f"), Some("link"), None], root);
        assert!(check_files(&link, &out, &[]).is_err());
        let null = files([Some("/dev/null"), Some("/dev/null"), None], root);
        assert!(check_files(&null, &out, &[]).is_ok());
    }
}
