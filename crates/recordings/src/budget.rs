//! What a recording may take, in one place: names, topics, remarks, messages, transforms and unpacked bytes.
//!
//! A file of some kilobytes can state, repeat or unpack to anything. Each number below is well above what recordings of hours with hundreds of topics need, and
//! together they end a hostile file within 10 s of a processor and 1 GB.

use crate::error::{RecordingError, Result};
use std::path::Path;

/// Topics: robots have some hundred.
pub(crate) const MOST_CHANNELS: usize = 4096;
/// Topics of one type that is looked into one by one (images, cameras, sensors, poses): ten cameras with all their transports have some sixty.
pub(crate) const MOST_OF_A_TYPE: usize = 128;
/// Numbers that stand for topics: as many as MCAP has. A ROS 1 bag has one for each publisher of a topic.
pub(crate) const MOST_NUMBERS: usize = 1 << 16;
/// Bytes of the name of a topic, type, frame or encoding: ROS 2 allows 255.
pub(crate) const LONGEST_NAME: usize = 1024;
/// Sentences on damage that are kept; further ones are counted.
const MOST_REMARKS: usize = 50;
/// Pairs of frames with a transform: robots have up to three hundred.
pub(crate) const MOST_TRANSFORMS: usize = 2000;
/// Lens coefficients: models have up to fourteen.
pub(crate) const MOST_COEFFICIENTS: usize = 32;

/// Bytes of a message of an image: the largest image of eight bytes a pixel, some more for padding.
pub(crate) const LARGEST_IMAGE: u64 = 160 << 20;
/// Bytes of any other message that is looked into: some thousand transforms.
pub(crate) const LARGEST_MESSAGE: u64 = 1 << 20;
/// Bytes of a decompressed block: writers make chunks of 1 to 4 MB, users of some tens.
pub(crate) const LARGEST_BLOCK: u64 = 1 << 28;
/// Bytes of decompressed blocks that are kept together. Those of one moment may lie in two or three blocks.
pub(crate) const MOST_KEPT: usize = 1 << 28;

/// Messages that are kept at most: half a gigabyte of places, those of ten days of images, or of four hours with an inertial sensor beside them.
const MOST_SLOTS: u64 = 1 << 23;
/// Messages that a file of any size may have.
const FREE_SLOTS: u64 = 1 << 20;
/// Bytes of a file for each one more: those of sensors take a hundred at least, however they are compressed.
const BYTES_PER_SLOT: u64 = 64;

/// Messages that files of so many bytes may have.
pub(crate) fn most_slots(bytes: u64) -> u64 {
    (FREE_SLOTS + bytes / BYTES_PER_SLOT).min(MOST_SLOTS)
}

/// Bytes that may be unpacked whatever they were packed in: 22 s of black images of 640 x 480 px at 30 Hz.
const FREE_BYTES: u64 = 1 << 30;
/// How many times longer bzip2 takes for a byte than the others do.
pub(crate) const SLOW: u64 = 3;
/// Bytes for each packed one beside: images of rooms unpack to two or three, flat ones of simulators to some tens.
const BYTES_PER_PACKED: u64 = 100;
/// Bytes of a file that was packed as a whole and may be written to the disk beside [`BYTES_PER_PACKED`].
const FREE_FILE: u64 = 1 << 28;

/// What may still be unpacked of a recording.
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
    /// For one file that was packed as a whole.
    pub(crate) fn of_file() -> Self {
        Self { free: FREE_FILE }
    }

    #[cfg(test)]
    pub(crate) fn of(free: u64) -> Self {
        Self { free }
    }

    /// Bytes that may be unpacked of so many packed ones.
    pub(crate) fn allowed(&self, packed: u64) -> u64 {
        self.free
            .saturating_add(packed.saturating_mul(BYTES_PER_PACKED))
    }

    /// Takes what was unpacked off.
    pub(crate) fn took(&mut self, packed: u64, unpacked: u64) {
        let beyond = unpacked.saturating_sub(packed.saturating_mul(BYTES_PER_PACKED));
        self.free = self.free.saturating_sub(beyond);
    }

    /// The error of a recording that unpacks to more.
    pub(crate) fn exceeded(path: &Path) -> RecordingError {
        RecordingError::format(
            path,
            &format!("a recording that unpacks to at most {BYTES_PER_PACKED} times its size"),
            "one that unpacks to far more",
            "record it again without compression if what it holds is real",
        )
    }

    /// Takes what a message unpacked to off, or refuses it.
    pub(crate) fn take(&mut self, path: &Path, packed: u64, unpacked: u64) -> Result<()> {
        if unpacked > self.allowed(packed) {
            return Err(Self::exceeded(path));
        }
        self.took(packed, unpacked);
        Ok(())
    }
}

/// Sentences for the user, and how many more there would be.
#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Remarks {
    said: Vec<String>,
    more: u64,
}

impl Remarks {
    /// Adds a sentence, which is made only where it is kept.
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

    /// The sentences, the last of which counts what was not kept.
    pub(crate) fn lines(&self) -> Vec<String> {
        let more = (self.more > 0).then(|| format!("{} more remarks of this kind", self.more));
        self.said.iter().cloned().chain(more).collect()
    }
}

/// The text with escapes for what ends a line or steers a terminal: names come from files, and one with a line break would forge a line.
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
    fn what_unpacks_far_is_bounded_and_what_does_not_never_is() {
        let mut unpacking = Unpacking::default();
        for _ in 0..1000 {
            // A gigabyte of 20 MB each, as often as a recording of hours has it.
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
    fn remarks_are_counted_beyond_some_number() {
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
