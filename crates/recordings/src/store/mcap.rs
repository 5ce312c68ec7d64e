//! MCAP, <https://mcap.dev/spec>: consecutive records, messages in chunks or between them.

use super::blocks::{Block, BlockFile, Bytes, Compression, wrong_crc};
use super::chunk::Chunk;
use super::cursor::Cursor;
use super::scanned::{Level, Scanned};
use super::{Contents, HEAD};
use crate::budget::{LONGEST_NAME, Unpacking};
use crate::error::Result;
use std::collections::BTreeMap;
use stillpoint_ros_messages::Format;

pub(crate) const MAGIC: &[u8] = b"\x89MCAP0\r\n";

const FOOTER: u8 = 0x02;
const SCHEMA: u8 = 0x03;
const CHANNEL: u8 = 0x04;
const MESSAGE: u8 = 0x05;
const CHUNK: u8 = 0x06;
const DATA_END: u8 = 0x0f;

/// Opcode and length.
const RECORD_HEAD: u64 = 9;
/// Channel, sequence number and two times before a message's bytes.
const MESSAGE_HEAD: u64 = 22;
/// Maximum size of a schema or channel, bytes: definitions have some kilobytes.
const LARGEST_RECORD: u64 = 1 << 24;

pub(crate) fn open(
    bytes: Bytes,
    file: u16,
    unpacking: &mut Unpacking,
) -> Result<(BlockFile, Contents)> {
    let mut scan = Scan {
        scanned: Scanned::new(bytes, file, unpacking),
        schemas: BTreeMap::new(),
        channels: BTreeMap::new(),
        unchecked: Vec::new(),
    };
    let end = scan.scanned.store.bytes.len;
    scan.records(MAGIC.len() as u64, end, Level::File)?;
    Ok((scan.scanned.store, scan.scanned.contents))
}

struct Scan<'b> {
    scanned: Scanned<'b>,
    schemas: BTreeMap<u16, String>,
    /// Topic, schema and encoding by number, and the channel index; without one the channel is ignored.
    channels: BTreeMap<u16, (Declared, Option<u32>)>,
    /// Ranges of messages that no chunk checksum covers.
    unchecked: Vec<std::ops::Range<usize>>,
}

#[derive(Clone, Debug, PartialEq)]
struct Declared {
    topic: String,
    type_name: String,
    format: Option<Format>,
}

#[derive(PartialEq)]
enum Next {
    Go,
    Stop,
}

