//! The result folder, and single large files: written aside, then moved into place, so that an incomplete result never replaces an old one.

use crate::failure::Failure;
use std::collections::BTreeSet;
use std::fs::{File, OpenOptions};
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use stillpoint::datasets::AtomicFile;
use stillpoint::map::SubmapId;

/// Every file of a result, beside those of further submaps.
const FILES: [&str; 20] = [
    "trajectory.txt",
    "trajectory_covariance.txt",
    "trajectory_covariance_in_map.txt",
    "trajectory_online.txt",
    "keyframes.txt",
    "frames.csv",
    "config.toml",
    "summary.json",
    "report.html",
    "run.log",
    "plot.svg",
    "plot.png",
    "timing.svg",
    "timing.png",
    "mesh.ply",
    "things.json",
    "mesh.glb",
    "grid.pgm",
    "grid.yaml",
    "grid_crossed.pgm",
];

/// Whether a file name belongs to a result.
pub(crate) fn is_result_file(name: &str) -> bool {
    FILES.contains(&name) || is_submap_file(name)
}

/// File name for the poses of a submap: the first is the run's trajectory.
pub(crate) fn submap_file(number: usize, id: SubmapId) -> String {
    if number == 0 {
        "trajectory.txt".to_owned()
    } else {
        format!("trajectory_submap_{id}.txt")
    }
}

/// Whether the name is that of the poses of a further submap.
fn is_submap_file(name: &str) -> bool {
    let id = name.strip_prefix("trajectory_submap_");
    let id = id.and_then(|rest| rest.strip_suffix(".txt"));
    id.is_some_and(|id| id.parse::<u32>().is_ok())
}

/// A result folder before it is committed, or another folder whose files replace those of an earlier run. Files are written to a hidden
/// folder inside it, and [`ResultFolder::commit`] moves them. Dropping it instead keeps the older result.
#[derive(Debug)]
pub(crate) struct ResultFolder {
    out: PathBuf,
    aside: PathBuf,
    option: &'static str,
    /// Names of result files: those of an older result that the new one lacks are removed.
    is_ours: fn(&str) -> bool,
    names: BTreeSet<String>,
    /// Held until the commit; the system releases it when the process ends, however that happens.
    _lock: Option<File>,
    /// The topmost folder that was created.
    created: Option<PathBuf>,
}

impl ResultFolder {
    /// Creates the folder if it is missing, and tests that it is writable, so that this is not found out at the end of a run.
    pub(crate) fn create(out: &Path) -> Result<Self, Failure> {
        Self::create_of(out, "--out", is_result_file)
    }

    /// Like [`Self::create`], for the folder of another option, with other file names.
    pub(crate) fn create_of(
        out: &Path,
        option: &'static str,
        is_ours: fn(&str) -> bool,
    ) -> Result<Self, Failure> {
        if out.exists() && !out.is_dir() {
            return Err(Failure::input(format!(
                "{}: expected a folder to write to, found a file; name another with {option}",
                out.display()
            )));
        }
        let created = out
            .ancestors()
            .filter(|p| !p.as_os_str().is_empty() && !p.exists())
            .last()
            .map(Path::to_owned);
        remove_unfinished(out);
        let mut folder = Self {
            out: out.to_owned(),
            // Two options may name the same folder.
            aside: out.join(format!(
                "{UNFINISHED}--{}-{}",
                option.trim_start_matches('-'),
                std::process::id()
            )),
            option,
            is_ours,
            names: BTreeSet::new(),
            _lock: None,
            created,
        };
        let lock = locked(&folder.aside).map_err(|e| Failure::write_of(out, option, &e))?;
        folder._lock = Some(lock);
        Ok(folder)
    }

    pub(crate) fn write(&mut self, name: &str, bytes: &[u8]) -> Result<(), Failure> {
        let mut file = self.begin(name)?;
        file.write_all(bytes)
            // A full disk may show only here.
            .and_then(|()| file.sync_all())
            .map_err(|e| self.failure(name, &e))
    }

    pub(crate) fn begin(&mut self, name: &str) -> Result<File, Failure> {
        debug_assert!((self.is_ours)(name), "{name} is none of the known files");
        let file = File::create(self.aside.join(name)).map_err(|e| self.failure(name, &e))?;
        self.names.insert(name.to_owned());
        Ok(file)
    }

    /// Moves everything into place.
    pub(crate) fn commit(self) -> Result<(), Failure> {
        for name in &self.names {
            std::fs::rename(self.aside.join(name), self.out.join(name))
                .map_err(|e| self.failure(name, &e))?;
        }
        // Failures to list or remove are harmless.
        let old = std::fs::read_dir(&self.out).into_iter().flatten().flatten();
        for name in old.filter_map(|entry| entry.file_name().into_string().ok()) {
            if (self.is_ours)(&name) && !self.names.contains(&name) {
                let _ = std::fs::remove_file(self.out.join(name));
            }
        }
        Ok(())
    }

