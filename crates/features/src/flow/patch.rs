//! Windows of grey values in integers: sampling, gradients, and the sums for a step of the flow.
//!
//! All arithmetic is exact, so the order of the sums does not matter and every instruction set gives the same bits.

use stillpoint_imaging::{GrayImage, Simd};

/// Number of window columns that are computed together; those beyond its side are masked. The power of two above
/// [`MAX_SIDE`].
pub(crate) const LANES: usize = 16;

/// Largest side of a window, px: that of the largest radius that `FlowConfig` allows, 7.
pub(crate) const MAX_SIDE: usize = 15;

/// One row of a window, aligned for vector loads.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
#[repr(C, align(32))]
pub(crate) struct Row(pub(crate) [i16; LANES]);

/// The window of the first image, with its gradients.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) struct Template {
    /// Rows and columns in use, px: odd.
    pub(crate) side: usize,
    /// 1 in the columns in use, else 0.
    pub(crate) columns: Row,
    /// Grey values, 1/64 grey level; unspecified outside the columns in use.
    pub(crate) gray: [Row; MAX_SIDE],
    /// Horizontal gradient, 1/8 grey level per px, from central differences; 0 outside the columns in use. At most
    /// 1020, so that no sum overflows.
    pub(crate) gx: [Row; MAX_SIDE],
    /// Vertical gradient, likewise.
    pub(crate) gy: [Row; MAX_SIDE],
}

/// Sums over a window of products of its gradients and of the gradients, in the units of [`Template::gx`].
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct GradientSums {
    pub(crate) xx: i32,
    pub(crate) xy: i32,
    pub(crate) yy: i32,
    pub(crate) x: i32,
    pub(crate) y: i32,
}

impl GradientSums {
    /// The structure tensor `[xx, xy, yy]` of a window of `pixels` px, less its mean gradient.
    pub(crate) fn centred(&self, pixels: usize) -> [f64; 3] {
        let weight = 1.0 / pixels as f64;
        let (x, y) = (f64::from(self.x), f64::from(self.y));
        [
            f64::from(self.xx) - x * x * weight,
            f64::from(self.xy) - x * y * weight,
            f64::from(self.yy) - y * y * weight,
        ]
    }
}

/// Sums over a window of the differences `e` (1/16 grey level, at most 8160) of another window from the template.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Default)]
pub(crate) struct DifferenceSums {
    /// Horizontal gradient times `e`: at most 1020 x 8160 x 225, which fits.
    pub(crate) gx_e: i32,
    pub(crate) gy_e: i32,
    pub(crate) e: i32,
    pub(crate) abs_e: i32,
}

/// A window's position in an image, in whole pixels and fractions of 2^-15 px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct WindowPlace {
    /// Index of the pixel at or before the window's upper left corner.
    pub(crate) index: usize,
    pub(crate) fx: i16,
    pub(crate) fy: i16,
}

impl WindowPlace {
    /// The window of `side` px around (x, y); `None` unless all pixels needed for its gradients are inside `image`.
    pub(crate) fn new(image: &GrayImage, x: f32, y: f32, side: usize) -> Option<Self> {
        // One pixel more on each side for the gradients, and one for the interpolation.
        let margin = (side / 2 + 1) as f32;
        let inside = |v: f32, length: usize| v >= margin && v + margin + 1.0 < length as f32;
        if !(inside(x, image.width()) && inside(y, image.height())) {
            return None;
        }
        // Positive, so the conversion rounds down.
        let (left, top) = (x as usize, y as usize);
        let fraction = |v: f32, whole: usize| ((v - whole as f32) * 32768.0) as i16;
        Some(Self {
            index: (top - side / 2) * image.width() + left - side / 2,
            fx: fraction(x, left),
            fy: fraction(y, top),
        })
    }

    /// Whether rows of 16 pixels (and 2 more on the right) around a window at this position are inside the data, for
    /// vector kernels.
    #[cfg(any(target_arch = "x86_64", target_arch = "aarch64"))]
    fn has_whole_rows(&self, image: &GrayImage, side: usize) -> bool {
        self.index + (side + 1) * image.width() + LANES + 2 <= image.data().len()
    }
}

impl Template {
    /// An empty template for windows of `2 radius + 1` px; at most [`MAX_SIDE`].
    pub(crate) fn new(radius: usize) -> Self {
        let side = (2 * radius + 1).min(MAX_SIDE);
        let mut columns = Row::default();
        columns.0[..side].fill(1);
        Self {
            side,
            columns,
            gray: [Row::default(); MAX_SIDE],
            gx: [Row::default(); MAX_SIDE],
            gy: [Row::default(); MAX_SIDE],
        }
    }

