//! Archives for tests, and their installation.

use flate2::Compression;
use flate2::write::GzEncoder;
use std::io::{Cursor, Write};
use std::net::TcpStream;
use std::ops::ControlFlow;
use std::path::{Path, PathBuf};
use stillpoint_fetch::archive::{Archive, ArchiveError, Packing, Pulled, pull};
use stillpoint_fetch::{Disk, Progress, RealDisk, Waits};
use stillpoint_testdata::server::{Request, Server};
use tar::EntryType;
use tempfile::TempDir;
use zip::write::SimpleFileOptions;

/// A tar entry with any name and kind.
pub(crate) fn entry(name: &str, kind: EntryType, data: &[u8]) -> Vec<u8> {
    let mut header = tar::Header::new_gnu();
    header.as_old_mut().name[..name.len()].copy_from_slice(name.as_bytes());
    header.set_entry_type(kind);
    header.set_size(data.len() as u64);
    header.set_mode(0o644);
    if kind.is_symlink() || kind.is_hard_link() {
        header.as_old_mut().linkname[..6].copy_from_slice(b"../../");
    }
    header.set_cksum();
    let mut bytes = header.as_bytes().to_vec();
    bytes.extend(data);
    bytes.resize(bytes.len().next_multiple_of(512), 0);
    bytes
}

pub(crate) fn file(name: &str, data: &[u8]) -> Vec<u8> {
    entry(name, EntryType::Regular, data)
}

pub(crate) fn gzip(bytes: &[u8]) -> Vec<u8> {
    let mut packed = GzEncoder::new(Vec::new(), Compression::fast());
    packed.write_all(bytes).unwrap();
    packed.finish().unwrap()
}

/// A tar of these entries in gzip, with its end.
pub(crate) fn tgz(entries: &[Vec<u8>]) -> Vec<u8> {
    gzip(&[entries.concat(), vec![0; 1024]].concat())
}

pub(crate) fn zipped(files: &[(&str, &[u8])]) -> Vec<u8> {
    let mut zip = zip::ZipWriter::new(Cursor::new(Vec::new()));
    for (name, data) in files {
        zip.start_file(*name, SimpleFileOptions::default()).unwrap();
        zip.write_all(data).unwrap();
    }
    zip.finish().unwrap().into_inner()
}

pub(crate) fn image() -> &'static [u8] {
    stillpoint_testdata::server::made_up_bytes()
}

pub(crate) fn sequence() -> Vec<u8> {
    tgz(&[
        entry("walk/", EntryType::Directory, b""),
        file("walk/rgb.txt", b"1.0 rgb/1.png\n"),
        file("walk/rgb/1.png", image()),
        file("./walk/empty.txt", b""),
    ])
}

pub(crate) struct Place {
    dir: TempDir,
}

impl Place {
    pub(crate) fn new() -> Self {
        Self {
            dir: tempfile::tempdir().unwrap(),
        }
    }

    /// A folder that does not exist yet.
    pub(crate) fn path(&self) -> PathBuf {
        self.dir.path().join("data")
    }

    pub(crate) fn pull(&self, server: &Server, packing: Packing) -> Result<Pulled, ArchiveError> {
        self.pull_to(server, packing, &RealDisk)
    }

    pub(crate) fn pull_to(
        &self,
        server: &Server,
        packing: Packing,
        disk: &dyn Disk,
    ) -> Result<Pulled, ArchiveError> {
        self.watched(server, packing, disk, &mut |_| ControlFlow::Continue(()))
    }

    pub(crate) fn watched(
        &self,
        server: &Server,
        packing: Packing,
        disk: &dyn Disk,
        watch: &mut dyn FnMut(Progress) -> ControlFlow<()>,
    ) -> Result<Pulled, ArchiveError> {
        let archive = Archive {
            address: &format!("{}/made/walk.bin", server.base),
            file: "walk.bin",
            folder: "rgbd_walk",
            holds: "rgb.txt",
            packing,
            sha256: None,
            waits: Waits::default(),
        };
        pull(&archive, &self.path(), disk, watch)
    }

    /// Names of the files there except locks, sorted.
    pub(crate) fn names(&self) -> Vec<String> {
        names(&self.path())
    }

    /// Asserts that the complete sequence is there, with its checksum and nothing else.
    pub(crate) fn assert_whole(&self) {
        let folder = self.path().join("rgbd_walk");
        assert_eq!(std::fs::read(folder.join("rgb/1.png")).unwrap(), image());
        assert_eq!(std::fs::read(folder.join("empty.txt")).unwrap(), b"");
        assert_eq!(names(&folder), ["empty.txt", "rgb", "rgb.txt"]);
        assert_eq!(self.names(), ["rgbd_walk", "walk.bin.sha256"]);
    }
}

fn names(folder: &Path) -> Vec<String> {
    let entries = std::fs::read_dir(folder).into_iter().flatten();
    let mut names: Vec<String> = entries
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.ends_with(".lock"))
        .collect();
    names.sort();
    names
}

/// The error of a refused archive; nothing of it may remain.
pub(crate) fn refused(bytes: Vec<u8>, packing: Packing) -> String {
    let (place, server) = (Place::new(), Server::of(bytes.leak()));
    let e = place.pull(&server, packing).unwrap_err();
    assert!(matches!(e, ArchiveError::Unusable { .. }), "{e}");
    assert_eq!(place.names(), [""; 0]);
    let outside: Vec<_> = std::fs::read_dir(place.dir.path()).unwrap().collect();
    assert_eq!(outside.len(), 1, "{outside:?}");
    let said = e.to_string();
    assert!(!said.contains('\n'), "{said}");
    said
}

/// A disk with limited space in created files, and a stated amount of free space.
pub(crate) struct SmallDisk {
    pub(crate) room: usize,
    pub(crate) free: Option<u64>,
}

impl Disk for SmallDisk {
    fn append(&self, path: &Path) -> std::io::Result<Box<dyn Write>> {
        RealDisk.append(path)
    }

    fn create(&self, path: &Path) -> std::io::Result<Box<dyn Write>> {
        let (file, room) = (RealDisk.create(path)?, self.room);
        Ok(Box::new(SmallFile { file, room }))
    }

    fn free(&self, _folder: &Path) -> Option<u64> {
        self.free
    }
}

struct SmallFile {
    file: Box<dyn Write>,
    room: usize,
}

impl Write for SmallFile {
    fn write(&mut self, bytes: &[u8]) -> std::io::Result<usize> {
        match bytes.len().min(self.room) {
            0 => Err(std::io::ErrorKind::StorageFull.into()),
            fits => {
                self.room -= fits;
                self.file.write_all(&bytes[..fits]).map(|()| fits)
            }
        }
    }

    fn flush(&mut self) -> std::io::Result<()> {
        self.file.flush()
    }
}

/// A server with another response the first time.
pub(crate) fn at_first(
    first: impl Fn(&Request, &mut TcpStream) + Send + Sync + 'static,
    then: impl Fn(&Request, &mut TcpStream) + Send + Sync + 'static,
) -> Server {
    Server::start(move |number, request, stream| match number {
        0 => first(request, stream),
        _ => then(request, stream),
    })
}
