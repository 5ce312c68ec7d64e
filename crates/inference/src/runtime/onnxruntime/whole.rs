//! Checks that a library's file is complete. Linux maps a truncated file, e.g. of an interrupted download, and ends the process with a bus
//! error on reading past the end; the systems that use other formats refuse such files themselves.

use std::path::Path;

/// Maximum number of bytes read; segment tables have a few hundred.
const HEAD: u64 = 1 << 16;
/// Type of a mapped segment (`PT_LOAD`).
const MAPPED: u64 = 1;

/// Checks that a file has the length that its header requires; files other than little-endian 64-bit ELF pass.
///
/// # Errors
/// The required number of bytes, for a message; or the system's error if the file cannot be read.
pub(super) fn check(file: &Path) -> Result<(), String> {
    use std::io::Read;
    let open = || -> std::io::Result<(Vec<u8>, u64)> {
        let file = std::fs::File::open(file)?;
        let length = file.metadata()?.len();
        let mut head = Vec::new();
        file.take(HEAD).read_to_end(&mut head)?;
        Ok((head, length))
    };
    let (head, length) = open().map_err(|e| e.to_string())?;
    match promised(&head) {
        Some(promised) if promised > length => Err(format!(
            "the first {length} bytes of a file of at least {promised}"
        )),
        _ => Ok(()),
    }
}

/// Minimum length of a file that begins like this; `None` if its header is incomplete or of another format.
fn promised(head: &[u8]) -> Option<u64> {
    if head.get(..6)? != b"\x7fELF\x02\x01" {
        return None;
    }
    // Offsets, numbers and sizes of the tables of segments (program header) and sections (System V ABI, ELF-64).
    let (segments, sections) = (number(head, 32, 8)?, number(head, 40, 8)?);
    let (segment_size, segment_count) = (number(head, 54, 2)?, number(head, 56, 2)?);
    let (section_size, section_count) = (number(head, 58, 2)?, number(head, 60, 2)?);
    let mut end = segments
        .saturating_add(segment_size * segment_count)
        .max(sections.saturating_add(section_size * section_count));
    for i in 0..segment_count {
        let at = usize::try_from(segments.saturating_add(i * segment_size)).ok()?;
        // A table further behind is ignored; sections are mostly at the end of a file, and suffice.
        let Some(segment) = head.get(at..) else { break };
        let (Some(kind), Some(offset), Some(size)) = (
            number(segment, 0, 4),
            number(segment, 8, 8),
            number(segment, 32, 8),
        ) else {
            break;
        };
        if kind == MAPPED {
            end = end.max(offset.saturating_add(size));
        }
    }
    Some(end)
}

/// A little-endian number of `size` bytes.
fn number(bytes: &[u8], at: usize, size: usize) -> Option<u64> {
    let bytes = bytes.get(at..)?.get(..size)?;
    Some(bytes.iter().rev().fold(0, |n, &b| n << 8 | u64::from(b)))
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A header with one mapped segment of 100 bytes from 1000 on, and three sections of 64 bytes from 2000 on.
    fn header() -> Vec<u8> {
        let mut head = vec![0; 120];
        head[..6].copy_from_slice(b"\x7fELF\x02\x01");
        for (at, value) in [(32, 64), (54, 56), (56, 1), (58, 64), (60, 3), (64, 1)] {
            head[at] = value;
        }
        head[40..42].copy_from_slice(&2000u16.to_le_bytes());
        head[72..74].copy_from_slice(&1000u16.to_le_bytes());
        head[96] = 100;
        head
    }

    #[test]
    fn file_end_is_that_of_the_last_segment_or_section() {
        let mut head = header();
        assert_eq!(promised(&head), Some(2000 + 3 * 64));
        head[60] = 0;
        head[40..42].fill(0);
        assert_eq!(promised(&head), Some(1100));
        // Not mapped.
        head[64] = 2;
        assert_eq!(promised(&head), Some(64 + 56));
    }

    #[test]
    fn other_formats_give_no_file_end() {
        for head in [
            &b""[..],
            b"MZ",
            b"\x7fELF\x01\x01 32 bits",
            b"\x7fELF\x02\x01 cut",
        ] {
            assert_eq!(promised(head), None);
        }
    }

    proptest! {
        #[test]
        fn any_elf_header_is_handled(bytes in proptest::collection::vec(any::<u8>(), 0..200)) {
            let mut head = header();
            for (byte, new) in head.iter_mut().skip(6).zip(bytes) {
                *byte = new;
            }
            prop_assert!(promised(&head).is_some());
        }
    }
}
