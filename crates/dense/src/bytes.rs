//! Serialises a dense map, as stored in a map file.
//!
//! Little-endian: `SPDENSE2`; voxel, truncation, side of a cell, farthest depth (doubles); number of blocks of voxels and of cells (4
//! each); the blocks by key: z, y, x (4 each), then 512 distances (2 each), weights (2 each) and colours (4 each); likewise the cells, with
//! counts of frames in which they were free and crossed, and the time for which an arrived surface was seen, hundredths of a second (2
//! each).

use crate::block::{Block, Blocks, Key, VOXELS};
use crate::cells::CellBlock;
use crate::config::DenseConfig;
use crate::world::DenseMap;
use stillpoint_imaging::Simd;

const MAGIC: &[u8; 8] = b"SPDENSE2";
const HEAD: usize = 8 + 4 * 8 + 2 * 4;
const BLOCK: usize = 12 + 8 * VOXELS;
const CELLS: usize = 12 + 6 * VOXELS;

/// Why bytes are not a dense map.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum DenseBytesError {
    /// Wrong signature.
    #[error(
        "expected a dense map (SPDENSE2), found other bytes; fuse the recording again with --dense"
    )]
    Kind,
    /// Wrong size.
    #[error(
        "expected a dense map of {expected} bytes, found {found}; it is damaged: fuse the recording again with --dense"
    )]
    Length {
        /// By the header.
        expected: u64,
        /// Number of bytes.
        found: u64,
    },
    /// An impossible value.
    #[error(
        "expected a dense map, found {0}; it is damaged: fuse the recording again with --dense"
    )]
    Value(String),
}

impl DenseMap {
    /// Name of the extension in map files.
    pub const EXTENSION: &'static str = "stillpoint/dense";

    /// Serialises the map; equal maps give equal bytes.
    #[must_use]
    pub fn to_bytes(&self) -> Vec<u8> {
        let (voxels, cells) = (self.volume.blocks.sorted(), self.cells.blocks.sorted());
        let mut out = Vec::with_capacity(HEAD + voxels.len() * BLOCK + cells.len() * CELLS);
        out.extend(MAGIC);
        let (v, c) = (&self.volume, &self.cells);
        for value in [v.voxel, v.truncation, c.side, self.max_depth()] {
            out.extend(value.to_le_bytes());
        }
        for count in [voxels.len(), cells.len()] {
            out.extend((count as u32).to_le_bytes());
        }
        for (key, number) in voxels {
            let b = v.blocks.get(number);
            out.extend(key.0.iter().flat_map(|k| k.to_le_bytes()));
            out.extend(b.distance.iter().flat_map(|d| d.to_le_bytes()));
            out.extend(b.weight.iter().flat_map(|w| w.to_le_bytes()));
            out.extend(b.colour.iter().flat_map(|c| c.to_le_bytes()));
        }
        for (key, number) in cells {
            let b = c.blocks.get(number);
            out.extend(key.0.iter().flat_map(|k| k.to_le_bytes()));
            out.extend(b.free.iter().flat_map(|n| n.to_le_bytes()));
            out.extend(b.crossed.iter().flat_map(|n| n.to_le_bytes()));
            out.extend(b.arrived.iter().flat_map(|n| n.to_le_bytes()));
        }
        out
    }

    /// Deserialises a map. Memory and time are proportional to the bytes.
    ///
    /// # Errors
    /// [`DenseBytesError`] for any invalid bytes.
    pub fn from_bytes(bytes: &[u8], simd: Simd) -> Result<Self, DenseBytesError> {
        if !bytes.starts_with(MAGIC) || bytes.len() < HEAD {
            return Err(DenseBytesError::Kind);
        }
        let mut reader = Reader(&bytes[8..]);
        let [voxel, truncation, cell, max_depth] = std::array::from_fn(|_| reader.double());
        let [blocks, cells] = std::array::from_fn(|_| u64::from(reader.word()));
        let expected = HEAD as u64 + blocks * BLOCK as u64 + cells * CELLS as u64;
        let found = bytes.len() as u64;
        if expected != found {
            return Err(DenseBytesError::Length { expected, found });
        }
        let config = DenseConfig {
            voxel,
            cell,
            max_depth,
            ..DenseConfig::default()
        };
        config
            .validate()
            .map_err(|e| DenseBytesError::Value(e.to_string()))?;
        if truncation != config.truncation() {
            let said = format!("a truncation of {truncation} m at voxels of {voxel} m");
            return Err(DenseBytesError::Value(said));
        }
        let mut map = Self::new(&config, simd);
        let mut last = None;
        for _ in 0..blocks {
            let block = reader.block(&mut last, &mut map.volume.blocks)?;
            block.distance = std::array::from_fn(|_| reader.half() as i16);
            block.weight = std::array::from_fn(|_| reader.half());
            block.colour = std::array::from_fn(|_| reader.word());
        }
        last = None;
        for _ in 0..cells {
            let block = reader.block(&mut last, &mut map.cells.blocks)?;
            block.free = std::array::from_fn(|_| reader.half());
            block.crossed = std::array::from_fn(|_| reader.half());
            block.arrived = std::array::from_fn(|_| reader.half());
        }
        Ok(map)
    }
}

struct Reader<'a>(&'a [u8]);

impl Reader<'_> {
    fn take<const N: usize>(&mut self) -> [u8; N] {
        let (head, rest) = self.0.split_first_chunk().unwrap_or((&[0; N], &[]));
        self.0 = rest;
        *head
    }

    fn half(&mut self) -> u16 {
        u16::from_le_bytes(self.take())
    }

    fn word(&mut self) -> u32 {
        u32::from_le_bytes(self.take())
    }

    fn double(&mut self) -> f64 {
        f64::from_le_bytes(self.take())
    }

    /// Reads the block of the next key, which must follow the last one.
    fn block<'b, B: Clone + Default>(
        &mut self,
        last: &mut Option<Key>,
        blocks: &'b mut Blocks<B>,
    ) -> Result<&'b mut B, DenseBytesError> {
        let key = Key(std::array::from_fn(|_| self.word() as i32));
        if last.replace(key).is_some_and(|last| last >= key) {
            let said = format!("block {:?} out of order", key.xyz());
            return Err(DenseBytesError::Value(said));
        }
        if key.0.iter().any(|k| k.unsigned_abs() > 1 << 27) {
            let said = format!("block {:?}, which is nowhere", key.xyz());
            return Err(DenseBytesError::Value(said));
        }
        let number = blocks.find_or_make(key);
        Ok(blocks.get_mut(number))
    }
}

const _: () = assert!(size_of::<Block>() == BLOCK - 12 && size_of::<CellBlock>() == CELLS - 12);
