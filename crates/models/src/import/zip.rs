//! The archive of a checkpoint: zip as PyTorch writes it, with stored entries only. Entries are looked up by name in memory; nothing is
//! unpacked, so names and sizes can at worst cause an error.
//!
//! An own reader of the format's few structures (PKWARE, APPNOTE 6.3, sections 4.3 and 4.5.3): libraries keep the last of two entries with
//! one name, which allows a file to show one content to a scanner and another to its user.

use super::error::{ImportError, Result, shown};
use std::collections::BTreeMap;
use std::ops::Range;

/// Maximum number of entries of an archive; the largest checkpoints have some thousands.
const MOST_ENTRIES: usize = 1 << 16;

/// An archive whose entries are all stored, disjoint, and match their checksums.
pub(super) struct Archive<'a> {
    bytes: &'a [u8],
    entries: BTreeMap<&'a str, Range<usize>>,
}

struct Listed<'a> {
    name: &'a str,
    at: usize,
    local: usize,
    size: usize,
    crc: u32,
}

impl<'a> Archive<'a> {
    /// Reads the directory and checks every entry.
    pub(super) fn open(bytes: &'a [u8]) -> Result<Self> {
        let directory = Directory::find(bytes)?;
        let mut at = directory.start;
        let mut spans = Vec::new();
        let mut entries = BTreeMap::new();
        for _ in 0..directory.entries {
            let (entry, next) = listed(bytes, at, directory.end)?;
            let data = entry.data(bytes, directory.start)?;
            spans.push((entry.local, data.end));
            if entries.insert(entry.name, data).is_some() {
                return Err(fault(
                    at,
                    "each name once",
                    format!("a second `{}`", shown(entry.name)),
                ));
            }
            at = next;
        }
        if at != directory.end {
            return Err(fault(at, "the directory's end", "further bytes"));
        }
        spans.sort_unstable();
        for pair in spans.windows(2) {
            if pair[1].0 < pair[0].1 {
                return Err(fault(pair[1].0, "entries apart", "one inside another"));
            }
        }
        let archive = Self { bytes, entries };
        archive.check(&directory)?;
        Ok(archive)
    }

    pub(super) fn get(&self, name: &str) -> Option<&'a [u8]> {
        self.entries.get(name).map(|r| &self.bytes[r.clone()])
    }

    pub(super) fn names(&self) -> impl Iterator<Item = &'a str> {
        self.entries.keys().copied()
    }

    /// Compares the contents with their checksums. Called after the check for overlaps, so that no byte is read twice.
    fn check(&self, directory: &Directory) -> Result<()> {
        let mut at = directory.start;
        for _ in 0..directory.entries {
            let (entry, next) = listed(self.bytes, at, directory.end)?;
            let data = self.get(entry.name).unwrap_or_default();
            let found = crc32fast::hash(data);
            if found != entry.crc {
                return Err(ImportError::Archive {
                    at: entry.local as u64,
                    expected: "content that matches its checksum",
                    found: format!(
                        "`{}` with {found:08x} instead of {:08x}",
                        shown(entry.name),
                        entry.crc
                    ),
                });
            }
            at = next;
        }
        Ok(())
    }
}

struct Directory {
    start: usize,
    end: usize,
    entries: usize,
}

impl Directory {
    /// From the record at the archive's end, or from its 64-bit version before it.
    fn find(bytes: &[u8]) -> Result<Self> {
        let end = end_record(bytes).ok_or_else(|| {
            fault(
                bytes.len(),
                "the end record of a zip archive",
                "none: the file was cut short",
            )
        })?;
        let small = (
            u64::from(short(bytes, end + 10)?),
            u64::from(word(bytes, end + 12)?),
            u64::from(word(bytes, end + 16)?),
        );
        let large = match end.checked_sub(20) {
            Some(at) if word(bytes, at)? == 0x0706_4b50 => Some(large_record(bytes, at)?),
            _ => None,
        };
        let (entries, size, start) = large.unwrap_or(small);
        // Two readers could see different archives if the records disagree.
        let pairs = [
            (small.0, entries, 0xffff),
            (small.1, size, 0xffff_ffff),
            (small.2, start, 0xffff_ffff),
        ];
        if pairs.iter().any(|(s, l, full)| s != l && s != full) {
            return Err(fault(
                end,
                "both end records to agree",
                "different directories",
            ));
        }
        let limit = MOST_ENTRIES as u64;
        if entries > limit {
            return Err(ImportError::Limit {
                place: format!("byte {end} of the file"),
                what: "entries",
                limit: MOST_ENTRIES,
            });
        }
        let stop = start.checked_add(size).filter(|&stop| stop <= end as u64);
        let stop =
            stop.ok_or_else(|| fault(end, "a directory within the file", "one beyond its end"))?;
        Ok(Self {
            start: start as usize,
            end: stop as usize,
            entries: entries as usize,
        })
    }
}

/// The last end record whose comment ends exactly at the end of the file.
fn end_record(bytes: &[u8]) -> Option<usize> {
    let last = bytes.len().checked_sub(22)?;
    (last.saturating_sub(0xffff)..=last).rev().find(|&at| {
        bytes[at..].starts_with(b"PK\x05\x06")
            && short(bytes, at + 20).is_ok_and(|n| at + 22 + usize::from(n) == bytes.len())
    })
}