impl Scan<'_> {
    /// Uncompressed records from `at` to `end`.
    fn records(&mut self, mut at: u64, end: u64, level: Level) -> Result<Next> {
        while at < end {
            let mut head = [0; RECORD_HEAD as usize];
            let whole = end - at >= RECORD_HEAD && self.scanned.store.bytes.fill(at, &mut head)?;
            let (op, len) = (
                head[0],
                u64::from_le_bytes(head[1..].try_into().unwrap_or_default()),
            );
            let body = at + RECORD_HEAD;
            if !whole || (len > end - body && op != CHUNK) {
                self.scanned.contents.cut(at);
                return Ok(Next::Stop);
            }
            if self.record(op, body, len, level)? == Next::Stop {
                return Ok(Next::Stop);
            }
            let Some(next) = body.checked_add(len).filter(|next| *next <= end) else {
                self.scanned.contents.cut(at);
                return Ok(Next::Stop);
            };
            at = next;
        }
        Ok(Next::Go)
    }

    fn record(&mut self, op: u8, body: u64, len: u64, level: Level) -> Result<Next> {
        match op {
            FOOTER => return Ok(Next::Stop),
            DATA_END => {
                if level == Level::File {
                    self.data_end(body, len)?;
                }
                return Ok(Next::Stop);
            }
            SCHEMA | CHANNEL if len <= LARGEST_RECORD => {
                let bytes = self.scanned.store.bytes.get(body, len)?;
                self.describe(op, &bytes);
            }
            MESSAGE => {
                let before = self.scanned.contents.slots.len();
                let mut head = self.head(body, len, HEAD)?;
                let channel = Cursor::new(&head).u16().and_then(|id| self.index_of(id));
                let wanted = self.scanned.wanted(channel);
                if wanted > HEAD {
                    head = self.head(body, len, wanted)?;
                }
                self.message(&head, None, body, len);
                if level == Level::File {
                    self.is_unchecked(before);
                }
            }
            CHUNK if level == Level::File => self.chunk(body, len)?,
            // Indexes, attachments, metadata, and records of later versions.
            _ => {}
        }
        Ok(Next::Go)
    }

    /// The first bytes of a message record, with `n` bytes of the message itself.
    fn head(&mut self, body: u64, len: u64, n: usize) -> Result<Vec<u8>> {
        self.scanned
            .store
            .bytes
            .get(body, len.min(MESSAGE_HEAD + n as u64))
    }

    /// Marks the messages added since `before` as not covered by a chunk checksum.
    fn is_unchecked(&mut self, before: usize) {
        let after = self.scanned.contents.slots.len();
        match self.unchecked.last_mut() {
            Some(last) if last.end == before => last.end = after,
            _ if after > before => self.unchecked.push(before..after),
            _ => {}
        }
    }

    /// A schema or channel. An unreadable one is skipped together with its messages. The first declaration of a number counts; a different
    /// one is damage.
    fn describe(&mut self, op: u8, bytes: &[u8]) {
        let known = if op == SCHEMA {
            let read = Cursor::new(bytes).u16_and_text();
            read.map(|(id, name)| self.schema(id, name))
        } else {
            self.declared(bytes).map(|(id, d)| self.declare(id, d))
        };
        let what = if op == SCHEMA { "schema" } else { "channel" };
        match known {
            Some(true) => {}
            Some(false) => self
                .scanned
                .contents
                .remarks
                .add(|| format!("a {what} record contradicts an earlier one, or its name is too long, and is left out")),
            None => self
                .scanned
                .contents
                .remarks
                .add(|| format!("a {what} record does not read and is left out")),
        }
    }

    fn schema(&mut self, id: u16, name: String) -> bool {
        if name.len() > LONGEST_NAME {
            return false;
        }
        *self.schemas.entry(id).or_insert_with(|| name.clone()) == name
    }

    fn declared(&self, bytes: &[u8]) -> Option<(u16, Declared)> {
        let mut from = Cursor::new(bytes);
        let id = from.u16()?;
        let (schema, topic) = from.u16_and_text()?;
        let format = match from.text()?.as_str() {
            "cdr" => Some(Format::CdrLittleEndian),
            "ros1" => Some(Format::Ros1),
            _ => None,
        };
        let type_name = self.schemas.get(&schema).cloned().unwrap_or_default();
        let declared = Declared {
            topic,
            type_name,
            format,
        };
        Some((id, declared))
    }

    fn declare(&mut self, id: u16, declared: Declared) -> bool {
        if let Some((known, _)) = self.channels.get(&id) {
            return *known == declared;
        }
        if declared.topic.len() > LONGEST_NAME {
            return false;
        }
        let index =
            self.scanned
                .contents
                .channel(&declared.topic, &declared.type_name, declared.format);
        self.channels.insert(id, (declared, index));
        true
    }

    fn index_of(&self, id: u16) -> Option<u32> {
        self.channels.get(&id).and_then(|(_, index)| *index)
    }

    /// A message whose record begins with `head`; its body of `len` bytes begins at `body`.
    fn message(&mut self, head: &[u8], block: Option<u32>, body: u64, len: u64) {
        let mut from = Cursor::new(head);
        let ids = from.u16().zip(from.u32()).zip(from.u64()).zip(from.u64());
        let Some((((id, _), logged), _)) = ids else {
            return;
        };
        let Some(channel) = self.index_of(id) else {
            return;
        };
        let place = self
            .scanned
            .place(block, body + MESSAGE_HEAD, len - MESSAGE_HEAD);
        let logged = i64::try_from(logged).unwrap_or(i64::MAX);
        let head = &head[MESSAGE_HEAD as usize..];
        self.scanned.contents.message(channel, logged, head, place);
    }

    /// A chunk; `len` may exceed a truncated file.
    fn chunk(&mut self, body: u64, len: u64) -> Result<()> {
        let head = self.scanned.store.bytes.get(body, len.min(256))?;
        let mut from = Cursor::new(&head);
        let read = (|| {
            from.take(16)?;
            let (size, crc) = (from.u64()?, from.u32()?);
            let name = from.text()?;
            Some((size, crc, name.clone(), 40 + name.len() as u64, from.u64()?))
        })();
        let Some((size, crc, name, before, stated)) = read else {
            self.scanned.contents.cut(body);
            return Ok(());
        };
        let offset = body + before;
        let stored = stated.min(len.saturating_sub(before));
        let Some(how) = Compression::named(&name).filter(|how| *how != Some(Compression::Bzip2))
        else {
            let (known, tool) = ("lz4 or zstd", "the mcap command line");
            return Err(self.scanned.not_unpacked(&name, known, tool));
        };
        let end = offset.saturating_add(stored);
        let chunk = Chunk {
            at: body,
            crc,
            whole: stored == stated && end <= self.scanned.store.bytes.len,
        };
        let slots = self.scanned.contents.slots.len();
        if let Some(how) = how {
            let block = Block {
                offset,
                stored,
                size,
                how,
            };
            if let Some((index, bytes)) = self.scanned.unpack(block, &chunk)? {
                self.unpacked(&bytes, index, body);
            }
        } else {
            self.plain(offset, end.min(self.scanned.store.bytes.len), &chunk)?;
        }
        if crc == 0 || !chunk.whole {
            self.is_unchecked(slots);
        }
        Ok(())
    }

    fn plain(&mut self, offset: u64, end: u64, chunk: &Chunk) -> Result<()> {
        let sum = || {
            Ok(self
                .scanned
                .store
                .bytes
                .crc(offset, end - offset)?
                .finalize())
        };
        if let Some(why) = chunk.wrong_sum(sum)? {
            chunk.leave_out(&why, &mut self.scanned.contents);
            return Ok(());
        }
        self.records(offset, end, Level::Chunk).map(drop)
    }

    /// Records of a decompressed chunk, which begins at `at`.
    fn unpacked(&mut self, bytes: &[u8], block: u32, at: u64) {
        let mut from = Cursor::new(bytes);
        let mut done = 0;
        while !from.is_empty() {
            let read = (|| {
                let op = from.take(1)?[0];
                let len = from.u64()?;
                Some((op, len, from.take(usize::try_from(len).ok()?)?))
            })();
            let Some((op, len, body)) = read else {
                self.scanned.ends_within_a_record(at);
                break;
            };
            done += RECORD_HEAD;
            match op {
                SCHEMA | CHANNEL if len <= LARGEST_RECORD => self.describe(op, body),
                MESSAGE => {
                    let channel = Cursor::new(body).u16().and_then(|id| self.index_of(id));
                    let wanted = self.scanned.wanted(channel);
                    let head = &body[..body.len().min(MESSAGE_HEAD as usize + wanted)];
                    self.message(head, Some(block), done, len);
                }
                _ => {}
            }
            done += len;
        }
    }

    /// The data end record, which begins at `body`: if its checksum does not match, messages not covered by a chunk checksum are dropped.
    fn data_end(&mut self, body: u64, len: u64) -> Result<()> {
        let bytes = self.scanned.store.bytes.get(body, len.min(4))?;
        let stated = Cursor::new(&bytes).u32().unwrap_or(0);
        if stated == 0 || self.unchecked.is_empty() {
            return Ok(());
        }
        let begin = MAGIC.len() as u64;
        let mut whole = self.scanned.store.bytes.crc(0, begin)?;
        let data = self
            .scanned
            .store
            .bytes
            .crc(begin, body - RECORD_HEAD - begin)?;
        whole.combine(&data);
        let found = whole.finalize();
        // From the first byte of the file, as by all writers, or from the first record.
        if found == stated || data.finalize() == stated {
            return Ok(());
        }
        let before = self.scanned.contents.slots.len();
        let mut index = 0;
        let unchecked = std::mem::take(&mut self.unchecked);
        self.scanned.contents.slots.retain(|_| {
            let i = index;
            index += 1;
            let range = unchecked.partition_point(|r| r.end <= i);
            unchecked.get(range).is_none_or(|r| i < r.start)
        });
        let gone = before - self.scanned.contents.slots.len();
        let why = wrong_crc("CRC-32", stated, found);
        self.scanned.contents.remarks.add(|| {
            format!("the data before byte {body} are damaged ({why}) and nothing tells where: {gone} messages that no checksum of a chunk vouches for are left out; `mcap recover` writes a file with all of them")
        });
        Ok(())
    }
}
