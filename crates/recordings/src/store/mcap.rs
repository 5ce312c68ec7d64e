//! MCAP, <https://mcap.dev/spec>: records one after the other, messages in chunks or between them.

use super::blocks::{Block, BlockFile, Bytes, Compression};
use super::cursor::Cursor;
use super::full_name;
use super::{Channel, Contents, HEAD, LARGEST_BLOCK, MOST_CHANNELS, Place};
use crate::error::{RecordingError, Result};
use std::collections::BTreeMap;
use stillpoint_ros_messages::Format;

/// First bytes of a file.
pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;

/// Operation code and length.
const RECORD_HEAD: u64 = 9;
/// Channel, sequence number and two times before a message's bytes.
const MESSAGE_HEAD: u64 = 22;
/// Bytes of a schema or channel at most: definitions have some kilobytes.
const LARGEST_RECORD: u64 = 1 << 24;

/// Scans a file.
pub(crate) fn open(bytes: Bytes, file: u16) -> Result<(BlockFile, Contents)> {
    let mut scan = Scan {
        file,
        store: BlockFile::new(bytes),
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        contents: Contents::default(),
    };
    let end = scan.store.bytes.len;
    scan.records(MAGIC.len() as u64, end, Level::File)?;
    Ok((scan.store, scan.contents))
}

struct Scan {
    file: u16,
    store: BlockFile,
    /// Name by number.
    schemas: BTreeMap<u16, String>,
    /// Index in the contents by number.
    channels: BTreeMap<u16, u32>,
    contents: Contents,
}

/// Where records stand. Chunks hold none: a file that says otherwise is damaged.
#[derive(Clone, Copy, PartialEq)]
enum Level {
    File,
    Chunk,
}

/// What to do after a record.
#[derive(PartialEq)]
enum Next {
    Go,
    Stop,
}

impl Scan {
    /// Records that lie in the file as they are, from `at` to `end`.
    fn records(&mut self, mut at: u64, end: u64, level: Level) -> Result<Next> {
        while at < end {
            let mut head = [0; RECORD_HEAD as usize];
            let whole = end - at >= RECORD_HEAD && self.store.bytes.fill(at, &mut head)?;
            let (op, len) = (
                head[0],
                u64::from_le_bytes(head[1..].try_into().unwrap_or_default()),
            );
            let body = at + RECORD_HEAD;
            if !whole || (len > end - body && op != CHUNK) {
                self.contents.cut(at);
                return Ok(Next::Stop);
            }
            if self.record(op, body, len, level)? == Next::Stop {
                return Ok(Next::Stop);
            }
            let Some(next) = body.checked_add(len).filter(|next| *next <= end) else {
                self.contents.cut(at);
                return Ok(Next::Stop);
            };
            at = next;
        }
        Ok(Next::Go)
    }

    fn record(&mut self, op: u8, body: u64, len: u64, level: Level) -> Result<Next> {
        match op {
            FOOTER | DATA_END => return Ok(Next::Stop),
            SCHEMA | CHANNEL if len <= LARGEST_RECORD => {
                let bytes = self.store.bytes.get(body, len)?;
                self.describe(op, &bytes);
            }
            MESSAGE => {
                let head = self
                    .store
                    .bytes
                    .get(body, len.min(MESSAGE_HEAD + HEAD as u64))?;
                self.message(&head, None, body, len);
            }
            CHUNK if level == Level::File => self.chunk(body, len)?,
            // Indexes, attachments, metadata, and what later versions may add.
            _ => {}
        }
        Ok(Next::Go)
    }

    /// A schema or channel. One that does not read is left out: its messages are as well.
    fn describe(&mut self, op: u8, bytes: &[u8]) {
        if self.channels.len().max(self.schemas.len()) >= MOST_CHANNELS {
            return;
        }
        let mut from = Cursor::new(bytes);
        let mut read = || {
            let id = from.u16()?;
            if op == SCHEMA {
                self.schemas.insert(id, full_name(&from.text()?));
                return Some(());
            }
            let schema = from.u16()?;
            let topic = from.text()?;
            let encoding = from.text()?;
            let format = match encoding.as_str() {
                "cdr" => Some(Format::CdrLittleEndian),
                "ros1" => Some(Format::Ros1),
                _ => None,
            };
            let type_name = self.schemas.get(&schema).cloned().unwrap_or_default();
            let channel = Channel {
                topic,
                type_name,
                format,
            };
            let index = self.contents.channel(channel);
            self.channels.insert(id, index);
            Some(())
        };
        if read().is_none() {
            let what = if op == SCHEMA { "schema" } else { "channel" };
            self.contents
                .remarks
                .push(format!("a {what} record does not read and is left out"));
        }
    }

