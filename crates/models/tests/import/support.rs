//! Checkpoints for tests: the recorded ones, taken apart and reassembled.

use std::path::{Path, PathBuf};
use stillpoint_models::import::{ImportError, import_checkpoint};

/// Folder of the recorded checkpoints and of PyTorch's results for them; `make_checkpoint.py` there wrote them.
pub(crate) fn fixtures() -> PathBuf {
    Path::new(env!("CARGO_MANIFEST_DIR")).join("tests/fixtures")
}

pub(crate) fn fixture(name: &str) -> Vec<u8> {
    let path = fixtures().join(name);
    std::fs::read(&path).unwrap_or_else(|e| panic!("{}: {e}", path.display()))
}

/// An entry of an archive to be written.
#[derive(Clone, Debug)]
pub(crate) struct Entry {
    pub(crate) name: String,
    pub(crate) data: Vec<u8>,
}

impl Entry {
    pub(crate) fn new(name: &str, data: impl Into<Vec<u8>>) -> Self {
        Self {
            name: name.to_owned(),
            data: data.into(),
        }
    }
}

/// Possible faults of an archive; the defaults are correct.
#[derive(Clone, Copy, Debug, Default)]
pub(crate) struct Lies {
    /// Method 8 (deflate) for all entries.
    pub(crate) compressed: bool,
    /// Added to the sizes in the directory.
    pub(crate) larger: u32,
    /// All entries have the first one's content.
    pub(crate) overlapping: bool,
    /// Sizes of 64 bits, this large.
    pub(crate) huge: Option<u64>,
    /// Surplus of entries in the end record.
    pub(crate) more: u16,
}

pub(crate) fn zip(entries: &[Entry], lies: Lies) -> Vec<u8> {
    let (mut bytes, mut directory) = (Vec::new(), Vec::new());
    for (i, entry) in entries.iter().enumerate() {
        let method = if lies.compressed { 8_u16 } else { 0 };
        let crc = crc32fast::hash(&entry.data);
        let name = entry.name.as_bytes();
        let at = if lies.overlapping && i > 0 {
            0
        } else {
            bytes.len()
        };
        let length = entry.data.len() as u32;
        if at == bytes.len() {
            bytes.extend(b"PK\x03\x04\x14\0\0\0");
            bytes.extend(method.to_le_bytes());
            bytes.extend([0; 4]);
            for word in [crc, length, length] {
                bytes.extend(word.to_le_bytes());
            }
            bytes.extend((name.len() as u16).to_le_bytes());
            bytes.extend([0; 2]);
            bytes.extend(name);
            bytes.extend(&entry.data);
        }
        let stated = lies
            .huge
            .map_or(length.wrapping_add(lies.larger), |_| u32::MAX);
        let extra = lies.huge.map_or(Vec::new(), |huge| {
            let mut extra = vec![1, 0, 16, 0];
            extra.extend(huge.to_le_bytes());
            extra.extend(huge.to_le_bytes());
            extra
        });
        directory.extend(b"PK\x01\x02\x14\0\x14\0\0\0");
        directory.extend(method.to_le_bytes());
        directory.extend([0; 4]);
        for word in [crc, stated, stated] {
            directory.extend(word.to_le_bytes());
        }
        directory.extend((name.len() as u16).to_le_bytes());
        directory.extend((extra.len() as u16).to_le_bytes());
        directory.extend([0; 10]);
        directory.extend((at as u32).to_le_bytes());
        directory.extend(name);
        directory.extend(extra);
    }
    let start = bytes.len() as u32;
    let size = directory.len() as u32;
    let count = entries.len() as u16 + lies.more;
    bytes.extend(directory);
    bytes.extend(b"PK\x05\x06\0\0\0\0");
    bytes.extend(count.to_le_bytes());
    bytes.extend(count.to_le_bytes());
    bytes.extend(size.to_le_bytes());
    bytes.extend(start.to_le_bytes());
    bytes.extend([0; 2]);
    bytes
}

/// An archive with PyTorch's names of its parts.
pub(crate) fn checkpoint(pickle: &[u8]) -> Vec<u8> {
    zip(&[Entry::new("archive/data.pkl", pickle)], Lies::default())
}

pub(crate) fn entries(bytes: &[u8]) -> Vec<Entry> {
    let short = |at: usize| usize::from(u16::from_le_bytes([bytes[at], bytes[at + 1]]));
    let word = |at: usize| u32::from_le_bytes(bytes[at..at + 4].try_into().unwrap()) as usize;
    let end = bytes.len() - 22;
    assert!(bytes[end..].starts_with(b"PK\x05\x06"));
    let mut at = word(end + 16);
    let mut entries = Vec::new();
    for _ in 0..short(end + 10) {
        let name = &bytes[at + 46..][..short(at + 28)];
        let local = word(at + 42);
        let data = local + 30 + short(local + 26) + short(local + 28);
        entries.push(Entry {
            name: String::from_utf8(name.to_vec()).unwrap(),
            data: bytes[data..][..word(at + 24)].to_vec(),
        });
        at += 46 + short(at + 28) + short(at + 30) + short(at + 32);
    }
    entries
}

/// A recorded checkpoint with another pickle and correct checksums.
pub(crate) fn with_pickle(name: &str, change: impl FnOnce(Vec<u8>) -> Vec<u8>) -> Vec<u8> {
    let mut entries = entries(&fixture(name));
    let pickle = entries.iter_mut().find(|e| e.name.ends_with("/data.pkl"));
    let pickle = pickle.unwrap();
    pickle.data = change(std::mem::take(&mut pickle.data));
    zip(&entries, Lies::default())
}

/// Bytes with each occurrence of `from` replaced; there must be one.
pub(crate) fn replaced(bytes: &[u8], from: &[u8], to: &[u8]) -> Vec<u8> {
    let (mut out, mut at, mut found) = (Vec::new(), 0, 0);
    while at < bytes.len() {
        if bytes[at..].starts_with(from) {
            out.extend(to);
            at += from.len();
            found += 1;
        } else {
            out.push(bytes[at]);
            at += 1;
        }
    }
    assert!(found > 0, "nothing to replace");
    out
}

pub(crate) fn error_of(bytes: &[u8]) -> ImportError {
    import_checkpoint(bytes, "x").unwrap_err()
}

pub(crate) fn message_of(bytes: &[u8]) -> String {
    error_of(bytes).to_string()
}

/// A pickle of protocol 2 with these opcodes, in an archive.
pub(crate) fn program(opcodes: &[u8]) -> Vec<u8> {
    checkpoint(&[b"\x80\x02", opcodes, b"."].concat())
}
