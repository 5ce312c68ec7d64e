//! Addressed random numbers, and the number of RANSAC samples.
//!
//! There is no persistent random state: a stream is derived from the run's seed, the frame and its purpose, so results
//! do not depend on earlier draws.

/// Purpose of random numbers: streams of different purposes are independent. The constants are used by the library;
/// other users choose numbers from 1000 on.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Purpose(pub u64);

impl Purpose {
    /// Samples of the fundamental matrix.
    pub const FUNDAMENTAL: Self = Self(1);
    /// Samples of the homography.
    pub const HOMOGRAPHY: Self = Self(2);
    /// Samples of the camera's motion between two frames.
    pub const CAMERA_MOTION: Self = Self(3);
    /// Samples of the pose of a lost camera from a keyframe's landmarks.
    pub const RELOCALISATION: Self = Self(4);
    /// Samples of depths inside a box.
    pub const DEPTH: Self = Self(5);
    /// Samples of the motion between two keyframes.
    pub const RIGID: Self = Self(6);
    /// Samples of the motion between a keyframe and a frame that does not match the last one.
    pub const KEYFRAME_MOTION: Self = Self(8);
    /// Samples of the pose of a camera that has drifted off the map.
    pub const REGAINED_MAP: Self = Self(9);
    /// Samples of the motion between two frames by descriptors.
    pub const FIRST_MOTION: Self = Self(10);
}

/// A stream of random numbers (SplitMix64: Steele, Lea, Flood, "Fast splittable pseudorandom number generators", OOPSLA
/// 2014). Made by [`rng`].
#[derive(Clone, Debug)]
pub struct Rng {
    state: u64,
}

/// Step of the stream: 2^64 over the golden ratio, made odd (Steele, Lea, Flood 2014).
const GOLDEN: u64 = 0x9e37_79b9_7f4a_7c15;

/// The finaliser of SplitMix64, a bijection that mixes all bits.
fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xbf58_476d_1ce4_e5b9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94d0_49bb_1331_11eb);
    z ^ (z >> 31)
}

/// Unique address for a search that concerns a frame and something else, such as a keyframe or an object.
#[must_use]
pub fn address(frame: u32, about: u32) -> u64 {
    u64::from(frame) << 32 | u64::from(about)
}

/// The stream for a run's seed, a frame's id (or [`address`]) and a purpose, equal on every machine. Every search has
/// its own purpose, so that no two use the same numbers.
#[must_use]
pub fn rng(seed: u64, frame: u64, purpose: Purpose) -> Rng {
    let a = mix(seed.wrapping_add(GOLDEN));
    let b = mix(a ^ frame.wrapping_mul(0xd1b5_4a32_d192_ed03));
    Rng {
        state: mix(b.wrapping_add(purpose.0.wrapping_mul(GOLDEN))),
    }
}

impl Rng {
    /// 64 random bits.
    pub fn bits(&mut self) -> u64 {
        self.state = self.state.wrapping_add(GOLDEN);
        mix(self.state)
    }

    /// Uniform in [0, 1).
    pub fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in `0..count`, for counts below 2^32; 0 if `count` is 0.
    pub fn below(&mut self, count: usize) -> usize {
        (((self.bits() >> 32) * count as u64) >> 32) as usize
    }

    /// `N` different indices in `0..count`; `None` if there are fewer.
    pub fn distinct<const N: usize>(&mut self, count: usize) -> Option<[usize; N]> {
        if count < N {
            return None;
        }
        let mut chosen = [0; N];
        for i in 0..N {
            // Floyd's method (Bentley, Floyd, "A sample of brilliance", 1987): one draw per index, no rejection.
            let last = count - N + i;
            let draw = self.below(last + 1);
            chosen[i] = if chosen[..i].contains(&draw) {
                last
            } else {
                draw
            };
        }
        Some(chosen)
    }
}

/// Number of samples of `size` after which one is free of outliers with probability `confidence`, given the inlier
/// share `inliers`: `log(1 - P) / log(1 - w^N)` (Fischler, Bolles 1981), limited to `range` (minimum, maximum).
#[must_use]
pub fn ransac_iterations(
    confidence: f64,
    inliers: f64,
    size: usize,
    range: (usize, usize),
) -> usize {
    let good = (0..size).fold(1.0, |p, _| p * inliers);
    let (least, most) = (range.0.min(range.1), range.1);
    // Outside (0, 1) the logarithms are undefined: the maximum without good samples, the minimum with only good ones.
    if good.is_nan() || good <= 1e-12 {
        return most;
    }
    if good >= 1.0 {
        return least;
    }
    let miss = (1.0 - confidence).clamp(1e-12, 1.0);
    let needed = libm::ceil(libm::log(miss) / libm::log1p(-good));
    if needed >= most as f64 {
        most
    } else {
        (needed as usize).clamp(least, most)
    }
}