    /// Samples the window at `place` of `image`.
    pub(crate) fn sample(
        &mut self,
        image: &GrayImage,
        place: WindowPlace,
        simd: Simd,
    ) -> GradientSums {
        #[cfg(target_arch = "x86_64")]
        if simd.has_avx2() && place.has_whole_rows(image, self.side) {
            return crate::avx2::sample_window(self, image, place);
        }
        #[cfg(target_arch = "aarch64")]
        if simd.has_neon() && place.has_whole_rows(image, self.side) {
            return crate::neon::sample_window(self, image, place);
        }
        let _ = simd;
        self.sample_scalar(image, place)
    }

    /// Compares the window at `place` of `image`, darkened by `offset` (1/64 grey level, at most 16320), with this one.
    pub(crate) fn compare(
        &self,
        image: &GrayImage,
        place: WindowPlace,
        offset: i16,
        simd: Simd,
    ) -> DifferenceSums {
        #[cfg(target_arch = "x86_64")]
        if simd.has_avx2() && place.has_whole_rows(image, self.side) {
            return crate::avx2::compare_window(self, image, place, offset);
        }
        #[cfg(target_arch = "aarch64")]
        if simd.has_neon() && place.has_whole_rows(image, self.side) {
            return crate::neon::compare_window(self, image, place, offset);
        }
        let _ = simd;
        self.compare_scalar(image, place, offset)
    }

    pub(crate) fn sample_scalar(&mut self, image: &GrayImage, place: WindowPlace) -> GradientSums {
        /// Columns of a window with one more to each side, for gradients.
        const WIDE: usize = LANES + 2;
        let (side, stride) = (self.side, image.width());
        // Rows -1..=side and columns from -1 on.
        let start = place.index - stride - 1;
        let mut window = [[0; WIDE]; MAX_SIDE + 2];
        let mut above = row::<WIDE>(image.data(), start, place.fx);
        for (y, out) in window.iter_mut().enumerate().take(side + 2) {
            let below = row(image.data(), start + (y + 1) * stride, place.fx);
            *out = std::array::from_fn(|x| blend(above[x], below[x], place.fy));
            above = below;
        }
        let mut sums = GradientSums::default();
        for y in 0..side {
            let [up, middle, down] = [&window[y], &window[y + 1], &window[y + 2]];
            for x in 0..LANES {
                let used = self.columns.0[x];
                // A difference over 2 px in 1/64 grey level, divided by 16, is in 1/8 grey level per px.
                let gx = used * scale(middle[x + 2] - middle[x], 1 << 11);
                let gy = used * scale(down[x + 1] - up[x + 1], 1 << 11);
                self.gray[y].0[x] = middle[x + 1];
                self.gx[y].0[x] = gx;
                self.gy[y].0[x] = gy;
                let (gx, gy) = (i32::from(gx), i32::from(gy));
                sums.xx += gx * gx;
                sums.xy += gx * gy;
                sums.yy += gy * gy;
                sums.x += gx;
                sums.y += gy;
            }
        }
        sums
    }

    pub(crate) fn compare_scalar(
        &self,
        image: &GrayImage,
        place: WindowPlace,
        offset: i16,
    ) -> DifferenceSums {
        let stride = image.width();
        let mut sums = DifferenceSums::default();
        let mut above = row::<LANES>(image.data(), place.index, place.fx);
        let rows = self.gray.iter().zip(&self.gx).zip(&self.gy);
        for (y, ((gray, gx), gy)) in rows.enumerate().take(self.side) {
            let below = row(image.data(), place.index + (y + 1) * stride, place.fx);
            for x in 0..LANES {
                let other = blend(above[x], below[x], place.fy);
                let e = self.columns.0[x] * scale(other - gray.0[x] - offset, 1 << 13);
                let e = i32::from(e);
                sums.gx_e += i32::from(gx.0[x]) * e;
                sums.gy_e += i32::from(gy.0[x]) * e;
                sums.e += e;
                sums.abs_e += e.abs();
            }
            above = below;
        }
        sums
    }
}

/// Pixels from `index` on, interpolated with their right neighbours, 1/64 grey level; 0 beyond the data.
#[inline]
fn row<const N: usize>(data: &[u8], index: usize, fx: i16) -> [i16; N] {
    let from = |start: usize| &data[start..data.len().min(start + N)];
    let (a, b) = (from(index), from(index + 1));
    let pixel = |a: u8, b: u8| blend(i16::from(a) << 6, i16::from(b) << 6, fx);
    // A loop of known length is vectorised.
    if let (Ok(a), Ok(b)) = (<&[u8; N]>::try_from(a), <&[u8; N]>::try_from(b)) {
        return std::array::from_fn(|x| pixel(a[x], b[x]));
    }
    let mut row = [0; N];
    for ((out, &a), &b) in row.iter_mut().zip(a).zip(b) {
        *out = pixel(a, b);
    }
    row
}

/// `a` at fraction 0, nearly `b` at fraction 32767 / 2^15.
#[inline]
fn blend(a: i16, b: i16, fraction: i16) -> i16 {
    a + scale(b - a, fraction)
}

