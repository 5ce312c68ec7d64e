//! Compression, block by block.
//!
//! A compressed section is a sequence of blocks of [`BLOCK`] bytes each (the last may be shorter). A block has a length of
//! four bytes and is either deflated (RFC 1951) or, where the highest bit of the length is set, as it was. Columns are written
//! in planes, so blocks are alike inside: those of noise are stored, and cost no time to read; those of exponents and ids
//! shrink to a fraction.

use super::MapFileError;
use miniz_oxide::deflate::compress_to_vec;
use miniz_oxide::inflate::decompress_slice_iter_to_slice;

/// Bytes per block before compression: several times the 32 kB that deflate looks back, and a fraction of a plane of a map.
const BLOCK: usize = 1 << 17;
/// Level of deflate.
const LEVEL: u8 = 4;
/// A section that is more than this many times longer than stored is refused, so that a small file cannot ask for much
/// memory; one that would be is not compressed when it is written. Sections of real maps shrink to a half at best.
const MAX_RATIO: usize = 32;
/// Marks a block that is as it was.
const AS_IT_WAS: u32 = 1 << 31;

/// The blocks; none when they are not worth it, or shrink implausibly much.
pub(super) fn pack(raw: &[u8]) -> Option<Vec<u8>> {
    let mut packed = Vec::new();
    for block in raw.chunks(BLOCK) {
        let deflated = (!is_noise(block)).then(|| compress_to_vec(block, LEVEL));
        // What shrinks by less than a tenth is not worth the time of reading it.
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

/// Whether a block need not be tried: all bytes are as frequent in it as all others, and so are all differences of neighbours,
/// which those of counted ids are not. Looking takes a hundredth of the time of deflating.
fn is_noise(block: &[u8]) -> bool {
    let neighbours = block.windows(2).map(|w| w[1].wrapping_sub(w[0]));
    is_even(block.iter().copied()) && is_even(neighbours)
}

/// Whether all bytes come nearly as often: the sum of the squares of their counts is within a twentieth of the least possible,
/// which leaves a code of at least 7.9 bits per byte. Few bytes are never even enough.
fn is_even(bytes: impl Iterator<Item = u8>) -> bool {
    let mut counts = [0u64; 256];
    for byte in bytes {
        counts[usize::from(byte)] += 1;
    }
    let sum: u64 = counts.iter().sum();
    let squares: u64 = counts.iter().map(|n| n * n).sum();
    sum > 0 && 20 * 256 * squares <= 21 * sum * sum
}

/// The bytes that the blocks of section `name` stand for.
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

/// Fills `block` with the first block of `packed`, and gives what follows.
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
