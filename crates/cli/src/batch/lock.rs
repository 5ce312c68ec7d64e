//! Allows one batch per folder, by a locked file. The system unlocks it when the process ends, however that happens.

use crate::console;
use crate::failure::Failure;
use std::fs::{File, OpenOptions, TryLockError};
use std::io::{Read, Seek, Write};
use std::path::Path;

const FILE: &str = ".batch.lock";

#[derive(Debug)]
pub(crate) struct Lock {
    _file: File,
}

impl Lock {
    /// Creates the folder if it is missing, and locks it.
    ///
    /// # Errors
    /// A folder that is not writable, or is locked by another batch.
    pub(crate) fn take(out: &Path) -> Result<Self, Failure> {
        let path = out.join(FILE);
        let failure = |e: std::io::Error| Failure::write(out, &e);
        if out.exists() && !out.is_dir() {
            return Err(Failure::input(format!(
                "{}: expected a folder to write to, found a file; name another with --out",
                out.display()
            )));
        }
        std::fs::create_dir_all(out).map_err(failure)?;
        // Not truncated before the lock is held: the contents may belong to another process.
        let mut file = OpenOptions::new()
            .create(true)
            .truncate(false)
            .read(true)
            .write(true)
            .open(&path)
            .map_err(failure)?;
        match file.try_lock() {
            Ok(()) => {}
            Err(TryLockError::WouldBlock) => return Err(taken(out, &mut file)),
            // Some network file systems have no locks.
            Err(TryLockError::Error(e)) => console::warn(&format!(
                "{}: its file system has no locks ({e}): see to it that no other batch works there",
                out.display()
            )),
        }
        file.set_len(0)
            .and_then(|()| file.rewind())
            .and_then(|()| write!(file, "{}", std::process::id()))
            .and_then(|()| file.flush())
            .map_err(failure)?;
        Ok(Self { _file: file })
    }
}

/// Error: the folder is locked by another batch.
fn taken(out: &Path, file: &mut File) -> Failure {
    let mut process = String::new();
    // On Windows a locked file cannot be read.
    let _ = file.read_to_string(&mut process);
    let process = match process.trim() {
        "" => "another process".to_owned(),
        id => format!("process {id}"),
    };
    Failure::input(format!(
        "{}: expected a folder in which no batch is at work, found that of {process}; wait for its end, or name another folder with --out (shards have one each)",
        out.display()
    ))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn folder_allows_one_batch_at_a_time() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("a/b");
        let first = Lock::take(&out).unwrap();
        let e = Lock::take(&out).unwrap_err().to_string();
        let process = format!("process {}", std::process::id());
        assert!(cfg!(windows) || e.contains(&process), "{e}");
        drop(first);
        Lock::take(&out).unwrap();
        let file = dir.path().join("file");
        std::fs::write(&file, "").unwrap();
        let e = Lock::take(&file).unwrap_err().to_string();
        assert!(e.contains("found a file"), "{e}");
    }
}
