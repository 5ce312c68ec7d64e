//! Orientation of a keypoint by the intensity centroid (Rosin 1999; radius 15 as in Rublee et al., ICCV 2011).

use stillpoint_imaging::{GrayImage, Simd};

/// Radius of the disc, px (Rublee et al. 2011).
pub(crate) const RADIUS: usize = 15;

/// Half of the length of the disc's rows at distance 0, 1, ..., 15 from the centre, px: `round(sqrt(15^2 - v^2))`, made
/// symmetric about the diagonal.
pub(crate) const HALF_WIDTHS: [usize; RADIUS + 1] =
    [15, 15, 15, 15, 14, 14, 14, 13, 13, 12, 11, 10, 9, 8, 6, 3];

/// First moments (m10, m01) of the disc around (x, y), which is at least 15 px from the border.
pub(crate) fn moments(image: &GrayImage, x: usize, y: usize, simd: Simd) -> (i32, i32) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::moments(image, x, y);
    }
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::moments(image, x, y);
    }
    let _ = simd;
    moments_scalar(image, x, y)
}

/// Twin of the vector kernel.
pub(crate) fn moments_scalar(image: &GrayImage, x: usize, y: usize) -> (i32, i32) {
    let (mut m10, mut m01) = (0, 0);
    for row in 0..=2 * RADIUS {
        let v = row as i32 - RADIUS as i32;
        let half = HALF_WIDTHS[v.unsigned_abs() as usize];
        let pixels = &image.row(y + row - RADIUS)[x - half..=x + half];
        let mut sum = 0;
        for (u, &pixel) in pixels.iter().enumerate() {
            m10 += (u as i32 - half as i32) * i32::from(pixel);
            sum += i32::from(pixel);
        }
        m01 += v * sum;
    }
    (m10, m01)
}

/// Cosine and sine of the direction (m10, m01); (1, 0) if undefined.
pub(crate) fn direction(moments: (i32, i32)) -> (f32, f32) {
    let (x, y) = (moments.0 as f32, moments.1 as f32);
    let norm = (x * x + y * y).sqrt();
    if norm > 0.0 {
        (x / norm, y / norm)
    } else {
        (1.0, 0.0)
    }
}
