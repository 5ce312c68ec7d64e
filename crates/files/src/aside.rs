//! A file in the making, beside the place that it will take.

use std::fs::{File, OpenOptions, TryLockError};
use std::io::{self, ErrorKind, Write};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU64, Ordering};

/// A file under a name that no one else uses, in the folder of its final place, locked until it is closed. Dropping it removes it.
///
/// A process that is killed leaves it behind, hidden; the next that begins a file for the same place removes it. A file that is still being written is locked, and the lock ends with
/// its process.
#[derive(Debug)]
pub struct Aside {
    pub(crate) file: File,
    /// `None` once it has moved.
    path: Option<PathBuf>,
}

impl Aside {
    /// Begins a file that is to take this place, of which nothing is touched.
    ///
    /// # Errors
    /// The system's: no such folder, not writable; a path that names no file.
    pub fn of(target: &Path) -> io::Result<Self> {
        remove_stale(target)?;
        let (file, path) = create(target)?;
        let path = Some(path);
        Ok(Self { file, path })
    }

    /// A file with these bytes, on the disk.
    ///
    /// # Errors
    /// As for [`Aside::of`]; a full disk.
    pub fn with(target: &Path, bytes: &[u8]) -> io::Result<Self> {
        let mut aside = Self::of(target)?;
        aside.file.write_all(bytes)?;
        aside.file.sync_all()?;
        Ok(aside)
    }

    /// Brings everything to the disk and renames the file. A link at its place is replaced, not what it leads to. That the new name is on the disk, too, is [`sync_folder`]'s business.
    ///
    /// # Errors
    /// The system's; what was there before is then untouched.
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
            // Nothing can be done about a failure here; the next that writes this file tries again.
            let _ = std::fs::remove_file(path);
        }
    }
}

/// Makes renamings in a folder last through a loss of power. Where a folder cannot be opened for it (Windows), the file system sees to it.
pub fn sync_folder(folder: &Path) {
    if let Ok(folder) = File::open(folder) {
        let _ = folder.sync_all();
    }
}

/// The folder that a file is in.
pub(crate) fn folder(path: &Path) -> Option<&Path> {
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
fn create(target: &Path) -> io::Result<(File, PathBuf)> {
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

/// Whether a name between beginning and end is one that [`create`] gives, as no one else does: what a user calls
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
            // Removed before the lock ends, so that who waits for it sees that the file is gone.
            Ok(()) => drop(std::fs::remove_file(entry.path())),
            Err(TryLockError::WouldBlock | TryLockError::Error(_)) => {}
        }
    }
    Ok(())
}
