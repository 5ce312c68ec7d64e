//! A temporary file beside its final path.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A file under a unique name in the folder of its final path, locked until it is closed. Dropping it removes it.
///
/// A killed process leaves it behind, hidden; the next one that begins a file for the same path removes it. A file still being written is
/// locked, and the lock ends with its process.
#[derive(Debug)]
pub struct Aside {
    pub(crate) file: File,
    /// `None` after the renaming.
    path: Option<PathBuf>,
}

impl Aside {
    /// Creates a temporary file for this path, without touching the path.
    ///
    /// # Errors
    /// Of the system: no such folder, not writable; a path without a file name.
    pub fn of(target: &Path) -> io::Result<Self> {
        remove_stale(target)?;
        let (file, path) = create(target)?;
        let path = Some(path);
        Ok(Self { file, path })
    }

    /// A file with these bytes, synced to disk.
    ///
    /// # Errors
    /// As for [`Aside::of`]; a full disk.
    pub fn with(target: &Path, bytes: &[u8]) -> io::Result<Self> {
        let mut aside = Self::of(target)?;
        aside.file.write_all(bytes)?;
        aside.file.sync_all()?;
        Ok(aside)
    }

    /// Syncs the file to disk and renames it. A link at the path is replaced, not its target. [`sync_folder`] syncs the new name.
    ///
    /// # Errors
    /// Of the system; the previous file is then unchanged.
    pub fn take_place(mut self, target: &Path) -> io::Result<()> {
        // A full disk may show only here.
        self.file.sync_all()?;
        if let Some(path) = &self.path {
            std::fs::rename(path, target)?;
        }
        self.path = None;
        Ok(())
    }
}

impl Drop for Aside {
    fn drop(&mut self) {
        if let Some(path) = &self.path {
            // A failure here is ignored; the next process that writes this file tries again.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Makes renamings in a folder survive a loss of power. If folders cannot be opened for this (Windows), the file system ensures it.
pub fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

pub(crate) fn folder(path: &Path) -> Option<&Path> {
    let folder = path.parent()?;
    Some(if folder.as_os_str().is_empty() {
        Path::new(".")
    } else {
        folder
    })
}

/// Beginning and end of temporary file names; hidden, and in the folder of the file itself, so that renaming does not cross file systems.
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

/// A new file under a unique name, locked until it is closed.
fn create(target: &Path) -> io::Result<(File, PathBuf)> {
    static COUNT: AtomicU64 = AtomicU64::new(0);
    let (begin, end) = temporary_name(target)?;
    loop {
        // The process id distinguishes programs, the count threads.
        let count = COUNT.fetch_add(1, Ordering::Relaxed);
        let path = target.with_file_name(format!("{begin}{}-{count}{end}", std::process::id()));
        match OpenOptions::new().write(true).create_new(true).open(&path) {
            Ok(file) => {
                // Not every file system has locks; without them, temporary files are never removed as stale.
                let _ = file.lock();
                // Before the lock, another process may have removed it as stale.
                if path.exists() {
                    return Ok((file, path));
                }
            }
            // Of a process with the same id, elsewhere in a network or in a container.
            Err(e) if e.kind() == ErrorKind::AlreadyExists => {}
            Err(e) => return Err(e),
        }
    }
}

/// Whether the middle of a name is one of [`create`]: a user's own `.NAME.mine.tmp` must not be removed.
fn is_process_and_count(middle: &str) -> bool {
    let is_number = |s: &str| !s.is_empty() && s.bytes().all(|b| b.is_ascii_digit());
    middle
        .split_once('-')
        .is_some_and(|(process, count)| is_number(process) && is_number(count))
}

/// Removes temporary files of this target whose processes have ended. Failures to list or remove are harmless.
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
            // Removed before the lock ends, so that waiting processes see that the file is gone.
            Ok(()) => drop(std::fs::remove_file(entry.path())),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => {}
        }
    }
    Ok(())
}
