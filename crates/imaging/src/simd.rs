//! Instruction set of the kernels, detected at run time. Kernels are in the modules that use them; each is
//! bit-identical to a scalar twin, so the choice affects only speed.

/// Instruction set for kernels. Chosen once at start and passed to constructors. Unavailable instruction sets are safe:
/// the scalar twins run instead.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub enum Simd {
    /// Portable code.
    #[default]
    Scalar,
    /// 256-bit integer and float vectors of x86-64.
    Avx2,
    /// 128-bit integer and float vectors of 64-bit Arm.
    Neon,
}

impl Simd {
    /// The fastest instruction set of this machine.
    #[must_use]
    pub fn detect() -> Self {
        if Simd::Avx2.has_avx2() {
            Simd::Avx2
        } else if Simd::Neon.has_neon() {
            Simd::Neon
        } else {
            Simd::Scalar
        }
    }

    /// Whether AVX2 kernels are selected *and* available. Checked before every call into AVX2 code, for soundness.
    #[must_use]
    #[inline]
    pub fn has_avx2(self) -> bool {
        #[cfg(target_arch = "x86_64")]
        {
            self == Simd::Avx2
                && std::arch::is_x86_feature_detected!("avx2")
                && std::arch::is_x86_feature_detected!("popcnt")
        }
        #[cfg(not(target_arch = "x86_64"))]
        {
            false
        }
    }

    /// Whether NEON kernels are selected *and* available; all 64-bit Arm processors that run an operating system have
    /// NEON.
    #[must_use]
    #[inline]
    pub fn has_neon(self) -> bool {
        #[cfg(target_arch = "aarch64")]
        {
            self == Simd::Neon && std::arch::is_aarch64_feature_detected!("neon")
        }
        #[cfg(not(target_arch = "aarch64"))]
        {
            false
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Tests compare scalar code with the detected kernels: failing detection would make them trivial.
    #[test]
    fn detected_instructions_match_the_architecture() {
        let arm = cfg!(target_arch = "aarch64");
        assert_eq!(Simd::detect() == Simd::Neon, arm);
        assert_eq!(Simd::Neon.has_neon(), arm);
        assert!(!arm || !Simd::Avx2.has_avx2());
        for other in [Simd::Scalar, Simd::Avx2] {
            assert!(!other.has_neon());
        }
        for other in [Simd::Scalar, Simd::Neon] {
            assert!(!other.has_avx2());
        }
    }
}
