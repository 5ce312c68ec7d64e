//! Bags of ROS 1, version 2.0, <https://wiki.ros.org/Bags/Format/2.0>: records one after the other, messages in chunks.

use super::blocks::{Block, BlockFile, Bytes, Compression};
use super::cursor::Cursor;
use super::full_name;
use super::{Channel, Contents, HEAD, LARGEST_BLOCK, MOST_CHANNELS, Place};
use crate::error::{RecordingError, Result};
use std::collections::BTreeMap;
use stillpoint_ros_messages::Format;

/// First bytes of a file.
pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

const MESSAGE: u8 = 0x02;
const BAG_HEADER: u8 = 0x03;
const CHUNK: u8 = 0x05;
const CONNECTION: u8 = 0x07;

/// Bytes of a record's header at most; those of connections have all of a definition in their data.
const LARGEST_HEADER: u32 = 1 << 16;
/// Bytes of a connection's data at most.
const LARGEST_CONNECTION: u64 = 1 << 24;

/// Scans a file.
pub(crate) fn open(bytes: Bytes, file: u16) -> Result<(BlockFile, Contents)> {
    let mut scan = Scan {
        file,
        store: BlockFile::new(bytes),
        connections: BTreeMap::new(),
        contents: Contents::default(),
    };
    let end = scan.store.bytes.len;
    scan.records(MAGIC.len() as u64, end, Level::File)?;
    Ok((scan.store, scan.contents))
}

struct Scan {
    file: u16,
    store: BlockFile,
    /// Index in the contents by number.
    connections: BTreeMap<u32, u32>,
    contents: Contents,
}

/// Where records stand. Chunks hold none: a file that says otherwise is damaged.
#[derive(Clone, Copy, PartialEq)]
enum Level {
    File,
    Chunk,
}

/// Fields of a header by name.
#[derive(Debug, Default)]
struct Fields<'a>(Vec<(&'a [u8], &'a [u8])>);

impl<'a> Fields<'a> {
    fn parse(bytes: &'a [u8]) -> Option<Self> {
        let mut from = Cursor::new(bytes);
        let mut fields = Vec::new();
        while !from.is_empty() {
            let field = from.bytes()?;
            let split = field.iter().position(|b| *b == b'=')?;
            fields.push((&field[..split], &field[split + 1..]));
        }
        Some(Self(fields))
    }

    fn get(&self, name: &str) -> Option<&'a [u8]> {
        let found = self.0.iter().find(|(n, _)| *n == name.as_bytes());
        found.map(|(_, value)| *value)
    }

    fn op(&self) -> Option<u8> {
        self.get("op")?.first().copied()
    }

    fn u32(&self, name: &str) -> Option<u32> {
        Cursor::new(self.get(name)?).u32()
    }

    fn text(&self, name: &str) -> Option<String> {
        self.get(name)
            .map(|b| String::from_utf8_lossy(b).into_owned())
    }
}

impl Scan {
    /// Records that lie in the file as they are, from `at` to `end`.
    fn records(&mut self, mut at: u64, end: u64, level: Level) -> Result<()> {
        while at < end {
            let Some((header, data, len)) = self.frame(at, end)? else {
                self.contents.cut(at);
                return Ok(());
            };
            let Some(fields) = Fields::parse(&header) else {
                self.contents.cut(at);
                return Ok(());
            };
            let whole = len <= end - data;
            match fields.op() {
                Some(CHUNK) if level == Level::File => {
                    self.chunk(&fields, data, len.min(end - data))?
                }
                _ if !whole => {}
                Some(BAG_HEADER) => self.check(&fields)?,
                Some(CONNECTION) if len <= LARGEST_CONNECTION => {
                    let bytes = self.store.bytes.get(data, len)?;
                    self.connection(&fields, &bytes);
                }
                Some(MESSAGE) => {
                    let head = self.store.bytes.get(data, len.min(HEAD as u64))?;
                    self.message(&fields, &head, None, data, len);
                }
                // Indexes: everything is found without them.
                _ => {}
            }
            if !whole {
                self.contents.cut(at);
                return Ok(());
            }
            at = data + len;
        }
        Ok(())
    }

    /// Header, place of the data and its length, of the record at `at`.
    fn frame(&mut self, at: u64, end: u64) -> Result<Option<(Vec<u8>, u64, u64)>> {
        let mut word = [0; 4];
        if end - at < 4 || !self.store.bytes.fill(at, &mut word)? {
            return Ok(None);
        }
        let n = u32::from_le_bytes(word);
        let data = at + 8 + u64::from(n);
        if n > LARGEST_HEADER || data > end {
            return Ok(None);
        }
        let header = self.store.bytes.get(at + 4, n.into())?;
        if !self.store.bytes.fill(data - 4, &mut word)? {
            return Ok(None);
        }
        Ok(Some((header, data, u32::from_le_bytes(word).into())))
    }

