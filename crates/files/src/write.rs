//! Atomic writes.
//!
//! A file is written under another name in the same folder, synced to disk, and then renamed to its final path. Readers find the old or the
//! new file, whatever happens in between: an error, a full disk, a killed process, a loss of power.

use crate::aside::{Aside, folder, sync_folder};
use std::fs::{File, OpenOptions};
use std::io::{self, ErrorKind, Seek, SeekFrom, Write};
use std::path::{Path, PathBuf};

/// Writes a file atomically: into a temporary file in the same folder, which is then renamed to `path`. On failure, the previous file at
/// `path` is unchanged and the temporary file is removed. See [`AtomicFile`].
///
/// # Errors
/// Of the system (no such folder, not writable, disk full).
pub fn write_atomic(path: &Path, bytes: &[u8]) -> io::Result<()> {
    let mut file = AtomicFile::create(path)?;
    file.write_all(bytes)?;
    file.commit()
}

/// A file that is written in parts. [`AtomicFile::commit`] renames it to its path; dropping it without that keeps the previous file.
///
/// If `path` is a link, its target is replaced. Devices and pipes are written to directly. A write-protected file is not replaced; a
/// replaced one keeps its permissions.
///
/// The remains of a killed process are removed by the next process that writes the same file: see [`Aside`].
#[derive(Debug)]
pub struct AtomicFile {
    target: PathBuf,
    to: To,
}

#[derive(Debug)]
enum To {
    Aside(Aside),
    /// A device or a pipe.
    Device(File),
}

impl AtomicFile {
    /// Begins a file without touching `path`. A missing or write-protected folder is thus detected before the work whose result is to be
    /// written.
    ///
    /// # Errors
    /// Of the system: no such folder, not writable, a folder at `path`.
    pub fn create(path: &Path) -> io::Result<Self> {
        // The target of a link: the link must not be replaced by a file.
        let target = path.canonicalize().unwrap_or_else(|_| path.to_owned());
        let old = target.metadata().ok();
        if old.as_ref().is_some_and(|m| m.is_dir()) {
            return Err(ErrorKind::IsADirectory.into());
        }
        if old.as_ref().is_some_and(|m| !m.is_file()) {
            let device = OpenOptions::new().write(true).open(&target)?;
            let to = To::Device(device);
            return Ok(Self { target, to });
        }
        let old = old.map(|m| m.permissions());
        if old.as_ref().is_some_and(|p| p.readonly()) {
            return Err(io::Error::new(
                ErrorKind::PermissionDenied,
                "the file that is there is write-protected",
            ));
        }
        let aside = Aside::of(&target)?;
        if let Some(old) = old {
            // Permissions of another user's file cannot always be kept.
            let _ = aside.file.set_permissions(old);
        }
        let to = To::Aside(aside);
        Ok(Self { target, to })
    }

    /// Syncs the file to disk and renames it to its path.
    ///
    /// # Errors
    /// Of the system; the previous file is then unchanged.
    pub fn commit(self) -> io::Result<()> {
        match self.to {
            // Not every device can be synced.
            To::Device(mut device) => device.flush(),
            To::Aside(aside) => {
                aside.take_place(&self.target)?;
                if let Some(folder) = folder(&self.target) {
                    sync_folder(folder);
                }
                Ok(())
            }
        }
    }

    fn file(&mut self) -> &mut File {
        match &mut self.to {
            To::Aside(aside) => &mut aside.file,
            To::Device(device) => device,
        }
    }
}

impl Write for AtomicFile {
    fn write(&mut self, bytes: &[u8]) -> io::Result<usize> {
        self.file().write(bytes)
    }

    fn flush(&mut self) -> io::Result<()> {
        self.file().flush()
    }
}

impl Seek for AtomicFile {
    fn seek(&mut self, to: SeekFrom) -> io::Result<u64> {
        self.file().seek(to)
    }
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
    fn atomic_write_replaces_the_old_file_only() {
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
    fn failed_write_keeps_the_target() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("folder");
        std::fs::create_dir_all(target.join("full")).unwrap();
        let e = write_atomic(&target, b"x").unwrap_err();
        assert_eq!(e.kind(), ErrorKind::IsADirectory);
        assert_eq!(names(dir.path()), ["folder"]);
        assert!(write_atomic(&dir.path().join("no/such.txt"), b"x").is_err());
        for path in ["/", "..", ""] {
            assert!(write_atomic(Path::new(path), b"x").is_err(), "{path:?}");
        }
    }

    #[test]
    fn unfinished_write_keeps_the_old_file() {
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
    fn full_device_is_reported() {
        let e = write_atomic(Path::new("/dev/full"), b"x").unwrap_err();
        assert_eq!(e.kind(), ErrorKind::StorageFull);
        assert!(!Path::new("/dev/full").is_file());
        write_atomic(Path::new("/dev/null"), b"x").unwrap();
    }

    #[test]
    fn only_stale_temporary_files_are_removed() {
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
    fn links_and_permissions_are_preserved() {
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
        // Even a user with all rights must not do this by accident.
        mode(0o444).unwrap();
        let e = write_atomic(&path, b"newer").unwrap_err().to_string();
        assert!(e.contains("write-protected"), "{e}");
        assert_eq!(std::fs::read(&path).unwrap(), b"new");
        assert_eq!(names(dir.path()), ["a.txt", "link"]);
    }

    /// Several related files are all on disk before the first is renamed; each replaces a link itself.
    #[test]
    #[cfg(unix)]
    fn aside_file_changes_nothing_until_renamed() {
        let dir = tempfile::tempdir().unwrap();
        let [own, link, card] = ["own", "net.onnx", "net.toml"].map(|name| dir.path().join(name));
        std::fs::write(&own, "own").unwrap();
        std::os::unix::fs::symlink(&own, &link).unwrap();
        let network = Aside::with(&link, b"network").unwrap();
        drop(Aside::with(&card, b"card").unwrap());
        assert_eq!(std::fs::read(&link).unwrap(), b"own");
        network.take_place(&link).unwrap();
        assert!(!link.is_symlink());
        assert_eq!(std::fs::read(&link).unwrap(), b"network");
        assert_eq!(std::fs::read(&own).unwrap(), b"own");
        assert_eq!(names(dir.path()), ["net.onnx", "own"]);
    }
}
