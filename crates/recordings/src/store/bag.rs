//! ROS 1 bags, version 2.0, <https://wiki.ros.org/Bags/Format/2.0>: consecutive records, messages in chunks.

use super::Contents;
use super::blocks::{Block, BlockFile, Bytes, Compression};
use super::chunk::Chunk;
use super::cursor::Cursor;
use super::scanned::{Level, Scanned};
use crate::budget::{LONGEST_NAME, MOST_NUMBERS, Unpacking};
use crate::error::{RecordingError, Result};
use std::collections::BTreeMap;
use stillpoint_ros_messages::Format;

pub(crate) const MAGIC: &[u8] = b"#ROSBAG V2.0\n";

const MESSAGE: u8 = 0x02;
const BAG_HEADER: u8 = 0x03;
const CHUNK: u8 = 0x05;
const CONNECTION: u8 = 0x07;

/// Maximum size of a record header, bytes; those of connections hold the definition in their data.
const LARGEST_HEADER: u32 = 1 << 16;
const LARGEST_CONNECTION: u64 = 1 << 24;

pub(crate) fn open(
    bytes: Bytes,
    file: u16,
    unpacking: &mut Unpacking,
) -> Result<(BlockFile, Contents)> {
    let mut scan = Scan {
        scanned: Scanned::new(bytes, file, unpacking),
        connections: BTreeMap::new(),
    };
    let end = scan.scanned.store.bytes.len;
    scan.records(MAGIC.len() as u64, end, Level::File)?;
    Ok((scan.scanned.store, scan.scanned.contents))
}

struct Scan<'b> {
    scanned: Scanned<'b>,
    /// Topic and type by number, and the channel index; without one the connection is ignored.
    connections: BTreeMap<u32, (String, String, Option<u32>)>,
}

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

