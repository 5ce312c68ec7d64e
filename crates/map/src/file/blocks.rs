//! Block-wise compression.
//!
//! A compressed section is a sequence of blocks of [`BLOCK`] bytes each (the last may be shorter). A block starts with
//! a length of four bytes and is either deflated (RFC 1951) or, when the highest bit of the length is set, stored
//! uncompressed. Columns are written in planes, so blocks are homogeneous: blocks of noise are stored and cost no time
//! to read; those of exponents and ids shrink to a fraction.

use super::MapFileError;
use miniz_oxide::deflate::compress_to_vec;
use miniz_oxide::inflate::decompress_slice_iter_to_slice;

/// Bytes per block before compression: several times deflate's window of 32 kB, and a fraction of a plane of a map.
const BLOCK: usize = 1 << 17;
/// Deflate level.
const LEVEL: u8 = 4;
/// Maximum compression ratio of a section. Those beyond it are rejected when read, so that a small file cannot demand much
/// memory, and stored uncompressed when written. Sections of real maps shrink to a half at best.
const MAX_RATIO: usize = 32;
/// Flag of an uncompressed block.
const AS_IT_WAS: u32 = 1 << 31;

/// The blocks; `None` when compression is not worthwhile or exceeds the ratio.
pub(super) fn pack(raw: &[u8]) -> Option<Vec<u8>> {
    let mut packed = Vec::new();
    for block in raw.chunks(BLOCK) {
        let deflated = (!is_noise(block)).then(|| compress_to_vec(block, LEVEL));
        // A saving of less than a tenth is not worth the time of reading it.
        match deflated.filter(|d| d.len() < block.len() / 10 * 9) {
            Some(deflated) => {
                packed.extend((deflated.len() as u32).to_le_bytes());
                packed.extend(deflated);
            }
            None => {
                packed.extend((block.len() as u32 | AS_IT_WAS).to_le_bytes());
                packed.extend(block);
            }
        }
    }
    let worth_it = packed.len() < raw.len();
    (worth_it && raw.len() <= packed.len().saturating_mul(MAX_RATIO)).then_some(packed)
}

/// Whether a block is not worth trying: all bytes are equally frequent, and so are differences of neighbours (which
/// excludes consecutive ids). Takes a hundredth of the time of deflating.
fn is_noise(block: &[u8]) -> bool {
    let neighbours = block.windows(2).map(|w| w[1].wrapping_sub(w[0]));
    is_even(block.iter().copied()) && is_even(neighbours)
}

/// Whether bytes are nearly uniformly distributed: the sum of squared counts is within a twentieth of the minimum, i.e.
/// at least 7.9 bits per byte. A few bytes are never uniform enough.
fn is_even(bytes: impl Iterator<Item = u8>) -> bool {
    let mut counts = [0u64; 256];
    for byte in bytes {
        counts[usize::from(byte)] += 1;
    }
    let sum: u64 = counts.iter().sum();
    let squares: u64 = counts.iter().map(|n| n * n).sum();
    sum > 0 && 20 * 256 * squares <= 21 * sum * sum
}

pub(super) fn unpack(name: &str, packed: &[u8], length: u64) -> Result<Vec<u8>, MapFileError> {
    let most = packed.len().saturating_mul(MAX_RATIO);
    let length = match usize::try_from(length) {
        Ok(length) if length <= most => length,
        _ => {
            return Err(MapFileError::invalid(
                name,
                format!("at most {most} bytes, {MAX_RATIO} times the stored ones"),
                length,
            ));
        }
    };
    let mut raw = vec![0; length];
    let mut rest = packed;
    for (number, block) in raw.chunks_mut(BLOCK).enumerate() {
        rest = unpack_block(rest, block).ok_or_else(|| {
            MapFileError::invalid(
                name,
                format!("compressed block {number} of {} bytes", block.len()),
                "something else",
            )
        })?;
    }
    if !rest.is_empty() {
        let more = format!("{} bytes more", rest.len());
        return Err(MapFileError::invalid(
            name,
            "nothing after the last block",
            more,
        ));
    }
    Ok(raw)
}

/// Fills `block` from the first block of `packed`; returns the rest.
fn unpack_block<'a>(packed: &'a [u8], block: &mut [u8]) -> Option<&'a [u8]> {
    let (length, rest) = packed.split_first_chunk::<4>()?;
    let length = u32::from_le_bytes(*length);
    let (stored, after) = rest.split_at_checked((length & !AS_IT_WAS) as usize)?;
    if length & AS_IT_WAS != 0 {
        if stored.len() != block.len() {
            return None;
        }
        block.copy_from_slice(stored);
    } else {
        let written =
            decompress_slice_iter_to_slice(block, std::iter::once(stored), false, true).ok()?;
        if written != block.len() {
            return None;
        }
    }
    Some(after)
}
