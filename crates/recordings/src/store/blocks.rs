//! A file with compressed blocks: random access, with a cache of decompressed blocks.

use super::{Place, Store};
use crate::budget::{LARGEST_BLOCK, LARGEST_IMAGE, MOST_KEPT, SLOW, Unpacking};
use crate::error::{RecordingError, Result};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    Zstd,
    Lz4,
    Bzip2,
}

impl Compression {
    /// By the name in MCAP and ROS 1; the inner `None` means uncompressed.
    pub(crate) fn named(name: &str) -> Option<Option<Self>> {
        match name {
            "" | "none" => Some(None),
            "zstd" => Some(Some(Self::Zstd)),
            "lz4" => Some(Some(Self::Lz4)),
            "bz2" => Some(Some(Self::Bzip2)),
            _ => None,
        }
    }
}

/// Decompresses up to `largest` bytes. Also returns the bytes before an error, which a truncated file still holds.
pub(crate) fn decompress(
    how: Compression,
    bytes: &[u8],
    largest: u64,
) -> (Vec<u8>, Option<String>) {
    // Untouched pages take no memory.
    let mut out = Vec::with_capacity(largest.min(64 * bytes.len() as u64) as usize);
    let mut read = |from: &mut dyn Read| {
        let read = from.take(largest + 1).read_to_end(&mut out);
        let error = read.err().map(|e| e.to_string());
        let too_long = out.len() as u64 > largest;
        out.truncate(largest as usize);
        error.or(too_long.then(|| format!("more than {largest} bytes")))
    };
    let error = match how {
        Compression::Lz4 => read(&mut lz4_flex::frame::FrameDecoder::new(bytes)),
        Compression::Bzip2 => read(&mut bzip2::read::MultiBzDecoder::new(bytes)),
        Compression::Zstd => match ruzstd::decoding::StreamingDecoder::new(bytes) {
            Ok(mut decoder) => read(&mut decoder).or_else(|| wrong_checksum(&decoder.decoder)),
            Err(e) => Some(e.to_string()),
        },
    };
    (out, error)
}

/// Checks the checksum of a completely read Zstandard frame, which the decoder leaves to its caller.
pub(crate) fn wrong_checksum(decoder: &ruzstd::decoding::FrameDecoder) -> Option<String> {
    let stated = decoder.get_checksum_from_data()?;
    let found = decoder.get_calculated_checksum()?;
    (decoder.is_finished() && stated != found).then(|| wrong_crc("checksum", stated, found))
}

pub(crate) fn wrong_crc(which: &str, stated: u32, found: u32) -> String {
    format!("its {which} is {found:08x} instead of {stated:08x}")
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    pub(crate) offset: u64,
    pub(crate) stored: u64,
    pub(crate) size: u64,
    pub(crate) how: Compression,
}

#[derive(Debug)]
pub(crate) struct Bytes {
    pub(crate) path: PathBuf,
    file: BufReader<File>,
    at: u64,
    pub(crate) len: u64,
}

impl Bytes {
    pub(crate) fn open(path: &Path) -> Result<Self> {
        let file = stillpoint_datasets::open_regular(path).map_err(RecordingError::read(path))?;
        let len = file.metadata().map_err(RecordingError::read(path))?.len();
        Ok(Self {
            path: path.to_owned(),
            file: BufReader::with_capacity(1 << 16, file),
            at: 0,
            len,
        })
    }

    /// Fills `out` from `offset`; false at the end of the file.
    pub(crate) fn fill(&mut self, offset: u64, out: &mut [u8]) -> Result<bool> {
        if offset
            .checked_add(out.len() as u64)
            .is_none_or(|end| end > self.len)
        {
            return Ok(false);
        }
        let error = RecordingError::read(&self.path);
        match i64::try_from(offset).ok().zip(i64::try_from(self.at).ok()) {
            // Keeps the buffer where possible.
            Some((to, from)) => self.file.seek_relative(to - from),
            None => self.file.seek(SeekFrom::Start(offset)).map(drop),
        }
        .map_err(&error)?;
        self.at = offset;
        self.file.read_exact(out).map_err(&error)?;
        self.at += out.len() as u64;
        Ok(true)
    }

