//! Temporary files for formats that cannot be read from memory.

use crate::error::{RecordingError, Result};
use std::fs::{File, OpenOptions};
use std::path::{Path, PathBuf};
use std::sync::atomic::{AtomicU32, Ordering};

/// A file in the temporary folder, removed on drop.
#[derive(Debug)]
pub(crate) struct Temporary {
    pub(crate) path: PathBuf,
}

static NEXT: AtomicU32 = AtomicU32::new(0);

impl Temporary {
    /// A new, empty file. `of` is the original file, for messages.
    pub(crate) fn create(of: &Path, ending: &str) -> Result<(Self, File)> {
        let number = NEXT.fetch_add(1, Ordering::Relaxed);
        let name = format!("stillpoint-{}-{number}{ending}", std::process::id());
        let path = std::env::temp_dir().join(name);
        let file = OpenOptions::new().write(true).create_new(true).open(&path);
        let file = file.map_err(|e| failed(of, &path, &e))?;
        Ok((Self { path }, file))
    }

    #[cfg(feature = "sqlite")]
    pub(crate) fn copy(of: &Path, to: PathBuf) -> Result<Self> {
        std::fs::copy(of, &to).map_err(|e| failed(of, &to, &e))?;
        Ok(Self { path: to })
    }
}

fn failed(of: &Path, path: &Path, e: &std::io::Error) -> RecordingError {
    let expected = format!("to write {}", path.display());
    RecordingError::format(
        of,
        &expected,
        e.to_string(),
        "free some space, or name another folder with TMPDIR",
    )
}

impl Drop for Temporary {
    fn drop(&mut self) {
        // On failure the system clears the temporary folder.
        let _ = std::fs::remove_file(&self.path);
    }
}
