//! Unpacks an archive into an empty folder: regular files and folders with plain names, within limits.
//!
//! Links, devices and names that lead elsewhere are refused. Times, owners and permissions are not restored.

use super::limits::{BETWEEN_FILES, Budget, parts};
use crate::disk::Disk;
use crate::one_line;
use flate2::read::MultiGzDecoder;
use std::cell::Cell;
use std::fs::File;
use std::io::{BufReader, Error, ErrorKind, Read, Write};
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use std::rc::Rc;
use zip::CompressionMethod;

#[derive(Debug)]
pub(crate) enum Fault {
    /// Problem of the archive, as part of a message.
    Archive(String),
    /// A file that could not be read or written.
    Disk(PathBuf, Error),
    /// The caller stopped it.
    Stopped,
}

/// Called with the number of processed bytes of the archive; it may stop the unpacking.
type Tell<'a> = &'a mut dyn FnMut(u64) -> ControlFlow<()>;

pub(crate) struct Unpack<'a> {
    into: &'a Path,
    packed: u64,
    disk: &'a dyn Disk,
    tell: Tell<'a>,
    budget: Budget,
}

impl<'a> Unpack<'a> {
    /// `packed`: bytes of the archive.
    pub(crate) fn new(into: &'a Path, packed: u64, disk: &'a dyn Disk, tell: Tell<'a>) -> Self {
        Self {
            into,
            packed,
            disk,
            tell,
            budget: Budget::of(packed),
        }
    }

    pub(crate) fn tar_gz(&mut self, file: File) -> Result<(), Fault> {
        let (done, allowed) = (Rc::new(Cell::new(0)), Rc::new(Cell::new(BETWEEN_FILES)));
        let packed = Counted {
            inner: file,
            count: done.clone(),
        };
        let mut archive = tar::Archive::new(Allowed {
            inner: MultiGzDecoder::new(BufReader::new(packed)),
            left: allowed.clone(),
        });
        for entry in archive.entries().map_err(damaged)? {
            let mut entry = entry.map_err(damaged)?;
            let name = String::from_utf8(entry.path_bytes().into_owned())
                .map_err(|_| Fault::Archive("a path that is not UTF-8".to_owned()))?;
            let kind = entry.header().entry_type();
            if kind.is_dir() {
                self.folder(&name)?;
            } else if kind.is_file() {
                let size = entry.size();
                self.budget.take(size).map_err(Fault::Archive)?;
                allowed.set(size + BETWEEN_FILES);
                let done = done.clone();
                self.file(&name, size, &mut entry, &move |_| done.get())?;
            } else if !kind.is_pax_global_extensions() {
                return Err(not_plain(&name));
            }
            // The next header follows, whatever its claimed length.
            allowed.set(BETWEEN_FILES);
        }
        // The checksum of gzip comes last.
        std::io::copy(&mut archive.into_inner(), &mut std::io::sink()).map_err(damaged)?;
        Ok(())
    }

    pub(crate) fn zip(&mut self, file: File) -> Result<(), Fault> {
        let refused = |e: zip::result::ZipError| Fault::Archive(one_line(&e.to_string()));
        let mut archive = zip::ZipArchive::new(BufReader::new(file)).map_err(refused)?;
        let mut done = 0;
        for index in 0..archive.len() {
            let entry = archive.by_index_raw(index).map_err(refused)?;
            let name = entry.name().map_err(refused)?.into_owned();
            let method = entry.compression();
            let (size, packed) = (entry.size(), entry.compressed_size());
            let is_folder = entry.is_dir();
            // Without a stated kind (0), as on Windows, it is a file.
            let kind = entry.unix_mode().map_or(0, |mode| mode & 0o170_000);
            let is_plain = match is_folder {
                true => [0, 0o040_000].contains(&kind),
                false => [0, 0o100_000].contains(&kind),
            };
            if !is_plain {
                return Err(not_plain(&name));
            }
            if entry.encrypted()
                || ![CompressionMethod::Stored, CompressionMethod::Deflated].contains(&method)
            {
                return Err(Fault::Archive(format!(
                    "an entry that is encrypted or packed in a way that is not in use ({:.80})",
                    name.escape_debug()
                )));
            }
            drop(entry);
            if is_folder {
                self.folder(&name)?;
                continue;
            }
            self.budget.take(size).map_err(Fault::Archive)?;
            let mut entry = archive.by_index(index).map_err(refused)?;
            let share = packed as f64 / size.max(1) as f64;
            let at = move |written: u64| done + (written as f64 * share) as u64;
            self.file(&name, size, &mut entry, &at)?;
            done += packed;
        }
        Ok(())
    }

