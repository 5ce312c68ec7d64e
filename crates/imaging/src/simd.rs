//! Which instruction set the kernels run on.
//!
//! Answers: what this machine can do, detected at run time. Kernels live beside their users; each has a scalar twin that gives the same bits,
//! so the choice changes the speed and nothing else.

/// Instruction set that kernels are dispatched to. Chosen once, at start, and passed to constructors.
///
/// Asking for an instruction set that the machine does not have is safe: the kernels then run their scalar twins.
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

    /// Whether AVX2 kernels were asked for *and* can run here. Kernels ask this before every call into AVX2 code, which keeps them sound.
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

    /// Whether NEON kernels were asked for *and* can run here: all 64-bit Arm processors that run an operating system have them.
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

    /// Tests compare scalar code with what is detected: where nothing were, they would compare it with itself.
    #[test]
    fn only_what_the_machine_has_is_found() {
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
