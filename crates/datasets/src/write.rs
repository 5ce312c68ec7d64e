//! Whole files, or none.

use crate::error::{DatasetError, Result};
use std::io::Write;
use std::path::{Path, PathBuf};

/// Writes a file as a whole: into a temporary file in the same folder, which then takes the place of `path`. When
/// anything fails, what was at `path` before is untouched and the temporary file is gone.
///
/// # Errors
/// [`DatasetError::Write`] with the system's reason (no such folder, not writable, disk full).
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    let fail = |source| DatasetError::Write {
        path: path.to_owned(),
        source,
    };
    let temporary = temporary_beside(path).ok_or_else(|| {
        fail(std::io::Error::new(
            std::io::ErrorKind::InvalidInput,
            "the path names no file",
        ))
    })?;
    let written = std::fs::File::create(&temporary).and_then(|mut file| {
        file.write_all(bytes)?;
        // A full disk may show only here.
        file.sync_all()
    });
    written
        .and_then(|()| std::fs::rename(&temporary, path))
        .map_err(|source| {
            // The first error is the one that matters; a temporary file that was never made cannot be removed.
            let _ = std::fs::remove_file(&temporary);
            fail(source)
        })
}

/// A hidden name in the same folder, so that renaming does not cross file systems; the process id keeps two programs
/// apart that write the same file.
fn temporary_beside(path: &Path) -> Option<PathBuf> {
    let name = path.file_name()?.to_string_lossy();
    Some(path.with_file_name(format!(".{name}.{}.tmp", std::process::id())))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn replaces_the_old_file_and_leaves_nothing_else() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.txt");
        write_atomic(&path, b"one").unwrap();
        write_atomic(&path, b"two").unwrap();
        assert_eq!(std::fs::read(&path).unwrap(), b"two");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
    }

    #[test]
    fn a_failure_leaves_the_target_alone() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("folder");
        std::fs::create_dir_all(target.join("full")).unwrap();
        let e = write_atomic(&target, b"x").unwrap_err();
        assert!(e.to_string().contains("folder"), "{e}");
        assert_eq!(std::fs::read_dir(dir.path()).unwrap().count(), 1);
        assert!(write_atomic(&dir.path().join("no/such.txt"), b"x").is_err());
        assert!(write_atomic(Path::new("/"), b"x").is_err());
    }
}
