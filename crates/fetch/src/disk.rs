//! Where files are written: the disk, or in tests one that is full.

use std::fs::{File, OpenOptions};
use std::io::{Result, Write};
use std::path::Path;

/// What is asked of a disk.
pub trait Disk {
    /// Opens a file to append to it, and makes it where it is missing.
    ///
    /// # Errors
    /// Those of the system.
    fn append(&self, path: &Path) -> Result<Box<dyn Write>>;

    /// Makes a file that is not there yet.
    ///
    /// # Errors
    /// Those of the system.
    fn create(&self, path: &Path) -> Result<Box<dyn Write>>;

    /// Free bytes on the disk of a folder, where the system says so.
    fn free(&self, folder: &Path) -> Option<u64>;
}

/// The disk.
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

/// Brings everything that was written below a folder to the disk, before its name says that it is whole.
#[cfg(target_os = "linux")]
pub(crate) fn settle(folder: &Path) -> Result<()> {
    Ok(rustix::fs::syncfs(File::open(folder)?)?)
}

/// Elsewhere there is no call for all files at once.
#[cfg(not(target_os = "linux"))]
pub(crate) fn settle(_folder: &Path) -> Result<()> {
    Ok(())
}