    fn check(&self, fields: &Fields<'_>) -> Result<()> {
        match fields.text("encryptor") {
            Some(name) if !name.is_empty() => Err(RecordingError::format(
                &self.store.bytes.path,
                "a bag in plain",
                format!("one encrypted by {name}"),
                "decrypt it with rosbag",
            )),
            _ => Ok(()),
        }
    }

    fn connection(&mut self, fields: &Fields<'_>, data: &[u8]) {
        if self.connections.len() >= MOST_CHANNELS {
            return;
        }
        let read = (|| {
            let id = fields.u32("conn")?;
            let inner = Fields::parse(data)?;
            let topic = fields.text("topic").or_else(|| inner.text("topic"))?;
            Some((id, topic, full_name(&inner.text("type")?)))
        })();
        let Some((id, topic, type_name)) = read else {
            let remark = "a connection record does not read and is left out";
            self.contents.remarks.push(remark.to_owned());
            return;
        };
        let channel = Channel {
            topic,
            type_name,
            format: Some(Format::Ros1),
        };
        let index = self.contents.channel(channel);
        self.connections.insert(id, index);
    }

    fn message(
        &mut self,
        fields: &Fields<'_>,
        head: &[u8],
        block: Option<u32>,
        offset: u64,
        len: u64,
    ) {
        let read = (|| {
            let mut time = Cursor::new(fields.get("time")?);
            let (sec, nanosec) = (time.u32()?, time.u32()?);
            let logged = i64::from(sec) * 1_000_000_000 + i64::from(nanosec);
            Some((*self.connections.get(&fields.u32("conn")?)?, logged))
        })();
        let Some((channel, logged)) = read else {
            return;
        };
        let place = Place {
            file: self.file,
            block,
            offset,
            len: u32::try_from(len).unwrap_or(u32::MAX),
        };
        self.contents.message(channel, logged, head, place);
    }

    /// A chunk of which `len` bytes are there.
    fn chunk(&mut self, fields: &Fields<'_>, offset: u64, len: u64) -> Result<()> {
        let name = fields.text("compression").unwrap_or_default();
        let size = u64::from(fields.u32("size").unwrap_or(0));
        let Some(how) = Compression::named(&name).filter(|how| *how != Some(Compression::Zstd))
        else {
            let expected = "chunks without compression, or with lz4 or bz2";
            let found = format!("\"{name}\"");
            let advice = "convert it with rosbag";
            let path = &self.store.bytes.path;
            return Err(RecordingError::format(path, expected, found, advice));
        };
        let Some(how) = how else {
            return self.records(offset, offset + len, Level::Chunk);
        };
        if size > LARGEST_BLOCK {
            self.contents.remarks.push(format!(
                "the chunk at byte {offset} would have {size} bytes, more than {LARGEST_BLOCK}, and is left out"
            ));
            return Ok(());
        }
        let block = self.store.blocks.len() as u32;
        self.store.blocks.push(Block {
            offset,
            stored: len,
            size,
            how,
        });
        self.compressed(block, offset)
    }

    /// Records within a compressed chunk, which begins at `at`.
    fn compressed(&mut self, block: u32, at: u64) -> Result<()> {
        let (bytes, error) = self.store.load(block)?;
        // The scan changes what the block belongs to; a chunk is some megabytes at most.
        let bytes = bytes.to_vec();
        if let Some(e) = error {
            self.contents.remarks.push(format!(
                "the chunk at byte {at} is cut off or damaged ({e}): what is before is used"
            ));
        }
        let mut from = Cursor::new(&bytes);
        let mut done = 0_u64;
        while !from.is_empty() {
            let read = (|| {
                let header = from.bytes()?;
                Some((Fields::parse(header)?, header.len() as u64, from.bytes()?))
            })();
            let Some((fields, header, data)) = read else {
                self.contents.remarks.push(format!(
                    "the chunk at byte {at} ends within a record: what is before is used"
                ));
                break;
            };
            let offset = done + 8 + header;
            match fields.op() {
                Some(CONNECTION) => self.connection(&fields, data),
                Some(MESSAGE) => {
                    let head = &data[..data.len().min(HEAD)];
                    self.message(&fields, head, Some(block), offset, data.len() as u64);
                }
                _ => {}
            }
            done = offset + data.len() as u64;
        }
        Ok(())
    }
}