    /// Creates a folder of the archive, unless it exists: archives list folders before and after their files, or not at all.
    fn folder(&mut self, name: &str) -> Result<(), Fault> {
        self.budget.take(0).map_err(Fault::Archive)?;
        let path = self.path(&parts(name).map_err(Fault::Archive)?);
        std::fs::create_dir_all(&path).map_err(|e| clash(name, path, e))
    }

    fn path(&self, parts: &[&str]) -> PathBuf {
        let mut path = self.into.to_owned();
        path.extend(parts);
        path
    }

    /// Writes a file of this many bytes. `done` maps the written bytes to processed bytes of the archive.
    fn file(
        &mut self,
        name: &str,
        size: u64,
        body: &mut dyn Read,
        done: &dyn Fn(u64) -> u64,
    ) -> Result<(), Fault> {
        let parts = parts(name).map_err(Fault::Archive)?;
        let Some((_, folders)) = parts.split_last() else {
            return Err(Fault::Archive("a file without a name".to_owned()));
        };
        let folder = self.path(folders);
        std::fs::create_dir_all(&folder).map_err(|e| clash(name, folder, e))?;
        let path = self.path(&parts);
        let created = self.disk.create(&path);
        let mut file = created.map_err(|e| clash(name, path.clone(), e))?;
        let mut written = 0;
        let mut buffer = vec![0; 1 << 16];
        loop {
            let n = match body.read(&mut buffer) {
                Ok(0) => break,
                Ok(n) => n,
                Err(e) if e.kind() == ErrorKind::Interrupted => continue,
                Err(e) => return Err(damaged(e)),
            };
            written += n as u64;
            if written > size {
                break;
            }
            file.write_all(&buffer[..n])
                .map_err(|e| Fault::Disk(path.clone(), e))?;
            if (self.tell)(done(written).min(self.packed)).is_break() {
                return Err(Fault::Stopped);
            }
        }
        if written != size {
            return Err(Fault::Archive(format!(
                "a file that is not as long as it says ({:.80})",
                name.escape_debug()
            )));
        }
        file.flush().map_err(|e| Fault::Disk(path, e))
    }
}

/// A complete archive that cannot be read to its end.
fn damaged(error: Error) -> Fault {
    Fault::Archive(format!("damage: {}", one_line(&error.to_string())))
}

fn not_plain(name: &str) -> Fault {
    Fault::Archive(format!("a link or device ({:.80})", name.escape_debug()))
}

/// Two entries of one name, or a file in place of a folder, are the archive's fault; all else is the disk's.
fn clash(name: &str, path: PathBuf, error: Error) -> Fault {
    match error.kind() {
        ErrorKind::AlreadyExists | ErrorKind::NotADirectory | ErrorKind::IsADirectory => {
            Fault::Archive(format!("a path twice ({:.80})", name.escape_debug()))
        }
        _ => Fault::Disk(path, error),
    }
}

struct Counted<R> {
    inner: R,
    count: Rc<Cell<u64>>,
}

impl<R: Read> Read for Counted<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(buffer)?;
        self.count.set(self.count.get() + n as u64);
        Ok(n)
    }
}

/// Yields this many bytes, and then an error. Archive readers load names of any claimed length into memory.
struct Allowed<R> {
    inner: R,
    left: Rc<Cell<u64>>,
}

impl<R: Read> Read for Allowed<R> {
    fn read(&mut self, buffer: &mut [u8]) -> std::io::Result<usize> {
        let n = self.inner.read(buffer)?;
        let left = self.left.get().checked_sub(n as u64);
        self.left
            .set(left.ok_or_else(|| Error::other("too much between two files"))?);
        Ok(n)
    }
}