/// `value * factor / 2^15`, rounded to nearest.
#[inline]
fn scale(value: i16, factor: i16) -> i16 {
    ((i32::from(value) * i32::from(factor) + (1 << 14)) >> 15) as i16
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn image(width: usize, height: usize, kind: u64) -> GrayImage {
        let pixel = |i: usize| {
            let noise = (i as u64 + 1).wrapping_mul(0x9e37_79b9_7f4a_7c15 ^ kind.rotate_left(17));
            match kind % 3 {
                // The largest possible contrasts: sums must not overflow.
                0 => 255 * (((i % width) / 2 + i / width / 2) % 2) as u8,
                1 => (noise >> 56) as u8,
                _ => 255 * (noise >> 63) as u8,
            }
        };
        let data = (0..width * height).map(pixel).collect();
        GrayImage::from_vec(width, height, data).unwrap()
    }

    proptest! {
        #[test]
        fn scalar_and_vector_kernels_agree(
            (radius, width, height) in (2_usize..=7, 18_usize..50, 18_usize..40),
            (x, y, u, v) in (0.0_f32..1.0, 0.0_f32..1.0, 0.0_f32..1.0, 0.0_f32..1.0),
            offset in -16320_i16..=16320,
            kinds in (0_u64..99, 0_u64..99),
        ) {
            let (a, b) = (image(width, height, kinds.0), image(width, height, kinds.1));
            let side = 2 * radius + 1;
            // All allowed positions, including the first and the last.
            let along = |t: f32, length: usize| {
                let (low, high) = ((radius + 1) as f32, length as f32 - radius as f32 - 2.001);
                (low + (high - low) * (1.2 * t - 0.1)).clamp(low, high)
            };
            let from = WindowPlace::new(&a, along(x, width), along(y, height), side).unwrap();
            let to = WindowPlace::new(&b, along(u, width), along(v, height), side).unwrap();
            let (mut scalar, mut vector) = (Template::new(radius), Template::new(radius));
            let sums = scalar.sample(&a, from, Simd::Scalar);
            prop_assert_eq!(sums, vector.sample(&a, from, Simd::detect()));
            prop_assert_eq!(&scalar.gx, &vector.gx);
            prop_assert_eq!(&scalar.gy, &vector.gy);
            for (scalar, vector) in scalar.gray.iter().zip(&vector.gray).take(side) {
                prop_assert_eq!(&scalar.0[..side], &vector.0[..side]);
            }
            let differences = scalar.compare(&b, to, offset, Simd::Scalar);
            prop_assert_eq!(differences, vector.compare(&b, to, offset, Simd::detect()));
        }
    }

    #[test]
    fn windows_at_the_border_are_refused() {
        let image = image(40, 30, 1);
        let inside = |x, y| WindowPlace::new(&image, x, y, 11).is_some();
        assert!(inside(6.0, 6.0) && inside(32.9, 22.9));
        assert!(!inside(5.9, 6.0) && !inside(6.0, 5.9) && !inside(33.0, 22.0));
        assert!(!inside(32.0, 23.0) && !inside(f32::NAN, 9.0) && !inside(9.0, f32::INFINITY));
    }

    /// On the plane `v = 30 + 3 x + 2 y` all values are known.
    #[test]
    fn plane_has_exact_gradients_and_differences() {
        let plane = |i: usize| (30 + 3 * (i % 40) + 2 * (i / 40)) as u8;
        let image = GrayImage::from_vec(40, 40, (0..1600).map(plane).collect()).unwrap();
        let mut template = Template::new(3);
        let from = WindowPlace::new(&image, 12.25, 20.5, 7).unwrap();
        let sums = template.sample(&image, from, Simd::Scalar);
        let (gx, gy) = (3 * 8, 2 * 8);
        let expected = GradientSums {
            xx: 49 * gx * gx,
            xy: 49 * gx * gy,
            yy: 49 * gy * gy,
            x: 49 * gx,
            y: 49 * gy,
        };
        assert_eq!(sums, expected);
        // The centre of the window is at the given position.
        let middle = f64::from(template.gray[3].0[3]) / 64.0;
        assert!((middle - (30.0 + 3.0 * 12.25 + 2.0 * 20.5)).abs() < 1.0 / 32.0);
        // Half a pixel to the right the plane is 1.5 higher; an offset of 1.5 compensates that.
        let to = WindowPlace::new(&image, 12.75, 20.5, 7).unwrap();
        let found = template.compare(&image, to, 0, Simd::Scalar);
        assert_eq!((found.e, found.abs_e), (49 * 24, 49 * 24));
        assert_eq!((found.gx_e, found.gy_e), (49 * 24 * gx, 49 * 24 * gy));
        assert_eq!(template.compare(&image, to, 96, Simd::Scalar).abs_e, 0);
    }
}
