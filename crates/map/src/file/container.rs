//! Container format: sections with names, lengths and checksums.
//!
//! All numbers are little-endian. The first 28 bytes have the same meaning in every version.
//!
//! | bytes | content |
//! |---|---|
//! | 8 | magic |
//! | 4 | version |
//! | 4 | number of sections |
//! | 8 | length of the file |
//! | 4 | CRC-32 of the 24 bytes before |
//! | | the sections |
//! | 4 | CRC-32 of all bytes before |
//!
//! A section: one byte each for its kind (0: part of the map, 1: extension), its compression (0: none, 1: blocks) and
//! the length of its name; the name; 8 bytes each for the stored and the uncompressed length; the CRC-32 of the section
//! without these four bytes; the stored bytes.

use super::MapFileError;
use super::blocks;
use std::borrow::Cow;

/// Magic bytes. A byte that is not ASCII and both kinds of line ends reveal a transfer as text.
pub(super) const MAGIC: [u8; 8] = *b"\x89SPMAP\r\n";
/// The version written, and the latest readable one. Versions count from 1 by definition; 2 adds edges (decision 56).
pub(super) const VERSION: u32 = 2;
/// Bytes before the first section.
pub(super) const HEADER: usize = 28;
/// Length of a file without sections.
const SHORTEST: u64 = HEADER as u64 + 4;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Kind {
    Map,
    Extension,
}

pub(super) struct Section<'a> {
    pub(super) kind: Kind,
    pub(super) name: &'a str,
    pub(super) bytes: Cow<'a, [u8]>,
    pub(super) compress: bool,
}

#[derive(Debug)]
pub(super) struct Stored<'a> {
    pub(super) kind: Kind,
    pub(super) name: &'a str,
    pub(super) compressed: bool,
    raw_length: u64,
    bytes: &'a [u8],
}

impl<'a> Stored<'a> {
    /// The uncompressed bytes.
    pub(super) fn bytes(&self) -> Result<Cow<'a, [u8]>, MapFileError> {
        if self.compressed {
            return blocks::unpack(self.name, self.bytes, self.raw_length).map(Cow::Owned);
        }
        if self.raw_length == self.bytes.len() as u64 {
            return Ok(Cow::Borrowed(self.bytes));
        }
        Err(MapFileError::invalid(
            self.name,
            format!("{} bytes", self.raw_length),
            self.bytes.len(),
        ))
    }
}

