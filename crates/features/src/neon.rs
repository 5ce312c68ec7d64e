//! NEON kernels, each bit-identical to a scalar function. The only unsafe code of the crate on 64-bit Arm.
#![allow(unsafe_code)]

mod describe;
mod fast;
mod flow;

use std::arch::aarch64::*;

use stillpoint_imaging::Simd;

pub(crate) use describe::{describe, moments};
pub(crate) use fast::{find_row_maxima, score_rows};
pub(crate) use flow::{compare_window, sample_window};

/// Called by every entry point, so that no instruction runs on a machine that lacks it. Free of cost where all machines
/// of a target have NEON.
#[inline]
fn check() {
    assert!(Simd::Neon.has_neon(), "NEON kernel called without NEON");
}

/// 16 bytes at `slice[index..]`.
///
/// # Safety
/// `index + 16 <= slice.len()`.
#[inline]
#[target_feature(enable = "neon")]
unsafe fn load(slice: &[u8], index: usize) -> uint8x16_t {
    debug_assert!(index + 16 <= slice.len());
    // SAFETY: the caller promises that the bytes are inside; the load needs no alignment.
    unsafe { vld1q_u8(slice.as_ptr().add(index)) }
}

/// Twin of [`crate::Descriptor::distance_portable`]: the compiler uses the bit count instruction, but sums the counts
/// in more steps.
#[inline(always)]
pub(crate) fn distance(a: &[u64; 4], b: &[u64; 4]) -> u32 {
    check();
    // SAFETY: `check` has seen that the machine has NEON.
    unsafe { distance_kernel(a, b) }
}

#[inline]
#[target_feature(enable = "neon")]
fn distance_kernel(a: &[u64; 4], b: &[u64; 4]) -> u32 {
    // SAFETY: the arrays hold the 32 bytes read, in two halves each.
    let bits = |half: usize| unsafe {
        let (a, b) = (
            vld1q_u64(a.as_ptr().add(2 * half)),
            vld1q_u64(b.as_ptr().add(2 * half)),
        );
        vcntq_u8(vreinterpretq_u8_u64(veorq_u64(a, b)))
    };
    // At most 16 bits in two bytes.
    vaddlvq_u8(vaddq_u8(bits(0), bits(1))).into()
}
