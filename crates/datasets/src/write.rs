//! Atomic writes with this crate's errors, by the crate `files`.

use crate::error::{DatasetError, Result};
use std::path::Path;

/// Writes a file atomically, see [`stillpoint_files::write_atomic`].
///
/// # Errors
/// [`DatasetError::Write`] with the system's reason (missing folder, not writable, disk full).
pub fn write_atomic(path: &Path, bytes: &[u8]) -> Result<()> {
    stillpoint_files::write_atomic(path, bytes).map_err(|source| DatasetError::Write {
        path: path.to_owned(),
        source,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn unwritable_target_is_reported() {
        let dir = tempfile::tempdir().unwrap();
        let target = dir.path().join("folder");
        std::fs::create_dir(&target).unwrap();
        let e = write_atomic(&target, b"x").unwrap_err();
        assert!(e.to_string().contains("folder"), "{e}");
    }

    /// `/dev/full` is always full.
    #[test]
    #[cfg(target_os = "linux")]
    fn full_device_is_reported() {
        let e = write_atomic(Path::new("/dev/full"), b"x").unwrap_err();
        assert!(e.to_string().contains("/dev/full"), "{e}");
    }
}
