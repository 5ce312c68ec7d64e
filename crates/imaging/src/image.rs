//! Owned images, row by row without padding.

/// The length of the data does not match the image size.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct SizeError {
    /// Number of elements expected.
    pub expected: usize,
    /// Number of elements found.
    pub found: usize,
}

impl std::fmt::Display for SizeError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(
            f,
            "expected {} image elements, found {}",
            self.expected, self.found
        )
    }
}

impl std::error::Error for SizeError {}

fn elements(channels: usize, width: usize, height: usize) -> usize {
    let pixels = width.checked_mul(height);
    pixels
        .and_then(|n| n.checked_mul(channels))
        .unwrap_or(usize::MAX)
}

fn check(expected: usize, found: usize) -> Result<(), SizeError> {
    if expected == found {
        Ok(())
    } else {
        Err(SizeError { expected, found })
    }
}

/// An 8-bit grey image of `height` x `width`.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct GrayImage {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl GrayImage {
    /// A black image.
    ///
    /// # Panics
    /// If the size exceeds memory.
    #[must_use]
    pub fn new(width: usize, height: usize) -> Self {
        Self {
            width,
            height,
            data: vec![0; elements(1, width, height)],
        }
    }

    /// From rows of pixels.
    ///
    /// # Errors
    /// [`SizeError`] unless `data.len() == width * height`.
    pub fn from_vec(width: usize, height: usize, data: Vec<u8>) -> Result<Self, SizeError> {
        check(elements(1, width, height), data.len())?;
        Ok(Self {
            width,
            height,
            data,
        })
    }

    /// Resizes the image, reusing the allocation where possible. The content is unspecified afterwards.
    ///
    /// # Panics
    /// If the size exceeds memory.
    pub fn resize(&mut self, width: usize, height: usize) {
        self.data.resize(elements(1, width, height), 0);
        (self.width, self.height) = (width, height);
    }

    /// Width, px.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, row by row.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// All pixels, row by row.
    pub fn data_mut(&mut self) -> &mut [u8] {
        &mut self.data
    }

    /// One row of pixels. Panics when `y` is outside.
    #[must_use]
    pub fn row(&self, y: usize) -> &[u8] {
        &self.data[y * self.width..(y + 1) * self.width]
    }

    /// One pixel. Panics when outside.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> u8 {
        debug_assert!(x < self.width);
        self.data[y * self.width + x]
    }
}

/// An 8-bit RGB image of `height` x `width`, interleaved.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct ColourImage {
    width: usize,
    height: usize,
    data: Vec<u8>,
}

impl ColourImage {
    /// From rows of interleaved RGB pixels.
    ///
    /// # Errors
    /// [`SizeError`] unless `data.len() == 3 * width * height`.
    pub fn from_vec(width: usize, height: usize, data: Vec<u8>) -> Result<Self, SizeError> {
        check(elements(3, width, height), data.len())?;
        Ok(Self {
            width,
            height,
            data,
        })
    }

    /// Width, px.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All pixels, interleaved RGB, row by row.
    #[must_use]
    pub fn data(&self) -> &[u8] {
        &self.data
    }

    /// Returns the pixel buffer, for reuse.
    #[must_use]
    pub fn into_vec(self) -> Vec<u8> {
        self.data
    }

    /// One pixel as RGB. Panics when outside.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> [u8; 3] {
        let i = 3 * (y * self.width + x);
        [self.data[i], self.data[i + 1], self.data[i + 2]]
    }

    /// The grey image: `(77 R + 150 G + 29 B + 128) / 256`, the ITU-R BT.601 luma in integers.
    #[must_use]
    pub fn to_gray(&self) -> GrayImage {
        let mut gray = GrayImage::new(self.width, self.height);
        luma(&self.data, &mut gray.data, crate::Simd::detect());
        gray
    }
}

/// The luma of interleaved pixels, bit-identical for all instruction sets.
pub(crate) fn luma(rgb: &[u8], out: &mut [u8], simd: crate::Simd) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::luma(rgb, out);
    }
    let _ = simd;
    luma_scalar(rgb, out);
}

/// See [`ColourImage::to_gray`].
pub(crate) fn luma_scalar(rgb: &[u8], out: &mut [u8]) {
    for (p, out) in rgb.chunks_exact(3).zip(out) {
        let [r, g, b] = [p[0], p[1], p[2]].map(u32::from);
        *out = ((77 * r + 150 * g + 29 * b + 128) >> 8) as u8;
    }
}