impl Scan<'_> {
    /// Uncompressed records from `at` to `end`.
    fn records(&mut self, mut at: u64, end: u64, level: Level) -> Result<()> {
        while at < end {
            let Some((header, data, len)) = self.frame(at, end)? else {
                self.scanned.contents.cut(at);
                return Ok(());
            };
            let Some(fields) = Fields::parse(&header) else {
                self.scanned.contents.cut(at);
                return Ok(());
            };
            let whole = len <= end - data;
            match fields.op() {
                Some(CHUNK) if level == Level::File => {
                    self.chunk(&fields, data, len.min(end - data), whole)?
                }
                _ if !whole => {}
                Some(BAG_HEADER) => self.check(&fields)?,
                Some(CONNECTION) if len <= LARGEST_CONNECTION => {
                    let bytes = self.scanned.store.bytes.get(data, len)?;
                    self.connection(&fields, &bytes);
                }
                Some(MESSAGE) => {
                    let wanted = self.wanted(&fields) as u64;
                    let head = self.scanned.store.bytes.get(data, len.min(wanted))?;
                    self.message(&fields, &head, None, data, len);
                }
                // Indexes are not needed.
                _ => {}
            }
            if !whole {
                self.scanned.contents.cut(at);
                return Ok(());
            }
            at = data + len;
        }
        Ok(())
    }

    /// Header, data offset and data length of the record at `at`.
    fn frame(&mut self, at: u64, end: u64) -> Result<Option<(Vec<u8>, u64, u64)>> {
        let mut word = [0; 4];
        if end - at < 4 || !self.scanned.store.bytes.fill(at, &mut word)? {
            return Ok(None);
        }
        let n = u32::from_le_bytes(word);
        let data = at + 8 + u64::from(n);
        if n > LARGEST_HEADER || data > end {
            return Ok(None);
        }
        let header = self.scanned.store.bytes.get(at + 4, n.into())?;
        if !self.scanned.store.bytes.fill(data - 4, &mut word)? {
            return Ok(None);
        }
        Ok(Some((header, data, u32::from_le_bytes(word).into())))
    }

    fn check(&self, fields: &Fields<'_>) -> Result<()> {
        match fields.text("encryptor") {
            Some(name) if !name.is_empty() => Err(RecordingError::format(
                &self.scanned.store.bytes.path,
                "a bag in plain",
                format!("one encrypted by {name}"),
                "decrypt it with rosbag",
            )),
            _ => Ok(()),
        }
    }

    /// The first declaration of a number counts; a different one is damage.
    fn connection(&mut self, fields: &Fields<'_>, data: &[u8]) {
        let read = (|| {
            let id = fields.u32("conn")?;
            let inner = Fields::parse(data)?;
            let topic = fields.text("topic").or_else(|| inner.text("topic"))?;
            Some((id, topic, inner.text("type")?))
        })();
        let Some((id, topic, type_name)) = read else {
            self.scanned
                .contents
                .remarks
                .add(|| "a connection record does not read and is left out".to_owned());
            return;
        };
        if let Some((known, known_type, _)) = self.connections.get(&id) {
            if (known, known_type) != (&topic, &type_name) {
                self.scanned.contents.remarks.add(|| {
                    format!("a connection record contradicts an earlier one of number {id} and is left out")
                });
            }
            return;
        }
        let index = self
            .scanned
            .contents
            .channel(&topic, &type_name, Some(Format::Ros1));
        if topic.len().max(type_name.len()) <= LONGEST_NAME && self.connections.len() < MOST_NUMBERS
        {
            self.connections.insert(id, (topic, type_name, index));
        }
    }

    fn index_of(&self, fields: &Fields<'_>) -> Option<u32> {
        self.connections.get(&fields.u32("conn")?)?.2
    }

    /// Number of bytes of a message that are read.
    fn wanted(&self, fields: &Fields<'_>) -> usize {
        self.scanned.wanted(self.index_of(fields))
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
            Some((self.index_of(fields)?, logged))
        })();
        let Some((channel, logged)) = read else {
            return;
        };
        let place = self.scanned.place(block, offset, len);
        self.scanned.contents.message(channel, logged, head, place);
    }

    /// A chunk with `len` bytes present; `whole` if it is complete.
    fn chunk(&mut self, fields: &Fields<'_>, offset: u64, len: u64, whole: bool) -> Result<()> {
        let name = fields.text("compression").unwrap_or_default();
        let size = u64::from(fields.u32("size").unwrap_or(0));
        let Some(how) = Compression::named(&name).filter(|how| *how != Some(Compression::Zstd))
        else {
            return Err(self.scanned.not_unpacked(&name, "lz4 or bz2", "rosbag"));
        };
        let Some(how) = how else {
            return self.records(offset, offset + len, Level::Chunk);
        };
        let block = Block {
            offset,
            stored: len,
            size,
            how,
        };
        // A bag has no checksums.
        let chunk = Chunk {
            at: offset,
            crc: 0,
            whole,
        };
        if let Some((index, bytes)) = self.scanned.unpack(block, &chunk)? {
            self.unpacked(&bytes, index, offset);
        }
        Ok(())
    }

    /// Records of a decompressed chunk, which begins at `at`.
    fn unpacked(&mut self, bytes: &[u8], block: u32, at: u64) {
        let mut from = Cursor::new(bytes);
        let mut done = 0_u64;
        while !from.is_empty() {
            let read = (|| {
                let header = from.bytes()?;
                Some((Fields::parse(header)?, header.len() as u64, from.bytes()?))
            })();
            let Some((fields, header, data)) = read else {
                self.scanned.ends_within_a_record(at);
                break;
            };
            let offset = done + 8 + header;
            match fields.op() {
                Some(CONNECTION) => self.connection(&fields, data),
                Some(MESSAGE) => {
                    let head = &data[..data.len().min(self.wanted(&fields))];
                    self.message(&fields, head, Some(block), offset, data.len() as u64);
                }
                _ => {}
            }
            done = offset + data.len() as u64;
        }
    }
}
