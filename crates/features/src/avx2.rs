//! AVX2 kernels, each bit-identical to a scalar function. The only unsafe code of the crate.
#![allow(unsafe_code)]

mod describe;
mod fast;
mod flow;

use std::arch::x86_64::*;

use stillpoint_imaging::Simd;

use crate::{BestTwo, Descriptor, Searched, Window, matching};

pub(crate) use describe::{describe, moments};
pub(crate) use fast::{find_row_maxima, score_rows};
pub(crate) use flow::{compare_window, sample_window};

/// Called by every entry point, so that no instruction runs on a machine that lacks it. The detection is cached by the
/// standard library.
#[inline]
fn check() {
    assert!(Simd::Avx2.has_avx2(), "AVX2 kernel called without AVX2");
}

/// 32 bytes at `slice[index..]`.
///
/// # Safety
/// `index + 32 <= slice.len()`.
#[inline]
#[target_feature(enable = "avx2")]
unsafe fn load(slice: &[u8], index: usize) -> __m256i {
    debug_assert!(index + 32 <= slice.len());
    // SAFETY: the caller promises that the bytes are inside; the load needs no alignment.
    unsafe { _mm256_loadu_si256(slice.as_ptr().add(index).cast()) }
}

/// [`matching::best_two_portable`] with the POPCNT instruction.
pub(crate) fn best_two(
    searched: &Searched<'_>,
    window: &Window,
    descriptor: &Descriptor,
    accept: impl FnMut(u32) -> bool,
) -> Option<BestTwo> {
    /// Compiled with POPCNT.
    #[target_feature(enable = "popcnt")]
    fn kernel(
        searched: &Searched<'_>,
        window: &Window,
        descriptor: &Descriptor,
        accept: impl FnMut(u32) -> bool,
    ) -> Option<BestTwo> {
        matching::best_two_portable(searched, window, descriptor, accept)
    }
    check();
    // SAFETY: `check` has seen the instruction.
    unsafe { kernel(searched, window, descriptor, accept) }
}

/// [`matching::match_brute_force_portable`] with the POPCNT instruction.
pub(crate) fn match_brute_force(
    query: &[Descriptor],
    train: &[Descriptor],
    max_distance: u32,
    ratio: f32,
) -> Vec<Option<u32>> {
    /// Compiled with POPCNT.
    #[target_feature(enable = "popcnt")]
    fn kernel(
        query: &[Descriptor],
        train: &[Descriptor],
        max_distance: u32,
        ratio: f32,
    ) -> Vec<Option<u32>> {
        matching::match_brute_force_portable(query, train, max_distance, ratio)
    }
    check();
    // SAFETY: `check` has seen the instruction.
    unsafe { kernel(query, train, max_distance, ratio) }
}
