//! Decompresses a chunk of messages during a scan, and reports damage.

use super::Contents;
use super::blocks::{Block, BlockFile, Unpacked, wrong_crc};
use crate::budget::{LARGEST_BLOCK, Unpacking};
use crate::error::Result;

pub(super) struct Chunk {
    /// Its offset, for messages.
    pub(super) at: u64,
    /// CRC-32 of the decompressed contents; 0 for none.
    pub(super) crc: u32,
    pub(super) whole: bool,
}

impl Chunk {
    /// The contents with the block number; `None`, with a remark, if it is skipped.
    pub(super) fn unpack(
        &self,
        block: Block,
        store: &mut BlockFile,
        unpacking: &mut Unpacking,
        contents: &mut Contents,
    ) -> Result<Option<(u32, Vec<u8>)>> {
        let (at, size) = (self.at, block.size);
        if size > LARGEST_BLOCK {
            contents.remarks.add(|| format!(
                "the chunk at byte {at} would have {size} bytes, more than {LARGEST_BLOCK}, and is left out"
            ));
            return Ok(None);
        }
        let index = store.blocks.len() as u32;
        store.blocks.push(block);
        let (bytes, error) = match store.unpack(index, unpacking)? {
            Unpacked::Bytes(bytes, error) => (bytes, error),
            Unpacked::TooMuch => {
                contents.chunk_beyond(at);
                return Ok(None);
            }
        };
        // The intact part of a truncated chunk is used; a complete chunk with an error may hold anything, and is skipped.
        let error = match error {
            None => self.wrong_sum(|| Ok(crc32fast::hash(&bytes)))?,
            error => error,
        };
        match error {
            Some(e) if self.whole => {
                self.leave_out(&e, contents);
                return Ok(None);
            }
            Some(e) => contents
                .remarks
                .add(|| format!("the chunk at byte {at} is cut off ({e}): what is before is used")),
            None => {}
        }
        Ok(Some((index, bytes)))
    }

    /// Checks the checksum of a complete chunk, if stated.
    pub(super) fn wrong_sum(
        &self,
        of_bytes: impl FnOnce() -> Result<u32>,
    ) -> Result<Option<String>> {
        if !self.whole || self.crc == 0 {
            return Ok(None);
        }
        let found = of_bytes()?;
        Ok((found != self.crc).then(|| wrong_crc("CRC-32", self.crc, found)))
    }

    pub(super) fn leave_out(&self, why: &str, contents: &mut Contents) {
        let at = self.at;
        contents
            .remarks
            .add(|| format!("the chunk at byte {at} is damaged ({why}) and left out"));
    }
}
