//! Mip-mapped textures, sampled with a footprint. The patterns are painted by `patterns`.

mod canvas;
mod clothes;
mod patterns;
mod surfaces;

pub(crate) use patterns::Pattern;

use canvas::Canvas;

/// An RGB texture with its mip levels; periodic. Sides are powers of two.
pub(crate) struct Texture {
    levels: Vec<Level>,
}

struct Level {
    mask_s: i32,
    mask_t: i32,
    /// log2 of the width.
    shift: u32,
    /// 0x00GG_BBRR: the order that [`spread`] separates with one shift.
    texels: Vec<u32>,
}

/// The three channels of a texel in 16-bit lanes (R, G, B), so that one multiplication scales them all.
#[inline]
fn spread(texel: u32) -> u64 {
    u64::from(texel & 0x00FF_00FF) | (u64::from(texel & 0xFF00) << 24)
}

const LANES: u64 = 0x0000_00FF_00FF_00FF;
/// Rounds instead of truncating, to keep the mean colour.
const HALVES: u64 = 0x0000_0080_0080_0080;

/// `a` to `b` by `f` / 256 in each lane.
#[inline]
fn lerp(a: u64, b: u64, f: u64) -> u64 {
    // Lanes stay below 2^16, so that nothing wraps.
    let sum = a.wrapping_mul(256_u64.wrapping_sub(f));
    let sum = sum.wrapping_add(b.wrapping_mul(f));
    (sum.wrapping_add(HALVES) >> 8) & LANES
}

impl Level {
    fn new(canvas: &Canvas) -> Self {
        Self {
            mask_s: canvas.width as i32 - 1,
            mask_t: canvas.height as i32 - 1,
            shift: canvas.width.trailing_zeros(),
            texels: canvas.pixels.iter().map(|&p| pack(p)).collect(),
        }
    }

    /// Bilinear sample at texel coordinates in 1/256 texel, centres of texels at whole numbers.
    #[inline(always)]
    fn bilinear(&self, s: i32, t: i32) -> u64 {
        let (i, j) = (s >> 8, t >> 8);
        let (fs, ft) = ((s & 255) as u64, (t & 255) as u64);
        let (i0, i1) = (i & self.mask_s, i.wrapping_add(1) & self.mask_s);
        let j0 = (j & self.mask_t) << self.shift;
        let j1 = (j.wrapping_add(1) & self.mask_t) << self.shift;
        let texel = |k: i32| spread(self.texels[k as usize]);
        let top = lerp(texel(j0 | i0), texel(j0 | i1), fs);
        let bottom = lerp(texel(j1 | i0), texel(j1 | i1), fs);
        lerp(top, bottom, ft)
    }
}

fn pack(p: [f32; 3]) -> u32 {
    let byte = |v: f32| (v + 0.5).clamp(0.0, 255.0) as u32;
    byte(p[0]) | (byte(p[2]) << 8) | (byte(p[1]) << 16)
}

impl Texture {
    /// Paints a pattern; the same seed gives the same texture.
    pub(crate) fn paint(pattern: Pattern, seed: u64) -> Self {
        let mut canvas = pattern.paint(seed);
        let mut levels = vec![Level::new(&canvas)];
        while canvas.width > 1 || canvas.height > 1 {
            canvas = canvas.halved();
            levels.push(Level::new(&canvas));
        }
        Self { levels }
    }

    /// Width and height of the finest level, texels.
    pub(crate) fn size(&self) -> [f64; 2] {
        let level = &self.levels[0];
        [f64::from(level.mask_s + 1), f64::from(level.mask_t + 1)]
    }

    /// Trilinear sample at (s, t), in texels of the finest level from its corner; `footprint2` is the squared length in texels that one
    /// pixel spans. Returns RGB in 1/256 grey levels.
    #[inline]
    pub(crate) fn sample(&self, s: f32, t: f32, footprint2: f32) -> [f32; 3] {
        // Half the logarithm to base 2, with the mantissa taken linearly: at most 0.05 levels off, and deterministic.
        let bits = footprint2.max(1.0).to_bits();
        let log = (bits - 0x3F80_0000) >> 16;
        let last = (self.levels.len() - 1) as u32;
        let level = (log >> 8).min(last);
        let between = u64::from(log & 255);
        // From corners to centres of texels: half a texel of each level.
        let (s, t) = ((s * 256.0) as i32, (t * 256.0) as i32);
        let at = |l: u32| self.levels[l as usize].bilinear((s >> l) - 128, (t >> l) - 128);
        let fine = at(level);
        let coarse = if between == 0 {
            fine
        } else {
            at((level + 1).min(last))
        };
        let sum = fine * (256 - between) + coarse * between;
        let lane = |k: u32| ((sum >> (16 * k)) & 0xFFFF) as i32 as f32;
        [lane(0), lane(1), lane(2)]
    }
}

#[cfg(test)]
pub(crate) mod tests {
    use super::*;

    /// 64 x 64 texels; red is 2 s - 1 and green 3 t - 1.5 at (s, t).
    pub(crate) fn ramp() -> Texture {
        let mut canvas = Canvas::new(64, 64, [0.0; 3]);
        for y in 0..64 {
            for x in 0..64 {
                canvas.pixels[y * 64 + x] = [2.0 * x as f32, 3.0 * y as f32, 100.0];
            }
        }
        Texture {
            levels: vec![Level::new(&canvas), Level::new(&canvas.halved())],
        }
    }

    #[test]
    fn sampling_reproduces_a_linear_ramp_on_every_level() {
        let texture = ramp();
        for footprint in [0.5_f32, 1.0, 2.0, 3.9] {
            for (s, t) in [(10.5, 20.5), (17.25, 40.75), (33.0, 12.0)] {
                let [r, g, b] = texture.sample(s, t, footprint * footprint);
                // The centre of texel 0 is at 0.5.
                assert!(
                    (r / 256.0 - 2.0 * (s - 0.5)).abs() < 1.1,
                    "{r} at {s} {footprint}"
                );
                assert!(
                    (g / 256.0 - 3.0 * (t - 0.5)).abs() < 1.1,
                    "{g} at {t} {footprint}"
                );
                assert!((b / 256.0 - 100.0).abs() < 0.6);
            }
        }
    }

    #[test]
    fn wrapping_works_below_zero() {
        let texture = ramp();
        assert_eq!(
            texture.sample(-20.5, 5.0, 1.0),
            texture.sample(43.5, 5.0, 1.0)
        );
    }
}