    /// A message whose record begins with `head`; its body of `len` bytes begins at `body`.
    fn message(&mut self, head: &[u8], block: Option<u32>, body: u64, len: u64) {
        let mut from = Cursor::new(head);
        let ids = from.u16().zip(from.u32()).zip(from.u64()).zip(from.u64());
        let Some((((id, _), logged), _)) = ids else {
            return;
        };
        let Some(&channel) = self.channels.get(&id) else {
            return;
        };
        let place = Place {
            file: self.file,
            block,
            offset: body + MESSAGE_HEAD,
            len: u32::try_from(len - MESSAGE_HEAD).unwrap_or(u32::MAX),
        };
        let logged = i64::try_from(logged).unwrap_or(i64::MAX);
        let head = &head[MESSAGE_HEAD as usize..];
        self.contents.message(channel, logged, head, place);
    }

    /// A chunk; `len` may reach beyond the end of a file that was cut off.
    fn chunk(&mut self, body: u64, len: u64) -> Result<()> {
        let head = self.store.bytes.get(body, len.min(256))?;
        let mut from = Cursor::new(&head);
        let read = (|| {
            from.take(16)?;
            let size = from.u64()?;
            from.take(4)?;
            let name = from.text()?;
            Some((size, name.clone(), 40 + name.len() as u64, from.u64()?))
        })();
        let Some((size, name, before, stored)) = read else {
            self.contents.cut(body);
            return Ok(());
        };
        let offset = body + before;
        let stored = stored.min(len.saturating_sub(before));
        let Some(how) = Compression::named(&name).filter(|how| *how != Some(Compression::Bzip2))
        else {
            let expected = "chunks without compression, or with lz4 or zstd";
            let found = format!("\"{name}\"");
            let advice = "convert it with the mcap command line";
            let path = &self.store.bytes.path;
            return Err(RecordingError::format(path, expected, found, advice));
        };
        let Some(how) = how else {
            let end = offset.saturating_add(stored).min(self.store.bytes.len);
            self.records(offset, end, Level::Chunk)?;
            return Ok(());
        };
        if size > LARGEST_BLOCK {
            self.contents.remarks.push(format!(
                "the chunk at byte {body} would have {size} bytes, more than {LARGEST_BLOCK}, and is left out"
            ));
            return Ok(());
        }
        let block = self.store.blocks.len() as u32;
        self.store.blocks.push(Block {
            offset,
            stored,
            size,
            how,
        });
        self.compressed(block, body)
    }

    /// Records within a compressed chunk, which begins at `at`.
    fn compressed(&mut self, block: u32, at: u64) -> Result<()> {
        let (bytes, error) = self.store.load(block)?;
        // The scan changes what the block belongs to; a chunk is some megabytes.
        let bytes = bytes.to_vec();
        if let Some(e) = error {
            self.contents.remarks.push(format!(
                "the chunk at byte {at} is cut off or damaged ({e}): what is before is used"
            ));
        }
        let mut from = Cursor::new(&bytes);
        let mut done = 0;
        while !from.is_empty() {
            let read = (|| {
                let op = from.take(1)?[0];
                let len = from.u64()?;
                Some((op, len, from.take(usize::try_from(len).ok()?)?))
            })();
            let Some((op, len, body)) = read else {
                self.contents.remarks.push(format!(
                    "the chunk at byte {at} ends within a record: what is before is used"
                ));
                break;
            };
            done += RECORD_HEAD;
            match op {
                SCHEMA | CHANNEL if len <= LARGEST_RECORD => self.describe(op, body),
                MESSAGE => {
                    let head = &body[..body.len().min(MESSAGE_HEAD as usize + HEAD)];
                    self.message(head, Some(block), done, len);
                }
                _ => {}
            }
            done += len;
        }
        Ok(())
    }
}