/// A depth image of `height` x `width` in metres along the optical axis; 0 where unknown.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct DepthImage {
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl DepthImage {
    /// From rows of depths in metres. Values that are not finite or negative become 0 (unknown).
    ///
    /// # Errors
    /// [`SizeError`] unless `data.len() == width * height`.
    pub fn from_vec(width: usize, height: usize, mut data: Vec<f32>) -> Result<Self, SizeError> {
        check(elements(1, width, height), data.len())?;
        for z in &mut data {
            // Unconditional store, for vectorisation.
            let usable = (*z > 0.0) & (*z < f32::INFINITY);
            *z = if usable { *z } else { 0.0 };
        }
        Ok(Self {
            width,
            height,
            data,
        })
    }

    /// Width, px.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Height, px.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// All depths, m, row by row.
    #[must_use]
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Nearest-neighbour resampling, which invents no depths between surfaces. `None` for an empty size.
    #[must_use]
    pub fn resampled(&self, width: usize, height: usize) -> Option<Self> {
        if width == 0 || height == 0 || self.data.is_empty() {
            return None;
        }
        // The middle of a pixel, in pixels of the other image.
        let place = |i: usize, to: usize, from: usize| (2 * i + 1) * from / (2 * to);
        let columns: Vec<usize> = (0..width).map(|x| place(x, width, self.width)).collect();
        let mut data = Vec::with_capacity(width * height);
        for y in 0..height {
            let row = place(y, height, self.height) * self.width;
            data.extend(columns.iter().map(|x| self.data[row + x]));
        }
        Some(Self {
            width,
            height,
            data,
        })
    }

    /// Depth of one pixel, m, or 0 if unknown. Panics when outside.
    #[must_use]
    pub fn at(&self, x: usize, y: usize) -> f32 {
        debug_assert!(x < self.width);
        self.data[y * self.width + x]
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn depth_is_resampled_about_pixel_centres() {
        let small = DepthImage::from_vec(2, 1, vec![1.0, 2.0]).unwrap();
        let large = small.resampled(6, 2).unwrap();
        let row = [1.0, 1.0, 1.0, 2.0, 2.0, 2.0];
        assert_eq!(large.data(), [row, row].concat());
        assert_eq!(large.resampled(2, 1).unwrap(), small);
        assert_eq!(
            small.resampled(5, 1).unwrap().data(),
            [1.0, 1.0, 2.0, 2.0, 2.0]
        );
        assert!(small.resampled(0, 1).is_none());
    }

    #[test]
    fn vector_and_scalar_luma_agree() {
        for pixels in (1..70).chain([307, 4096]) {
            let rgb: Vec<u8> = (0..3 * pixels)
                .map(|i| (i * i * 37 + i / 3) as u8)
                .collect();
            let (mut fast, mut scalar) = (vec![0; pixels], vec![0; pixels]);
            luma(&rgb, &mut fast, crate::Simd::detect());
            luma_scalar(&rgb, &mut scalar);
            assert_eq!(fast, scalar, "{pixels} pixels");
        }
        let extremes: Vec<u8> = (0..64)
            .flat_map(|i| [i & 1, i >> 1 & 1, i >> 2 & 1])
            .collect();
        let extremes: Vec<u8> = extremes.iter().map(|v| 255 * v).collect();
        let (mut fast, mut scalar) = (vec![0; 64], vec![0; 64]);
        luma(&extremes, &mut fast, crate::Simd::detect());
        luma_scalar(&extremes, &mut scalar);
        assert_eq!(fast, scalar);
        assert_eq!((fast[0], fast[7]), (0, 255));
    }

    /// Sizes whose product wraps to 0 or a small number in 64 bits, with data of that length.
    #[test]
    fn overflowing_sizes_are_refused() {
        let half = 1 << (usize::BITS / 2);
        assert!(GrayImage::from_vec(half, half, Vec::new()).is_err());
        assert!(DepthImage::from_vec(half, half, Vec::new()).is_err());
        assert!(ColourImage::from_vec(half, half, Vec::new()).is_err());
        assert!(
            GrayImage::from_vec(usize::MAX, 2, vec![0; usize::MAX.wrapping_mul(2) & 1]).is_err()
        );
        // Three times this wraps to 2 in 64 bits.
        let third = usize::MAX / 3 + 1;
        assert!(ColourImage::from_vec(third, 1, vec![0; third.wrapping_mul(3)]).is_err());
        for wide in [
            |n| drop(GrayImage::new(n, n)),
            |n| GrayImage::default().resize(n, n),
        ] {
            let wide: fn(usize) = wide;
            assert!(std::panic::catch_unwind(|| wide(half)).is_err());
        }
    }
}
