//! Finds the sequences of a suite below a folder.

use crate::bench::suite::catalogue::{Known, Suite};
use crate::console;
use crate::failure::Failure;
use std::path::{Path, PathBuf};

/// Maximum number of folder levels below the given one. Archives are often unpacked into a folder per camera, and into one of their own
/// name once more.
const DEPTH: usize = 3;

/// A sequence and its path, if found.
#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Found {
    pub(crate) known: &'static Known,
    pub(crate) path: Option<PathBuf>,
}

/// Every sequence of the suite, in its order. Of duplicates the first is taken, with a warning.
///
/// # Errors
/// A path that is not a folder; folders without any sequence.
pub(crate) fn find(suite: Suite, folders: &[PathBuf]) -> Result<Vec<Found>, Failure> {
    let found = look_in(suite, folders)?;
    if found.iter().all(|f| f.path.is_none()) {
        let folders: Vec<_> = folders.iter().map(|f| f.display().to_string()).collect();
        return Err(Failure::input(format!(
            "{}: expected folders of the suite {} such as {}, found none down to {DEPTH} folders below; keep the names that \
             the data set gives its folders, or get them with --pull",
            folders.join(", "),
            suite.name(),
            suite.example()
        )));
    }
    Ok(found)
}

/// Like [`find`], but finding none is not an error.
///
/// # Errors
/// A path that is not a folder.
pub(crate) fn look_in(suite: Suite, folders: &[PathBuf]) -> Result<Vec<Found>, Failure> {
    let mut hits = Vec::new();
    for folder in folders {
        if !folder.is_dir() {
            let found = if folder.exists() { "a file" } else { "nothing" };
            return Err(Failure::input(format!(
                "{}: expected a folder to look for sequences in, found {found}",
                folder.display()
            )));
        }
        // Canonical, so that even `.` has a name.
        let full = folder.canonicalize().unwrap_or_else(|_| folder.clone());
        let name = full.file_name().map(|n| n.to_string_lossy().into_owned());
        look(suite, folder, name.as_deref().unwrap_or(""), 0, &mut hits);
    }
    Ok(suite.sequences().iter().map(|k| choose(k, &hits)).collect())
}

struct Hit {
    known: &'static Known,
    path: PathBuf,
    listed: bool,
}

/// Chooses the first folder with frames, else the first of the name, whose run will report the problem.
fn choose(known: &'static Known, hits: &[Hit]) -> Found {
    let all: Vec<&Hit> = hits.iter().filter(|h| h.known == known).collect();
    let listed: Vec<&Hit> = all.iter().copied().filter(|h| h.listed).collect();
    for other in listed.iter().skip(1) {
        console::warn(&format!(
            "{}: found again in {}; {} is run",
            known.name,
            other.path.display(),
            listed[0].path.display()
        ));
    }
    Found {
        known,
        path: listed.first().or(all.first()).map(|h| h.path.clone()),
    }
}

/// Collects the matches in a folder and below, in the order of names.
fn look(suite: Suite, folder: &Path, name: &str, depth: usize, hits: &mut Vec<Hit>) {
    let listed = lists_frames(folder);
    if let Some(known) = suite.recognise(name) {
        hits.push(Hit {
            known,
            path: folder.to_owned(),
            listed,
        });
    }
    // Below a sequence there are only images.
    if listed || depth == DEPTH {
        return;
    }
    let entries = match std::fs::read_dir(folder) {
        Ok(entries) => entries,
        Err(e) => {
            console::warn(&format!("{}: not looked into: {e}", folder.display()));
            return;
        }
    };
    let mut below: Vec<(String, PathBuf)> = entries
        .filter_map(Result::ok)
        .map(|e| (e.file_name().to_string_lossy().into_owned(), e.path()))
        .filter(|(name, path)| !name.starts_with('.') && path.is_dir())
        .collect();
    below.sort();
    for (name, path) in below {
        look(suite, &path, &name, depth + 1, hits);
    }
}

/// True for a folder that lists frames in one of the ways of the TUM layout.
fn lists_frames(folder: &Path) -> bool {
    folder.join("rgb.txt").is_file()
        || folder.join("associations.txt").is_file()
        || folder.join("rgb").is_dir()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn sequence(root: &Path, path: &str) {
        let folder = root.join(path);
        std::fs::create_dir_all(&folder).unwrap();
        std::fs::write(folder.join("rgb.txt"), "").unwrap();
    }

    fn found(suite: Suite, root: &Path) -> Vec<(&'static str, String)> {
        find(suite, &[root.to_owned()])
            .unwrap()
            .into_iter()
            .filter_map(|f| {
                let path = f.path?;
                let path = path.strip_prefix(root).unwrap().display().to_string();
                Some((f.known.name, path))
            })
            .collect()
    }

    #[test]
    fn sequences_are_found_up_to_depth_three() {
        let dir = tempfile::tempdir().unwrap();
        let root = dir.path();
        sequence(root, "rgbd_dataset_freiburg3_walking_xyz");
        sequence(root, "tum/fr3_walking_rpy");
        sequence(root, "tum/fr3/rgbd_dataset_freiburg3_sitting_xyz");
        sequence(root, "tum/fr3/more/rgbd_dataset_freiburg3_sitting_rpy");
        sequence(root, ".hidden/fr3_walking_static");
        // Unpacked into a folder of its own name; incomplete; a copy; a file of the name.
        sequence(root, "fr3_walking_static/fr3_walking_static");
        std::fs::create_dir(root.join("fr3_walking_halfsphere")).unwrap();
        sequence(root, "z/rgbd_dataset_freiburg3_walking_xyz");
        std::fs::write(root.join("fr3_sitting_static"), "").unwrap();
        assert_eq!(
            found(Suite::TumDynamic, root),
            [
                ("walking_xyz", "rgbd_dataset_freiburg3_walking_xyz".into()),
                (
                    "walking_static",
                    "fr3_walking_static/fr3_walking_static".into()
                ),
                ("walking_rpy", "tum/fr3_walking_rpy".into()),
                ("walking_halfsphere", "fr3_walking_halfsphere".into()),
                (
                    "sitting_xyz",
                    "tum/fr3/rgbd_dataset_freiburg3_sitting_xyz".into()
                ),
            ]
        );
        // The folder of a sequence itself.
        let one = root.join("tum/fr3_walking_rpy");
        assert_eq!(
            found(Suite::TumDynamic, &one),
            [("walking_rpy", String::new())]
        );
    }

    #[test]
    fn folder_without_sequences_is_refused_with_an_example() {
        let dir = tempfile::tempdir().unwrap();
        sequence(dir.path(), "fr3_walking_xyz");
        let e = find(Suite::Bonn, &[dir.path().to_owned()]).unwrap_err();
        assert!(e.to_string().contains("rgbd_bonn_crowd"), "{e}");
        let e = find(Suite::Bonn, &[dir.path().join("no")]).unwrap_err();
        assert!(e.to_string().contains("found nothing"), "{e}");
    }
}
