//! Reads whole regular files of limited size. A device has no end, and a pipe without a writer blocks its reader forever.

use std::fs::{File, FileType, Metadata};
use std::io::{Error, Read, Result};
use std::path::Path;

/// The bytes of a regular file of at most `most` bytes.
///
/// # Errors
/// A system error, or a description of a pipe, device or larger file.
pub fn read_regular(path: &Path, most: u64) -> Result<Vec<u8>> {
    let metadata = std::fs::metadata(path)?;
    check_kind(&metadata)?;
    check_length(metadata.len(), most)?;
    let mut bytes = Vec::with_capacity(metadata.len() as usize);
    // It may grow while it is read.
    File::open(path)?.take(most + 1).read_to_end(&mut bytes)?;
    check_length(bytes.len() as u64, most)?;
    Ok(bytes)
}

/// The text of a regular file of at most `most` bytes.
///
/// # Errors
/// As [`read_regular`], and for invalid UTF-8.
pub fn read_regular_text(path: &Path, most: u64) -> Result<String> {
    String::from_utf8(read_regular(path, most)?).map_err(|e| Error::other(e.utf8_error()))
}

/// Opens a regular file, for incremental reading.
///
/// # Errors
/// A system error, or a description of a special file.
pub fn open_regular(path: &Path) -> Result<File> {
    check_kind(&std::fs::metadata(path)?)?;
    File::open(path)
}

fn check_kind(metadata: &Metadata) -> Result<()> {
    if metadata.is_file() {
        return Ok(());
    }
    if metadata.is_dir() {
        return Err(std::io::ErrorKind::IsADirectory.into());
    }
    let kind = special(metadata.file_type());
    Err(Error::other(format!(
        "{kind}, where a regular file is needed"
    )))
}

fn check_length(found: u64, most: u64) -> Result<()> {
    if found <= most {
        return Ok(());
    }
    let found = if found == most + 1 {
        "more".to_owned()
    } else {
        found.to_string()
    };
    Err(Error::other(format!(
        "{found} bytes, where at most {most} are read"
    )))
}

/// Name of a special file's type.
#[cfg(unix)]
fn special(kind: FileType) -> &'static str {
    use std::os::unix::fs::FileTypeExt;
    if kind.is_fifo() {
        "a pipe"
    } else if kind.is_socket() {
        "a socket"
    } else {
        "a device"
    }
}

#[cfg(not(unix))]
fn special(_: FileType) -> &'static str {
    "a device"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn files_are_read_up_to_their_limit() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("f");
        std::fs::write(&path, "12345").unwrap();
        assert_eq!(read_regular(&path, 5).unwrap(), b"12345");
        let e = read_regular(&path, 4).unwrap_err().to_string();
        assert!(e.contains("more bytes, where at most 4"), "{e}");
        // As large as a disk, but sparse.
        let file = File::create(&path).unwrap();
        file.set_len(1 << 40).unwrap();
        let e = read_regular(&path, 1 << 20).unwrap_err().to_string();
        assert!(e.contains("1099511627776 bytes"), "{e}");
        let e = read_regular(dir.path(), 4).unwrap_err();
        assert_eq!(e.kind(), std::io::ErrorKind::IsADirectory);
        let e = read_regular(&dir.path().join("none"), 4).unwrap_err();
        assert_eq!(e.kind(), std::io::ErrorKind::NotFound);
    }

    #[test]
    #[cfg(unix)]
    fn devices_and_sockets_are_refused() {
        let e = read_regular(Path::new("/dev/zero"), 9).unwrap_err();
        assert!(e.to_string().contains("a device"), "{e}");
        let dir = tempfile::tempdir().unwrap();
        let socket = dir.path().join("s");
        let _listener = std::os::unix::net::UnixListener::bind(&socket).unwrap();
        let e = open_regular(&socket).unwrap_err();
        assert!(e.to_string().contains("a socket"), "{e}");
    }
}
