//! A texture that can be rendered under any mapping.

use stillpoint_imaging::GrayImage;

/// Uniform noise from an integer hash of the position.
pub(crate) fn hash(x: i64, y: i64, seed: u64) -> u64 {
    let mut h = (x as u64).wrapping_mul(0x9e37_79b9_7f4a_7c15)
        ^ (y as u64).wrapping_mul(0xc2b2_ae3d_27d4_eb4f)
        ^ seed;
    h ^= h >> 29;
    h = h.wrapping_mul(0xbf58_476d_1ce4_e5b9);
    h ^= h >> 32;
    h
}

/// Grey value of an endless texture of tilted rectangles, sampled at any position.
fn texture(x: f64, y: f64) -> f64 {
    let mut value = 128.0;
    for (octave, cell) in [97.0, 41.0, 19.0].into_iter().enumerate() {
        let angle = 0.4 + octave as f64;
        let (sin, cos) = libm::sincos(angle);
        let (u, v) = (x * cos - y * sin, x * sin + y * cos);
        let (i, j) = ((u / cell).floor() as i64, (v / cell).floor() as i64);
        value += (hash(i, j, octave as u64) % 81) as f64 - 40.0;
    }
    value.clamp(0.0, 255.0)
}

/// An image whose pixel (x, y) is the mean of the texture around `map(x, y)`.
pub(crate) fn render(
    width: usize,
    height: usize,
    map: impl Fn(f64, f64) -> (f64, f64),
) -> GrayImage {
    let mut data = Vec::new();
    for y in 0..height {
        for x in 0..width {
            let mut sum = 0.0;
            for k in 0..16 {
                let (sx, sy) = (
                    f64::from(k % 4) / 4.0 - 0.375,
                    f64::from(k / 4) / 4.0 - 0.375,
                );
                let (u, v) = map(x as f64 + sx, y as f64 + sy);
                sum += texture(u, v);
            }
            data.push((sum / 16.0) as u8);
        }
    }
    GrayImage::from_vec(width, height, data).expect("as many pixels as the size asks for")
}