/// Entries, size and start of the directory from the 64-bit record that the locator at `at` points to.
fn large_record(bytes: &[u8], at: usize) -> Result<(u64, u64, u64)> {
    let record = long(bytes, at + 8)?;
    let record = usize::try_from(record)
        .ok()
        .filter(|r| r.checked_add(56).is_some_and(|end| end <= at))
        .ok_or_else(|| {
            fault(
                at,
                "the 64-bit end record within the file",
                format!("it at byte {record}"),
            )
        })?;
    if word(bytes, record)? != 0x0606_4b50 {
        return Err(fault(record, "the 64-bit end record", "something else"));
    }
    Ok((
        long(bytes, record + 32)?,
        long(bytes, record + 40)?,
        long(bytes, record + 48)?,
    ))
}

/// The directory's entry at `at`, and the offset of the next one.
fn listed(bytes: &[u8], at: usize, end: usize) -> Result<(Listed<'_>, usize)> {
    if at.saturating_add(46) > end || word(bytes, at)? != 0x0201_4b50 {
        return Err(fault(at, "an entry of the directory", "something else"));
    }
    let flags = short(bytes, at + 8)?;
    let method = short(bytes, at + 10)?;
    let lengths = [
        short(bytes, at + 28)?,
        short(bytes, at + 30)?,
        short(bytes, at + 32)?,
    ]
    .map(usize::from);
    let name = text(bytes, at + 46, lengths[0])?;
    if flags & 1 != 0 || method != 0 {
        let how = if method == 0 {
            "an encrypted"
        } else {
            "a compressed"
        };
        return Err(fault(
            at,
            "stored entries (torch.save never compresses)",
            format!("{how} `{}`", shown(name)),
        ));
    }
    let extra = slice(bytes, at + 46 + lengths[0], lengths[1])?;
    let mut sizes = [
        u64::from(word(bytes, at + 24)?),
        u64::from(word(bytes, at + 20)?),
        u64::from(word(bytes, at + 42)?),
    ];
    widen(&mut sizes, extra, at)?;
    let [size, packed, local] = sizes;
    let next = at + 46 + lengths.iter().sum::<usize>();
    let length = bytes.len() as u64;
    if size != packed || size > length || local > length {
        return Err(fault(
            at,
            "sizes and places within the file",
            format!("`{}` of {packed} for {size} bytes at {local}", shown(name)),
        ));
    }
    let entry = Listed {
        name,
        at,
        local: local as usize,
        size: size as usize,
        crc: word(bytes, at + 16)?,
    };
    Ok((entry, next))
}

/// Reads the sizes that do not fit 32 bits from the extra field 1.
fn widen(sizes: &mut [u64; 3], mut extra: &[u8], at: usize) -> Result<()> {
    let mut wide: &[u8] = &[];
    while let Some((head, rest)) = extra.split_first_chunk::<4>() {
        let length = usize::from(u16::from_le_bytes([head[2], head[3]]));
        let Some((field, after)) = rest.split_at_checked(length) else {
            break;
        };
        if head[..2] == [1, 0] {
            wide = field;
        }
        extra = after;
    }
    for size in sizes.iter_mut().filter(|s| **s == 0xffff_ffff) {
        let (value, rest) = wide
            .split_first_chunk()
            .ok_or_else(|| fault(at, "64-bit sizes of an entry", "none"))?;
        *size = u64::from_le_bytes(*value);
        wide = rest;
    }
    Ok(())
}

impl Listed<'_> {
    /// Range of its content, after the header that repeats its name.
    fn data(&self, bytes: &[u8], directory: usize) -> Result<Range<usize>> {
        let at = self.local;
        if word(bytes, at)? != 0x0403_4b50 {
            return Err(fault(at, "the header of an entry", "something else"));
        }
        let length = usize::from(short(bytes, at + 26)?);
        if text(bytes, at + 30, length)? != self.name || short(bytes, at + 8)? != 0 {
            return Err(fault(
                at,
                "the header to say what the directory says",
                format!("another name or method than that of `{}`", shown(self.name)),
            ));
        }
        // With flag 8 the sizes follow the content; -1 denotes 64-bit ones. Else they are repeated here.
        let stated = word(bytes, at + 18)?;
        let later = short(bytes, at + 6)? & 8 != 0 || stated == u32::MAX;
        if !later && u64::from(stated) != self.size as u64 {
            return Err(fault(
                at,
                "the size that the directory says",
                format!("{stated} bytes instead of {}", self.size),
            ));
        }
        let start = at + 30 + length + usize::from(short(bytes, at + 28)?);
        match start.checked_add(self.size) {
            Some(end) if end <= directory => Ok(start..end),
            _ => Err(fault(
                self.at,
                "content before the directory",
                format!("`{}` of {} bytes from {start}", shown(self.name), self.size),
            )),
        }
    }
}

fn fault(at: usize, expected: &'static str, found: impl Into<String>) -> ImportError {
    ImportError::Archive {
        at: at as u64,
        expected,
        found: found.into(),
    }
}

fn slice(bytes: &[u8], at: usize, length: usize) -> Result<&[u8]> {
    bytes
        .get(at..at.saturating_add(length))
        .ok_or_else(|| fault(at, "more bytes", "the end of the file"))
}

fn array<const N: usize>(bytes: &[u8], at: usize) -> Result<[u8; N]> {
    let mut array = [0; N];
    array.copy_from_slice(slice(bytes, at, N)?);
    Ok(array)
}

fn short(bytes: &[u8], at: usize) -> Result<u16> {
    array(bytes, at).map(u16::from_le_bytes)
}

fn word(bytes: &[u8], at: usize) -> Result<u32> {
    array(bytes, at).map(u32::from_le_bytes)
}

fn long(bytes: &[u8], at: usize) -> Result<u64> {
    array(bytes, at).map(u64::from_le_bytes)
}

fn text(bytes: &[u8], at: usize, length: usize) -> Result<&str> {
    std::str::from_utf8(slice(bytes, at, length)?)
        .map_err(|_| fault(at, "a name in UTF-8", "other bytes"))
}
