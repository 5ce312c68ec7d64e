//! A file with compressed blocks in it: reading at any place, with the blocks that were used last kept decompressed.

use super::{LARGEST_BLOCK, LARGEST_MESSAGE, Place, Store};
use crate::error::{RecordingError, Result};
use std::fs::File;
use std::io::{BufReader, Read, Seek, SeekFrom};
use std::path::{Path, PathBuf};

/// How bytes were compressed.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Compression {
    Zstd,
    Lz4,
    Bzip2,
}

impl Compression {
    /// By the name that MCAP and ROS 1 give it; `None` within for none.
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

/// Decompresses, up to `largest` bytes. What came before an error is given as well: it is what a cut-off file still holds.
pub(crate) fn decompress(
    how: Compression,
    bytes: &[u8],
    largest: u64,
) -> (Vec<u8>, Option<String>) {
    let mut out = Vec::new();
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
            Ok(mut decoder) => read(&mut decoder),
            Err(e) => Some(e.to_string()),
        },
    };
    (out, error)
}

/// A compressed block, where it lies.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Block {
    pub(crate) offset: u64,
    pub(crate) stored: u64,
    pub(crate) size: u64,
    pub(crate) how: Compression,
}

/// A file that is read at any place.
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

    /// Fills `out` from `offset` on; false where the file ends before.
    pub(crate) fn fill(&mut self, offset: u64, out: &mut [u8]) -> Result<bool> {
        if offset
            .checked_add(out.len() as u64)
            .is_none_or(|end| end > self.len)
        {
            return Ok(false);
        }
        let error = RecordingError::read(&self.path);
        match i64::try_from(offset).ok().zip(i64::try_from(self.at).ok()) {
            // What is in the buffer already is not read again.
            Some((to, from)) => self.file.seek_relative(to - from),
            None => self.file.seek(SeekFrom::Start(offset)).map(drop),
        }
        .map_err(&error)?;
        self.at = offset;
        self.file.read_exact(out).map_err(&error)?;
        self.at += out.len() as u64;
        Ok(true)
    }

    /// At most `len` bytes from `offset` on: fewer where the file ends.
    pub(crate) fn get(&mut self, offset: u64, len: u64) -> Result<Vec<u8>> {
        let mut out = vec![0; len.min(self.len.saturating_sub(offset)) as usize];
        self.fill(offset, &mut out)?;
        Ok(out)
    }
}

/// Decompressed blocks that are kept: colour and depth of one moment may lie in two, and their next ones in a third.
const KEPT: usize = 3;

/// A file with its blocks.
#[derive(Debug)]
pub(crate) struct BlockFile {
    pub(crate) bytes: Bytes,
    pub(crate) blocks: Vec<Block>,
    /// Those that were used last, the newest last.
    kept: Vec<(u32, Vec<u8>)>,
}

impl BlockFile {
    pub(crate) fn new(bytes: Bytes) -> Self {
        Self {
            bytes,
            blocks: Vec::new(),
            kept: Vec::new(),
        }
    }

    /// Decompresses a block, and keeps it. What is wrong with it is said in words.
    pub(crate) fn load(&mut self, index: u32) -> Result<(&[u8], Option<String>)> {
        let mut error = None;
        if let Some(at) = self.kept.iter().position(|(i, _)| *i == index) {
            let found = self.kept.remove(at);
            self.kept.push(found);
        } else {
            let block = self.blocks[index as usize];
            let stored = self.bytes.get(block.offset, block.stored)?;
            let (out, e) = decompress(block.how, &stored, block.size.min(LARGEST_BLOCK));
            error = e;
            if self.kept.len() >= KEPT {
                self.kept.remove(0);
            }
            self.kept.push((index, out));
        }
        let bytes = self.kept.last().map_or(&[][..], |(_, bytes)| bytes);
        Ok((bytes, error))
    }
}

impl Store for BlockFile {
    fn read(&mut self, place: &Place) -> Result<Vec<u8>> {
        let len = u64::from(place.len).min(LARGEST_MESSAGE);
        let Some(block) = place.block else {
            return self.bytes.get(place.offset, len);
        };
        let (bytes, _) = self.load(block)?;
        let from = usize::try_from(place.offset).unwrap_or(usize::MAX);
        let from = from.min(bytes.len());
        let to = from.saturating_add(len as usize).min(bytes.len());
        Ok(bytes[from..to].to_vec())
    }
}
