//! Whole files, or none.
//!
//! A file is written under another name in the same folder, brought to the disk, and only then takes its place, by one
//! renaming. Whoever reads it finds the old one or the new one, whatever happens in between: an error, a full disk, a killed
//! process, a loss of power.

use crate::error::{DatasetError, Result};
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// Writes a file as a whole: into a temporary file in the same folder, which then takes the place of `path`. When
/// anything fails, what was at `path` before is untouched and the temporary file is gone. See [`AtomicFile`].
///
/// # Errors
/// [`DatasetError::Write`] with the system's reason (no such folder, not writable, disk full).
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    let written = AtomicFile::create(path).and_then(|mut file| {
        file.write_all(bytes)?;
        file.commit()
    });
    written.map_err(|source| DatasetError::Write {
        path: path.to_owned(),
        source,
    })
}

/// A file in the making, for what is written bit by bit. [`AtomicFile::commit`] puts it where it belongs; dropping it without
/// that leaves what was there before.
///
/// Where `path` is a link, the file that it leads to is replaced. Devices and pipes cannot be replaced and are written to
/// directly. A file that is write-protected is not replaced, and one that is keeps its permissions.
///
/// A process that is killed leaves its temporary file behind, hidden; the next that writes the same file removes it. A
/// file that is still being written is locked, and the lock ends with its process.
#[derive(Debug)]
pub struct AtomicFile {
    file: File,
    target: PathBuf,
    /// `None` for devices and pipes, and when it has become the target.
    temporary: Option<PathBuf>,
}

impl AtomicFile {
    /// Begins a file, as far as that can be done without touching what is at `path`. So a folder that is missing or cannot
    /// be written to is known before the work whose result is to be written.
    ///
    /// # Errors
    /// The system's: no such folder, not writable, a folder at `path`.
    pub fn create(path: &Path) -> io::Result<Self> {
        // Where a link leads: it must not be replaced by a file.
        let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let old = target.metadata().ok();
        if old.as_ref().is_some_and(|m| m.is_dir()) {
            return Err(ErrorKind::IsADirectory.into());
        }
        if old.as_ref().is_some_and(|m| !m.is_file()) {
            return Ok(Self {
                file: OpenOptions::new().write(true).open(&target)?,
                target,
                temporary: None,
            });
        }
        let old = old.map(|m| m.permissions());
        if old.as_ref().is_some_and(|p| p.readonly()) {
            return Err(io::Error::new(
                ErrorKind::PermissionDenied,
                "the file that is there is write-protected",
            ));
        }
        remove_stale(&target)?;
        let (file, temporary) = create_temporary(&target)?;
        let file = Self {
            file,
            target,
            temporary: Some(temporary),
        };
        if let Some(old) = old {
            // Of someone else's file they cannot always be kept.
            let _ = file.file.set_permissions(old);
        }
        Ok(file)
    }

    /// Brings everything to the disk and puts the file where it belongs.
    ///
    /// # Errors
    /// The system's; what was there before is then untouched.
    pub fn commit(mut self) -> io::Result<()> {
        let Some(temporary) = &self.temporary else {
            // Not every device can be asked to bring what it has anywhere.
            return self.file.flush();
        };
        // A full disk may show only here.
        self.file.sync_all()?;
        std::fs::rename(temporary, &self.target)?;
        self.temporary = None;
        // The new file is whole and in its place; this makes that last through a loss of power. Where a folder cannot be
        // opened for it (Windows), the file system sees to it.
        if let Some(folder) = folder(&self.target)
            && let Ok(folder) = File::open(folder)
        {
            let _ = folder.sync_all();
        }
        Ok(())
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file.write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file.flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file.seek(to)
    }
}

impl Drop for AtomicFile {
    fn drop(&mut self) {
        if let Some(temporary) = &self.temporary {
            // Nothing can be done about a failure here; the next that writes this file tries again.
            let _ = std::fs::remove_file(temporary);
        }
    }
}

/// The folder that a file is in.
fn folder(path: &Path) -> Option<&Path> {
    let folder = path.parent()?;
    Some(if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    })
}

/// How the names of temporary files begin and end; hidden, and in the folder of the file itself, so that renaming does not
/// cross file systems.
fn temporary_name(target: &Path) -> io::Result<(String, &'static str)> {
    let Some(name) = target.file_name() else {
        return Err(io::Error::new(
            ErrorKind::InvalidInput,
            "the path names no file",
        ));
    };
    // Names may have 255 bytes, temporary ones too.
    let name: String = name.to_string_lossy().chars().take(50).collect();
    Ok((format!(".{name}."), ".tmp"))
}

/// A new file under a name that no one else uses, locked until it is closed.
fn create_temporary(target: &Path) -> io::Result<(File, PathBuf)> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let (begin, end) = temporary_name(target)?;
    loop {
        // The process id keeps two programs apart, the count two threads.
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = target.with_file_name(format!("{begin}{}-{count}{end}", std::process::id()));
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => {
                // Not every file system has locks; there, no temporary file is ever taken for a stale one.
                let _ = file.lock();
                // Between the two, another process may have taken it for one.
                if path.exists() {
                    return Ok((file, path));
                }
            }
            // Of a process of the same number, elsewhere in a network or in a container.
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
        }
    }
}