    fn failure(&self, name: &str, reason: &std::io::Error) -> Failure {
        Failure::write_of(&self.out.join(name), self.option, reason)
    }
}

impl Drop for ResultFolder {
    fn drop(&mut self) {
        // A failure is ignored: the folder is hidden and named as unfinished.
        let _ = std::fs::remove_dir_all(&self.aside);
        if let Some(top) = &self.created {
            // Removes the folders created here; those with other contents are not empty and stay.
            for folder in self.out.ancestors() {
                let _ = std::fs::remove_dir(folder);
                if folder == top {
                    break;
                }
            }
        }
    }
}

/// Name prefix of folders that are not yet committed; followed by the option and the process id.
const UNFINISHED: &str = ".unfinished";
const LOCK: &str = "lock";
/// Minimum age of such a folder without a lock, after which its process counts as killed; a younger one may be in the making.
const ABANDONED: std::time::Duration = std::time::Duration::from_secs(60);

fn locked(aside: &Path) -> std::io::Result<File> {
    loop {
        std::fs::create_dir_all(aside)?;
        let path = aside.join(LOCK);
        let mut lock = File::create(&path)?;
        // Also tests for a full disk.
        lock.write_all(b"held by the process that fills this folder\n")?;
        // On file systems without locks no folder ever counts as abandoned.
        let _ = lock.lock();
        // Another process may have removed it as abandoned before it was locked.
        if path.exists() {
            return Ok(lock);
        }
    }
}

/// Removes the unfinished folders of killed processes from a result folder; failures are harmless.
fn remove_unfinished(out: &Path) {
    let entries = std::fs::read_dir(out).into_iter().flatten().flatten();
    for entry in entries {
        let name = entry.file_name();
        let is_ours = name.to_str().is_some_and(is_unfinished);
        if is_ours && is_abandoned(&entry.path()) {
            let _ = std::fs::remove_dir_all(entry.path());
        }
    }
}

/// Whether a name has the form that [`ResultFolder`] gives to unfinished folders.
fn is_unfinished(name: &str) -> bool {
    let Some((option, process)) = name
        .strip_prefix(UNFINISHED)
        .and_then(|rest| rest.rsplit_once('-'))
    else {
        return false;
    };
    option.starts_with("--") && process.parse::<u32>().is_ok()
}

/// Whether the process of an unfinished folder is gone.
fn is_abandoned(aside: &Path) -> bool {
    match OpenOptions::new().write(true).open(aside.join(LOCK)) {
        // A reader that locks the file does not count as its writer.
        Ok(lock) => lock.try_lock().is_ok(),
        Err(_) => {
            let made = std::fs::metadata(aside).and_then(|m| m.modified());
            made.is_ok_and(|t| t.elapsed().is_ok_and(|age| age > ABANDONED))
        }
    }
}

/// A file that is written incrementally and moved into place when complete. Dropping it before keeps the existing file.
#[derive(Debug)]
pub(crate) struct StreamedFile {
    path: PathBuf,
    option: &'static str,
    writer: BufWriter<AtomicFile>,
}

impl StreamedFile {
    pub(crate) fn create(path: &Path, option: &'static str) -> Result<Self, Failure> {
        let file = AtomicFile::create(path).map_err(|e| Failure::write_of(path, option, &e))?;
        Ok(Self {
            path: path.to_owned(),
            option,
            writer: BufWriter::with_capacity(1 << 16, file),
        })
    }

    /// Lets `write` append.
    pub(crate) fn write(
        &mut self,
        write: impl FnOnce(&mut BufWriter<AtomicFile>) -> std::io::Result<()>,
    ) -> Result<(), Failure> {
        write(&mut self.writer).map_err(|e| Failure::write_of(&self.path, self.option, &e))
    }

    pub(crate) fn finish(self) -> Result<(), Failure> {
        let file = self.writer.into_inner().map_err(|e| e.into_error());
        file.and_then(AtomicFile::commit)
            .map_err(|e| Failure::write_of(&self.path, self.option, &e))
    }
}