pub(super) fn write(sections: &[Section<'_>]) -> Vec<u8> {
    let mut file = Vec::new();
    file.extend(MAGIC);
    file.extend(VERSION.to_le_bytes());
    file.extend((sections.len() as u32).to_le_bytes());
    file.extend([0; 12]);
    for section in sections {
        append(&mut file, section);
    }
    let length = file.len() as u64 + 4;
    file[16..24].copy_from_slice(&length.to_le_bytes());
    let checksum = crc32fast::hash(&file[..24]);
    file[24..28].copy_from_slice(&checksum.to_le_bytes());
    file.extend(crc32fast::hash(&file).to_le_bytes());
    file
}

fn append(file: &mut Vec<u8>, section: &Section<'_>) {
    let packed = section
        .compress
        .then(|| blocks::pack(&section.bytes))
        .flatten();
    let stored: &[u8] = packed.as_deref().unwrap_or(&section.bytes);
    let begin = file.len();
    let kind = u8::from(section.kind == Kind::Extension);
    file.extend([kind, u8::from(packed.is_some()), section.name.len() as u8]);
    file.extend(section.name.as_bytes());
    file.extend((stored.len() as u64).to_le_bytes());
    file.extend((section.bytes.len() as u64).to_le_bytes());
    let mut checksum = crc32fast::Hasher::new();
    checksum.update(&file[begin..]);
    checksum.update(stored);
    file.extend(checksum.finalize().to_le_bytes());
    file.extend(stored);
}

/// Reads the sections of a file and verifies their checksums.
pub(super) fn read(file: &[u8]) -> Result<(Header, Vec<Stored<'_>>), MapFileError> {
    let header = read_header(file)?;
    let found = file.len() as u64;
    let expected = header.length.max(SHORTEST);
    if expected != found {
        return Err(MapFileError::Length { expected, found });
    }
    let count = header.sections;
    let (body, last) = file.split_at(file.len() - 4);
    let mut rest = &body[HEADER..];
    let mut sections: Vec<Stored<'_>> = Vec::new();
    for number in 1..=count {
        let place = match sections.last() {
            Some(before) => format!("the section after {}", before.name),
            None => "the first section".into(),
        };
        let Some((section, checksums, after)) = split_section(rest) else {
            return Err(MapFileError::invalid(
                &place,
                format!("section {number} of {count}, whole"),
                format!("{} bytes that are none", rest.len()),
            ));
        };
        compare(
            &format!("section {}", section.name.escape_debug()),
            checksums,
        )?;
        sections.push(section);
        rest = after;
    }
    if !rest.is_empty() {
        return Err(MapFileError::invalid(
            "the end of the file",
            format!("{count} sections"),
            format!("{} bytes more", rest.len()),
        ));
    }
    compare("the whole file", (number32(last), crc32fast::hash(body)))?;
    Ok((header, sections))
}

pub(super) struct Header {
    pub(super) version: u32,
    sections: u32,
    /// Of the whole file.
    pub(super) length: u64,
}

pub(super) fn read_header(file: &[u8]) -> Result<Header, MapFileError> {
    let begin = &file[..file.len().min(MAGIC.len())];
    if !MAGIC.starts_with(begin) {
        return Err(MapFileError::Foreign {
            found: begin.to_vec(),
        });
    }
    if file.len() < HEADER {
        return Err(MapFileError::Length {
            expected: SHORTEST,
            found: file.len() as u64,
        });
    }
    compare(
        "the header",
        (number32(&file[24..]), crc32fast::hash(&file[..24])),
    )?;
    let header = Header {
        version: number32(&file[8..]),
        sections: number32(&file[12..]),
        length: number64(&file[16..]),
    };
    if header.version > VERSION {
        return Err(MapFileError::Newer {
            found: header.version,
            supported: VERSION,
        });
    }
    if header.version == 0 {
        return Err(MapFileError::invalid(
            "the header",
            "version 1",
            "version 0",
        ));
    }
    Ok(header)
}

/// The first section, its checksum as stated and as computed, and the rest.
fn split_section(rest: &[u8]) -> Option<(Stored<'_>, (u32, u32), &[u8])> {
    let [kind, compressed, name_length] = *rest.first_chunk::<3>()?;
    let name_end = 3 + usize::from(name_length);
    let name = std::str::from_utf8(rest.get(3..name_end)?).ok()?;
    let lengths = rest.get(name_end..name_end + 20)?;
    let (stored, raw_length) = (number64(lengths), number64(&lengths[8..]));
    let begin = name_end + 20;
    let end = begin.checked_add(usize::try_from(stored).ok()?)?;
    let bytes = rest.get(begin..end)?;
    let mut checksum = crc32fast::Hasher::new();
    checksum.update(&rest[..name_end + 16]);
    checksum.update(bytes);
    let checksums = (number32(&lengths[16..]), checksum.finalize());
    let section = Stored {
        kind: match kind {
            0 => Kind::Map,
            1 => Kind::Extension,
            _ => return None,
        },
        compressed: match compressed {
            0 => false,
            1 => true,
            _ => return None,
        },
        name,
        raw_length,
        bytes,
    };
    Some((section, checksums, &rest[end..]))
}

fn compare(section: &str, (expected, found): (u32, u32)) -> Result<(), MapFileError> {
    if expected == found {
        return Ok(());
    }
    Err(MapFileError::Checksum {
        section: section.into(),
        expected,
        found,
    })
}

/// The first four bytes as a number; panics when shorter.
fn number32(bytes: &[u8]) -> u32 {
    u32::from_le_bytes([bytes[0], bytes[1], bytes[2], bytes[3]])
}

/// The first eight bytes as a number; panics when shorter.
fn number64(bytes: &[u8]) -> u64 {
    u64::from(number32(bytes)) | u64::from(number32(&bytes[4..])) << 32
}