/// Whether a name between beginning and end is one that [`create_temporary`] gives, as no one else does: what a user calls
/// `.NAME.mine.tmp` is not ours to remove.
fn is_process_and_count(middle: &str) -> bool {
    let is_number = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    middle
        .split_once('-')
        .is_some_and(|(process, count)| is_number(process) && is_number(count))
}

/// Removes temporary files of this target whose processes have come to an end. What cannot be listed or removed does no harm.
fn remove_stale(target: &Path) -> io::Result<()> {
    let (begin, end) = temporary_name(target)?;
    let entries = folder(target).and_then(|f| std::fs::read_dir(f).ok());
    for entry in entries.into_iter().flatten().flatten() {
        let name = entry.file_name();
        let is_temporary = name
            .to_str()
            .and_then(|n| n.strip_prefix(&begin)?.strip_suffix(end))
            .is_some_and(is_process_and_count);
        if !is_temporary {
            continue;
        }
        let Ok(file) = OpenOptions::new().write(true).open(entry.path()) else {
            continue;
        };
        match file.try_lock() {
            // Removed before the lock ends, so that whoever waits for it sees that the file is gone.
            Ok(()) => drop(std::fs::remove_file(entry.path())),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => {}
        }
    }
    Ok(())
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
    fn replaces_the_old_file_and_leaves_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        for name in [
            "a.txt",
            "x".repeat(250).as_str(),
            "\u{e4}".repeat(120).as_str(),
        ] {
            let path = dir.path().join(name);
            write_atomic(&path, b"one").unwrap();
            write_atomic(&path, b"two").unwrap();
            assert_eq!(std::fs::read(&path).unwrap(), b"two");
        }
        assert_eq!(names(dir.path()).len(), 3);
    }

    #[test]
    fn a_failure_leaves_the_target_alone() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("folder");
        std::fs::create_dir_all(target.join("full")).unwrap();
        let e = write_atomic(&target, b"x").unwrap_err();
        assert!(e.to_string().contains("folder"), "{e}");
        assert_eq!(names(dir.path()), ["folder"]);
        assert!(write_atomic(&dir.path().join("no/such.txt"), b"x").is_err());
        for path in ["/", "..", ""] {
            assert!(write_atomic(Path::new(path), b"x").is_err(), "{path:?}");
        }
    }

    #[test]
    fn what_is_not_finished_leaves_the_old_file() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        std::fs::write(&path, "old").unwrap();
        // The disk is full after three bytes.
        let full = |mut file: AtomicFile| {
            file.write_all(b"new")?;
            Err::<(), _>(io::Error::from(ErrorKind::StorageFull))
        };
        let e = AtomicFile::create(&path).and_then(full).unwrap_err();
        assert_eq!(e.kind(), ErrorKind::StorageFull);
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        assert_eq!(names(dir.path()), ["a.txt"]);
    }

    /// A device is written to and not replaced; this one is always full.
    #[test]
    #[cfg(target_os = "linux")]
    fn a_full_device_is_reported() {
        let e = write_atomic(Path::new("/dev/full"), b"x").unwrap_err();
        assert!(e.to_string().contains("/dev/full"), "{e}");
        assert!(!Path::new("/dev/full").is_file());
        write_atomic(Path::new("/dev/null"), b"x").unwrap();
    }

    #[test]
    fn temporaries_of_those_who_died_are_removed_and_those_in_use_are_not() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        for stale in [
            ".a.txt.7-0.tmp",
            ".a.txt.7-1.tmp",
            ".b.txt.7-0.tmp",
            ".a.txt",
        ] {
            std::fs::write(dir.path().join(stale), "half").unwrap();
        }
        let of_the_user = [
            ".a.txt.-.tmp",
            ".a.txt.7-0-1.tmp",
            ".a.txt.7-x.tmp",
            ".a.txt.7.tmp",
            ".a.txt.mine.tmp",
            ".a.txt.tmp",
        ];
        for name in of_the_user {
            std::fs::write(dir.path().join(name), "mine").unwrap();
        }
        let mut first = AtomicFile::create(&path).unwrap();
        let mut second = AtomicFile::create(&path).unwrap();
        first.write_all(b"first").unwrap();
        second.write_all(b"second").unwrap();
        second.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"second");
        first.commit().unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"first");
        let others = [".a.txt", ".b.txt.7-0.tmp", "a.txt"];
        let mut left = [&of_the_user[..], &others].concat();
        left.sort_unstable();
        assert_eq!(names(dir.path()), left);
    }

    #[test]
    #[cfg(unix)]
    fn links_and_permissions_stay() {
        use std::os::unix::fs::PermissionsExt;
        let dir = tempfile::tempdir().unwrap();
        let (path, link) = (dir.path().join("a.txt"), dir.path().join("link"));
        std::fs::write(&path, "old").unwrap();
        let mode = |mode| std::fs::set_permissions(&path, PermissionsExt::from_mode(mode));
        mode(0o600).unwrap();
        std::os::unix::fs::symlink(&path, &link).unwrap();
        write_atomic(&link, b"new").unwrap();
        assert!(link.is_symlink());
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        let kept = path.metadata().unwrap().permissions().mode();
        assert_eq!(kept & 0o777, 0o600);
        // Whoever may do everything may not do this by accident.
        mode(0o444).unwrap();
        let e = write_atomic(&path, b"newer").unwrap_err().to_string();
        assert!(e.contains("write-protected"), "{e}");
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(names(dir.path()), ["a.txt", "link"]);
    }
}
