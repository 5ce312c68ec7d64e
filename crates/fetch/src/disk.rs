//! The disk to write to; tests replace it by a full one.

use std::fs::{File, OpenOptions};
use std::io::{Result, Write};
use std::path::Path;

/// File operations of a download.
pub trait Disk {
    /// Opens a file for appending, and creates it if missing.
    ///
    /// # Errors
    /// Those of the system.
    fn append(&self, path: &Path) -> Result<Box<dyn Write>>;

    /// Creates a new file.
    ///
    /// # Errors
    /// Those of the system.
    fn create(&self, path: &Path) -> Result<Box<dyn Write>>;

    /// Free bytes on the disk of a folder, if the system reports them.
    fn free(&self, folder: &Path) -> Option<u64>;
}

/// The real disk.
#[derive(Clone, Copy, Debug, Default)]
pub struct RealDisk;

impl Disk for RealDisk {
    fn append(&self, path: &Path) -> Result<Box<dyn Write>> {
        let file = OpenOptions::new().create(true).append(true).open(path)?;
        Ok(Box::new(file))
    }

    fn create(&self, path: &Path) -> Result<Box<dyn Write>> {
        Ok(Box::new(File::create_new(path)?))
    }

    #[cfg(unix)]
    fn free(&self, folder: &Path) -> Option<u64> {
        let disk = rustix::fs::statvfs(folder).ok()?;
        Some(disk.f_bavail.saturating_mul(disk.f_frsize))
    }

    #[cfg(not(unix))]
    fn free(&self, _folder: &Path) -> Option<u64> {
        None
    }
}

/// Syncs all files below a folder to disk, before it gets its final name.
#[cfg(target_os = "linux")]
pub(crate) fn settle(folder: &Path) -> Result<()> {
    Ok(rustix::fs::syncfs(File::open(folder)?)?)
}

/// Other systems have no call for all files at once.
#[cfg(not(target_os = "linux"))]
pub(crate) fn settle(_folder: &Path) -> Result<()> {
    Ok(())
}
