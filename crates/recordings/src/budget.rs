//! Resource limits of a recording: names, topics, remarks, messages, transforms and decompressed bytes.
//!
//! A small file can state, repeat or unpack to arbitrary amounts. Each limit is well above the needs of recordings of hours with hundreds
//! of topics; together they end a hostile file within 10 s of CPU time and 1 GB.

use crate::error::{RecordingError, Result};
use std::path::Path;

/// Maximum number of topics: robots have some hundred.
pub(crate) const MOST_CHANNELS: usize = 4096;
/// Maximum number of topics of a type that is parsed (images, cameras, sensors, poses): ten cameras with all their transports have some
/// sixty.
pub(crate) const MOST_OF_A_TYPE: usize = 128;
/// Maximum number of channel ids: that of MCAP. A ROS 1 bag has one for each publisher of a topic.
pub(crate) const MOST_NUMBERS: usize = 1 << 16;
/// Maximum length of the name of a topic, type, frame or encoding, bytes: ROS 2 allows 255.
pub(crate) const LONGEST_NAME: usize = 1024;
/// Maximum number of remarks on damage; further ones are counted.
const MOST_REMARKS: usize = 50;
/// Maximum number of frame pairs with a transform: robots have up to three hundred.
pub(crate) const MOST_TRANSFORMS: usize = 2000;
/// Maximum number of lens coefficients: models have up to fourteen.
pub(crate) const MOST_COEFFICIENTS: usize = 32;

/// Maximum size of an image message, bytes: the largest image of eight bytes per pixel, plus padding.
pub(crate) const LARGEST_IMAGE: u64 = 160 << 20;
/// Maximum size of any other parsed message, bytes: some thousand transforms.
pub(crate) const LARGEST_MESSAGE: u64 = 1 << 20;
/// Maximum size of a decompressed block, bytes: writers make chunks of 1 to 4 MB, users of some tens.
pub(crate) const LARGEST_BLOCK: u64 = 1 << 28;
/// Maximum size of the cached decompressed blocks, bytes. The messages of one moment may lie in two or three blocks.
pub(crate) const MOST_KEPT: usize = 1 << 28;

/// Maximum number of indexed messages: half a gigabyte of index, for ten days of images, or for four hours with an inertial sensor.
const MOST_SLOTS: u64 = 1 << 23;
/// Number of messages allowed in a file of any size.
const FREE_SLOTS: u64 = 1 << 20;
/// File size per additional message, bytes: sensor messages take at least a hundred, however they are compressed.
const BYTES_PER_SLOT: u64 = 64;

/// Maximum number of messages in files of this total size.
pub(crate) fn most_slots(bytes: u64) -> u64 {
    (FREE_SLOTS + bytes / BYTES_PER_SLOT).min(MOST_SLOTS)
}

/// Decompressed bytes allowed independent of the compressed size: 22 s of black images of 640 x 480 px at 30 Hz.
const FREE_BYTES: u64 = 1 << 30;
/// Decompression time of bzip2 relative to the other methods.
pub(crate) const SLOW: u64 = 3;
/// Additional decompressed bytes per compressed byte: images of rooms unpack to two or three, flat simulated ones to some tens.
const BYTES_PER_PACKED: u64 = 100;
/// Bytes that a file compressed as a whole may take on disk in addition to [`BYTES_PER_PACKED`].
const FREE_FILE: u64 = 1 << 28;

#[derive(Clone, Debug)]
pub(crate) struct Unpacking {
    free: u64,
}

impl Default for Unpacking {
    fn default() -> Self {
        Self { free: FREE_BYTES }
    }
}

impl Unpacking {
    /// For a file that is compressed as a whole.
    pub(crate) fn of_file() -> Self {
        Self { free: FREE_FILE }
    }

    #[cfg(test)]
    pub(crate) fn of(free: u64) -> Self {
        Self { free }
    }

    /// Decompressed bytes allowed for this many compressed ones.
    pub(crate) fn allowed(&self, packed: u64) -> u64 {
        self.free
            .saturating_add(packed.saturating_mul(BYTES_PER_PACKED))
    }

    pub(crate) fn took(&mut self, packed: u64, unpacked: u64) {
        let beyond = unpacked.saturating_sub(packed.saturating_mul(BYTES_PER_PACKED));
        self.free = self.free.saturating_sub(beyond);
    }

    pub(crate) fn exceeded(path: &Path) -> RecordingError {
        RecordingError::format(
            path,
            &format!("a recording that unpacks to at most {BYTES_PER_PACKED} times its size"),
            "one that unpacks to far more",
            "record it again without compression if what it holds is real",
        )
    }

    /// Deducts a decompressed message, or refuses it.
    pub(crate) fn take(&mut self, path: &Path, packed: u64, unpacked: u64) -> Result<()> {
        if unpacked > self.allowed(packed) {
            return Err(Self::exceeded(path));
        }
        self.took(packed, unpacked);
        Ok(())
    }
}

/// Remarks for the user, and the number of omitted ones.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Remarks {
    said: Vec<String>,
    more: u64,
}

impl Remarks {
    /// Adds a remark, which is only built if it is kept.
    pub(crate) fn add(&mut self, sentence: impl FnOnce() -> String) {
        if self.said.len() < MOST_REMARKS {
            self.said.push(one_line(&sentence()));
        } else {
            self.more += 1;
        }
    }

    pub(crate) fn merge(&mut self, other: Self) {
        other.said.into_iter().for_each(|s| self.add(|| s));
        self.more += other.more;
    }

    pub(crate) fn lines(&self) -> Vec<String> {
        let more = (self.more > 0).then(|| format!("{} more remarks of this kind", self.more));
        self.said.iter().cloned().chain(more).collect()
    }
}

/// Escapes line breaks and control characters: names from files could otherwise forge output lines.
pub(crate) fn one_line(text: &str) -> String {
    let steers = |c: char| {
        c.is_control()
            || matches!(c, '\u{200e}' | '\u{200f}' | '\u{2028}'..='\u{202e}' | '\u{2066}'..='\u{2069}')
    };
    let mut shown = String::with_capacity(text.len());
    for c in text.chars() {
        if steers(c) {
            shown.extend(c.escape_default());
        } else {
            shown.push(c);
        }
    }
    shown
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_high_compression_ratios_are_limited() {
        let mut unpacking = Unpacking::default();
        for _ in 0..1000 {
            // A gigabyte of 20 MB each, as often as in a recording of hours.
            assert!(unpacking.allowed(20 << 20) > 1 << 30);
            unpacking.took(20 << 20, 1 << 30);
        }
        for _ in 0..4 {
            assert!(unpacking.allowed(1000) >= LARGEST_BLOCK);
            unpacking.took(1000, LARGEST_BLOCK);
        }
        assert!(unpacking.allowed(1000) < 1 << 20);
        assert!(unpacking.take(Path::new("a"), 1000, 1 << 20).is_err());
        assert!(unpacking.take(Path::new("a"), 1 << 20, 1 << 20).is_ok());
    }

    #[test]
    fn excess_remarks_are_only_counted() {
        let mut remarks = Remarks::default();
        for i in 0..1_000_000 {
            remarks.add(|| format!("topic {i}\nerror: forged"));
        }
        let lines = remarks.lines();
        assert_eq!(lines.len(), MOST_REMARKS + 1);
        assert_eq!(lines[0], "topic 0\\nerror: forged");
        assert!(lines[MOST_REMARKS].contains("999950 more"), "{lines:?}");
        let mut both = remarks.clone();
        both.merge(remarks);
        assert!(both.lines()[MOST_REMARKS].contains("1999950 more"));
    }
}
