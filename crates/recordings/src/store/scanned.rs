//! What the scan of a file of messages fills, in whatever format it is.

use super::blocks::{Block, BlockFile, Bytes};
use super::chunk::Chunk;
use super::{Contents, HEAD, Place};
use crate::budget::Unpacking;
use crate::error::{RecordingError, Result};

/// Where records stand. Chunks hold none: a file that says otherwise is damaged.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Level {
    File,
    Chunk,
}

/// A file, and what of it was found.
pub(super) struct Scanned<'b> {
    /// Which of the recording's files.
    file: u16,
    pub(super) store: BlockFile,
    unpacking: &'b mut Unpacking,
    pub(super) contents: Contents,
}

impl<'b> Scanned<'b> {
    pub(super) fn new(bytes: Bytes, file: u16, unpacking: &'b mut Unpacking) -> Self {
        Self {
            file,
            contents: Contents::of(bytes.len),
            store: BlockFile::new(bytes),
            unpacking,
        }
    }

    /// Bytes of a message of this channel that are looked at.
    pub(super) fn wanted(&self, channel: Option<u32>) -> usize {
        channel.map_or(HEAD, |c| self.contents.head_of(c))
    }

    /// Where the bytes of a message are: in a block of the file, or in the file itself.
    pub(super) fn place(&self, block: Option<u32>, offset: u64, len: u64) -> Place {
        Place {
            file: self.file,
            block,
            offset,
            len: u32::try_from(len).unwrap_or(u32::MAX),
        }
    }

    /// What a compressed chunk holds, with the number of its block; none where it is left out, which is said.
    pub(super) fn unpack(&mut self, block: Block, chunk: &Chunk) -> Result<Option<(u32, Vec<u8>)>> {
        chunk.unpack(block, &mut self.store, self.unpacking, &mut self.contents)
    }

    /// A chunk whose compression the format does not have.
    pub(super) fn not_unpacked(&self, name: &str, known: &str, tool: &str) -> RecordingError {
        RecordingError::format(
            &self.store.bytes.path,
            &format!("chunks without compression, or with {known}"),
            format!("\"{name}\""),
            &format!("convert it with {tool}"),
        )
    }

    /// Says that a chunk holds less than its records would.
    pub(super) fn ends_within_a_record(&mut self, chunk_at: u64) {
        self.contents.remarks.add(|| {
            format!("the chunk at byte {chunk_at} ends within a record: what is before is used")
        });
    }
}