    /// Up to `len` bytes from `offset`; fewer at the end of the file.
    pub(crate) fn get(&mut self, offset: u64, len: u64) -> Result<Vec<u8>> {
        let mut out = vec![0; len.min(self.len.saturating_sub(offset)) as usize];
        self.fill(offset, &mut out)?;
        Ok(out)
    }

    /// The CRC-32 of up to `len` bytes from `offset`.
    pub(crate) fn crc(&mut self, offset: u64, len: u64) -> Result<crc32fast::Hasher> {
        const STEP: u64 = 1 << 20;
        let mut hasher = crc32fast::Hasher::new();
        let mut done = 0;
        while done < len {
            let step = self.get(offset + done, STEP.min(len - done))?;
            if step.is_empty() {
                break;
            }
            hasher.update(&step);
            done += step.len() as u64;
        }
        Ok(hasher)
    }
}

/// Number of cached blocks: colour and depth of one moment may lie in two, and their successors in a third.
const KEPT: usize = 3;

#[derive(Debug)]
pub(crate) struct BlockFile {
    pub(crate) bytes: Bytes,
    pub(crate) blocks: Vec<Block>,
}

/// Cache of decompressed blocks, and the remaining budget.
#[derive(Debug, Default)]
pub(crate) struct Blocks {
    /// By file and block number, the newest last.
    kept: Vec<((u16, u32), Vec<u8>)>,
    pub(crate) unpacking: Unpacking,
}

impl Blocks {
    /// Caches a block, and evicts the oldest beyond the limits.
    fn keep(&mut self, key: (u16, u32), block: Vec<u8>) {
        let mut bytes = block.len();
        self.kept.push((key, block));
        let rest = self.kept.iter().rev().skip(1).take(KEPT - 1);
        let fits = rest.take_while(|(_, b)| {
            bytes += b.len();
            bytes <= MOST_KEPT
        });
        let old = self.kept.len() - 1 - fits.count();
        self.kept.drain(..old);
    }
}

#[derive(Debug)]
pub(crate) enum Unpacked {
    Bytes(Vec<u8>, Option<String>),
    TooMuch,
}

impl BlockFile {
    pub(crate) fn new(bytes: Bytes) -> Self {
        Self {
            bytes,
            blocks: Vec::new(),
        }
    }

    pub(crate) fn unpack(&mut self, index: u32, unpacking: &mut Unpacking) -> Result<Unpacked> {
        let block = self.blocks[index as usize];
        let stored = self.bytes.get(block.offset, block.stored)?;
        let packed = stored.len() as u64;
        // Checks the stated size against the budget first, since decompression takes time.
        let effort = if block.how == Compression::Bzip2 {
            SLOW
        } else {
            1
        };
        if block.size.saturating_mul(effort) > unpacking.allowed(packed) {
            return Ok(Unpacked::TooMuch);
        }
        let (out, error) = decompress(block.how, &stored, block.size.min(LARGEST_BLOCK));
        unpacking.took(packed, effort * out.len() as u64);
        let missing = error.is_none() && out.len() as u64 != block.size;
        let error = error
            .or_else(|| missing.then(|| format!("{} bytes instead of {}", out.len(), block.size)));
        Ok(Unpacked::Bytes(out, error))
    }
}