/// Writes one file atomically, outside of a result folder.
pub(crate) fn write_file(path: &Path, bytes: &[u8]) -> Result<(), Failure> {
    stillpoint::datasets::write_atomic(path, bytes).map_err(Failure::from)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn names(folder: &Path) -> Vec<String> {
        let mut names: Vec<String> = std::fs::read_dir(folder)
            .unwrap()
            .map(|e| e.unwrap().file_name().into_string().unwrap())
            .collect();
        names.sort();
        names
    }

    #[test]
    fn new_result_replaces_only_the_old_result() {
        let dir = tempfile::tempdir().unwrap();
        for (name, text) in [
            ("trajectory.txt", "old"),
            ("plot.svg", "old"),
            ("mine.txt", "mine"),
        ] {
            std::fs::write(dir.path().join(name), text).unwrap();
        }
        let mut r = ResultFolder::create(dir.path()).unwrap();
        r.write("trajectory.txt", b"new").unwrap();
        assert_eq!(
            std::fs::read(dir.path().join("trajectory.txt")).unwrap(),
            b"old"
        );
        r.commit().unwrap();
        assert_eq!(names(dir.path()), ["mine.txt", "trajectory.txt"]);
        assert_eq!(
            std::fs::read(dir.path().join("trajectory.txt")).unwrap(),
            b"new"
        );
    }

    #[test]
    fn leftovers_of_killed_processes_are_removed() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path();
        // Of a killed process, without a lock holder; of a running one; of another program.
        let dead = out.join(".unfinished--out-4000000000");
        drop(locked(&dead).unwrap());
        std::fs::write(dead.join("trajectory.txt"), "half").unwrap();
        let alive = out.join(".unfinished--masks-4000000001");
        let held = locked(&alive).unwrap();
        for name in [
            ".unfinished-mine",
            ".unfinished--out-x",
            ".unfinished--out-7",
        ] {
            std::fs::create_dir(out.join(name)).unwrap();
        }
        let folder = ResultFolder::create(out).unwrap();
        assert!(!dead.exists() && alive.exists());
        // Without a lock, and too young to be abandoned; older versions left folders without locks.
        assert!(out.join(".unfinished--out-7").exists());
        let old = File::open(out.join(".unfinished--out-7")).unwrap();
        let then = std::time::SystemTime::now() - 2 * ABANDONED;
        old.set_modified(then).unwrap();
        drop((folder, held));
        ResultFolder::create(out).unwrap();
        assert_eq!(names(out), [".unfinished--out-x", ".unfinished-mine"]);
    }

    #[test]
    fn abandoned_result_leaves_no_files() {
        let dir = tempfile::tempdir().unwrap();
        let mut r = ResultFolder::create(&dir.path().join("a/b")).unwrap();
        r.write("trajectory.txt", b"new").unwrap();
        drop(r);
        assert!(names(dir.path()).is_empty());
        std::fs::write(dir.path().join("trajectory.txt"), b"old").unwrap();
        let mut r = ResultFolder::create(dir.path()).unwrap();
        r.write("trajectory.txt", b"new").unwrap();
        drop(r);
        assert_eq!(names(dir.path()), ["trajectory.txt"]);
        assert_eq!(
            std::fs::read(dir.path().join("trajectory.txt")).unwrap(),
            b"old"
        );
    }

    #[test]
    fn streamed_file_replaces_the_old_one_when_complete() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("v.csv");
        std::fs::write(&path, "old").unwrap();
        let mut file = StreamedFile::create(&path, "--verdicts").unwrap();
        file.write(|w| w.write_all(b"half")).unwrap();
        drop(file);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["v.csv"]);
        let mut file = StreamedFile::create(&path, "--verdicts").unwrap();
        file.write(|w| w.write_all(b"new")).unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        file.finish().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(names(dir.path()), ["v.csv"]);
        for path in [dir.path(), &dir.path().join("no/v.csv"), Path::new("..")] {
            let e = StreamedFile::create(path, "--verdicts").unwrap_err();
            assert!(e.to_string().contains("another with --verdicts"), "{e}");
        }
    }

    /// A device is written to and not replaced; `/dev/full` is always full.
    #[test]
    #[cfg(target_os = "linux")]
    fn full_device_is_reported() {
        let mut file = StreamedFile::create(Path::new("/dev/full"), "--verdicts").unwrap();
        file.write(|w| w.write_all(b"row")).unwrap();
        let e = file.finish().unwrap_err().to_string();
        assert!(e.contains("/dev/full: expected to write it"), "{e}");
        assert!(!Path::new("/dev/full").is_file());
    }

    #[test]
    fn file_is_refused_as_result_folder() {
        let file = tempfile::NamedTempFile::new().unwrap();
        let e = ResultFolder::create(file.path()).unwrap_err().to_string();
        assert!(e.contains("found a file"), "{e}");
        let e = ResultFolder::create(&file.path().join("sub")).unwrap_err();
        assert!(e.to_string().contains("expected to write"), "{e}");
    }
}
