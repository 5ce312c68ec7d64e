//! Addressed random numbers: every draw is a pure function of a seed, a purpose and an index. There is no state, so that frames can be
//! rendered in any order.

/// Purpose of a random number; equal indices with different purposes are independent.
#[derive(Clone, Copy)]
pub(crate) enum Purpose {
    Colour = 1,
    Depth = 2,
    Holes = 3,
    Path = 4,
    Texture = 5,
    Layout = 6,
    People = 7,
    Detections = 8,
    Lateral = 9,
    Matching = 10,
    Distortion = 11,
    Inertial = 12,
    /// Errors of wheel odometry.
    Odometry = 13,
}

/// The finaliser of SplitMix64 (Steele, Lea and Flood, OOPSLA 2014): a well mixing bijection of 64 bits.
#[inline]
pub(crate) fn mix(mut z: u64) -> u64 {
    z = (z ^ (z >> 30)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
    z = (z ^ (z >> 27)).wrapping_mul(0x94D0_49BB_1331_11EB);
    z ^ (z >> 31)
}

/// A key for (seed, purpose, index).
pub(crate) fn key(seed: u64, purpose: Purpose, index: u64) -> u64 {
    let a = mix(seed.wrapping_add(0x9E37_79B9_7F4A_7C15));
    let b = mix(a ^ (purpose as u64).wrapping_mul(0xD1B5_4A32_D192_ED03));
    mix(b.wrapping_add(index.wrapping_mul(0x9E37_79B9_7F4A_7C15)))
}

/// The `index`-th 64 random bits of a key.
#[inline]
pub(crate) fn bits(key: u64, index: u64) -> u64 {
    mix(key.wrapping_add(index.wrapping_mul(0x9E37_79B9_7F4A_7C15)))
}

/// A sequential stream for building scenes and textures.
pub(crate) struct Stream {
    key: u64,
    next: u64,
}

impl Stream {
    pub(crate) fn new(seed: u64, purpose: Purpose, index: u64) -> Self {
        Self {
            key: key(seed, purpose, index),
            next: 0,
        }
    }

    pub(crate) fn bits(&mut self) -> u64 {
        self.next += 1;
        bits(self.key, self.next)
    }

    /// Uniform in [0, 1).
    pub(crate) fn unit(&mut self) -> f64 {
        (self.bits() >> 11) as f64 / (1_u64 << 53) as f64
    }

    /// Uniform in [low, high).
    pub(crate) fn range(&mut self, low: f64, high: f64) -> f64 {
        low + (high - low) * self.unit()
    }

    pub(crate) fn below(&mut self, count: usize) -> usize {
        (((self.bits() >> 32) * count as u64) >> 32) as usize
    }

    pub(crate) fn chance(&mut self, p: f64) -> bool {
        self.unit() < p
    }
}

/// Quantiles of the standard normal distribution: a draw is one look-up with 12 random bits.
pub(crate) struct Normal {
    quantiles: Vec<f32>,
}

impl Normal {
    const SIZE: usize = 4096;

    pub(crate) fn new() -> Self {
        let mut quantiles = vec![0.0; Self::SIZE];
        for i in 0..Self::SIZE / 2 {
            // Solves erf(x / sqrt 2) = 2 p - 1 for the upper half by bisection; the lower half is its mirror image.
            let target = (2.0 * i as f64 + 1.0) / Self::SIZE as f64;
            let (mut low, mut high) = (0.0_f64, 6.0_f64);
            for _ in 0..40 {
                let middle = 0.5 * (low + high);
                if libm::erf(middle * std::f64::consts::FRAC_1_SQRT_2) < target {
                    low = middle;
                } else {
                    high = middle;
                }
            }
            quantiles[Self::SIZE / 2 + i] = low as f32;
            quantiles[Self::SIZE / 2 - 1 - i] = -low as f32;
        }
        Self { quantiles }
    }

    /// A standard normal number from the 12 lowest bits.
    #[inline]
    pub(crate) fn at(&self, bits: u64) -> f32 {
        self.quantiles[bits as usize & (Self::SIZE - 1)]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn normal_numbers_have_mean_zero_and_variance_one() {
        let (normal, n) = (Normal::new(), 200_000);
        let (mut sum, mut squares) = (0.0, 0.0);
        for i in 0..n {
            let x = f64::from(normal.at(bits(7, i)));
            sum += x;
            squares += x * x;
        }
        assert!((sum / n as f64).abs() < 0.01);
        assert!((squares / n as f64 - 1.0).abs() < 0.02);
    }

    #[test]
    fn keys_differ_by_seed_purpose_and_index() {
        let base = key(1, Purpose::Colour, 1);
        assert_ne!(base, key(2, Purpose::Colour, 1));
        assert_ne!(base, key(1, Purpose::Depth, 1));
        assert_ne!(base, key(1, Purpose::Colour, 2));
    }
}