impl Store for BlockFile {
    fn read(&mut self, place: &Place, blocks: &mut Blocks) -> Result<Vec<u8>> {
        let len = u64::from(place.len).min(LARGEST_IMAGE);
        let Some(block) = place.block else {
            return self.bytes.get(place.offset, len);
        };
        let key = (place.file, block);
        if let Some(at) = blocks.kept.iter().position(|(k, _)| *k == key) {
            let found = blocks.kept.remove(at);
            blocks.kept.push(found);
        } else {
            match self.unpack(block, &mut blocks.unpacking)? {
                // Errors were reported by the scan.
                Unpacked::Bytes(bytes, _) => blocks.keep(key, bytes),
                Unpacked::TooMuch => return Err(Unpacking::exceeded(&self.bytes.path)),
            }
        }
        let bytes = blocks.kept.last().map_or(&[][..], |(_, bytes)| bytes);
        let from = usize::try_from(place.offset).unwrap_or(usize::MAX);
        let from = from.min(bytes.len());
        let to = from.saturating_add(len as usize).min(bytes.len());
        Ok(bytes[from..to].to_vec())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn block_cache_is_bounded() {
        let mut blocks = Blocks::default();
        for i in 0..5 {
            blocks.keep((0, i), vec![0; 100 << 20]);
        }
        let kept = |blocks: &Blocks| blocks.kept.iter().map(|(k, _)| k.1).collect::<Vec<_>>();
        assert_eq!(kept(&blocks), [3, 4]);
        // The newest block is always kept, since it is needed.
        blocks.keep((1, 7), vec![0; MOST_KEPT]);
        assert_eq!(kept(&blocks), [7]);
        for i in 0..9 {
            blocks.keep((2, i), vec![0; 1 << 20]);
        }
        assert_eq!(kept(&blocks), [6, 7, 8]);
    }

    #[test]
    fn total_decompressed_size_of_chunks_is_bounded() {
        use std::io::Write;
        const SIZE: u64 = 1 << 20;
        let mut encoder = lz4_flex::frame::FrameEncoder::new(Vec::new());
        encoder.write_all(&vec![0; SIZE as usize]).unwrap();
        let packed = encoder.finish().unwrap();
        let mut chunk = vec![0; 16];
        chunk.extend(SIZE.to_le_bytes());
        chunk.extend([0, 0, 0, 0, 3, 0, 0, 0]);
        chunk.extend(b"lz4");
        chunk.extend((packed.len() as u64).to_le_bytes());
        chunk.extend(&packed);
        let mut file = super::super::mcap::MAGIC.to_vec();
        for _ in 0..9 {
            file.push(6);
            file.extend((chunk.len() as u64).to_le_bytes());
            file.extend(&chunk);
        }
        let folder = tempfile::tempdir().unwrap();
        let path = folder.path().join("zeros.mcap");
        std::fs::write(&path, file).unwrap();
        // Each chunk consumes the part beyond a hundred times its packed size.
        let beyond = SIZE - 100 * packed.len() as u64;
        let mut unpacking = Unpacking::of(4 * beyond);
        let bytes = Bytes::open(&path).unwrap();
        let (store, mut contents) = super::super::mcap::open(bytes, 0, &mut unpacking).unwrap();
        contents.finish();
        let said = contents.remarks.lines().join("\n");
        let at = 8 + 4 * (9 + chunk.len() as u64) + 9;
        let expected = format!("5 chunks, the first at byte {at}, are left out");
        assert!(said.contains(&expected), "{said}");
        // Reading has the same limit.
        let place = |block: u32| Place {
            file: 0,
            block: Some(block),
            offset: 0,
            len: 7,
        };
        let mut store = store;
        let mut blocks = Blocks {
            unpacking: Unpacking::of(beyond),
            ..Blocks::default()
        };
        assert_eq!(store.read(&place(0), &mut blocks).unwrap(), [0; 7]);
        assert_eq!(store.read(&place(0), &mut blocks).unwrap(), [0; 7]);
        let refused = store.read(&place(1), &mut blocks).unwrap_err().to_string();
        assert!(
            refused.contains("unpacks to at most 100 times"),
            "{refused}"
        );
    }
}
