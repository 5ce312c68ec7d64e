//! State of the scan of a message file, common to all formats.

use super::blocks::{Block, BlockFile, Bytes};
use super::chunk::Chunk;
use super::{Contents, HEAD, Place};
use crate::budget::Unpacking;
use crate::error::{RecordingError, Result};

/// Nesting of records. Chunks may not contain chunks.
#[derive(Clone, Copy, PartialEq)]
pub(super) enum Level {
    File,
    Chunk,
}

pub(super) struct Scanned<'b> {
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

    /// Number of bytes of a message of this channel that are read.
    pub(super) fn wanted(&self, channel: Option<u32>) -> usize {
        channel.map_or(HEAD, |c| self.contents.head_of(c))
    }

    /// Location of a message: in a block, or in the file itself.
    pub(super) fn place(&self, block: Option<u32>, offset: u64, len: u64) -> Place {
        Place {
            file: self.file,
            block,
            offset,
            len: u32::try_from(len).unwrap_or(u32::MAX),
        }
    }

    /// Contents of a compressed chunk with the block number; `None`, with a remark, if it is skipped.
    pub(super) fn unpack(&mut self, block: Block, chunk: &Chunk) -> Result<Option<(u32, Vec<u8>)>> {
        chunk.unpack(block, &mut self.store, self.unpacking, &mut self.contents)
    }

    pub(super) fn not_unpacked(&self, name: &str, known: &str, tool: &str) -> RecordingError {
        RecordingError::format(
            &self.store.bytes.path,
            &format!("chunks without compression, or with {known}"),
            format!("\"{name}\""),
            &format!("convert it with {tool}"),
        )
    }

    pub(super) fn ends_within_a_record(&mut self, chunk_at: u64) {
        self.contents.remarks.add(|| {
            format!("the chunk at byte {chunk_at} ends within a record: what is before is used")
        });
    }
}
