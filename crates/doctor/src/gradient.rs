//! Gradients of a grey image along rows and along columns.

use stillpoint_imaging::GrayImage;

/// Reach of a profile to both sides of its pixel, px.
pub(crate) const REACH: usize = 40;
/// Length of a profile.
pub(crate) const PROFILE: usize = 2 * REACH + 1;
/// Added to the sum of a profile before the division by it, grey levels per 2 px: without contours, half a grey level of noise per pixel
/// must not count as much as a contour.
const FLOOR: f32 = 40.0;

/// Image axis along which a surface ends.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Axis {
    X,
    Y,
}

impl Axis {
    pub(crate) const BOTH: [Self; 2] = [Self::X, Self::Y];

    pub(crate) fn index(self) -> usize {
        self as usize
    }
}

/// Absolute gradients of a smoothed image along both axes, grey levels per 2 px.
pub(crate) struct Gradient {
    pub(crate) width: usize,
    pub(crate) height: usize,
    along: [Vec<f32>; 2],
}

impl Gradient {
    pub(crate) fn new(image: &GrayImage) -> Self {
        let (w, h) = (image.width(), image.height());
        let smooth = smoothed(image);
        let mut along = [vec![0.0; w * h], vec![0.0; w * h]];
        // An image of fewer than three columns has no inner ones.
        let inner_rows = if w > 2 { 1..h.saturating_sub(1) } else { 0..0 };
        for y in inner_rows {
            let line = |y: usize| &smooth[y * w..(y + 1) * w];
            let (above, here, below) = (line(y - 1), line(y), line(y + 1));
            let inner = y * w + 1..(y + 1) * w - 1;
            difference(&here[2..], here, &mut along[0][inner.clone()]);
            difference(&below[1..], &above[1..], &mut along[1][inner]);
        }
        Self {
            width: w,
            height: h,
            along,
        }
    }

    /// Whether a profile fits at a pixel.
    pub(crate) fn has_room(&self, x: usize, y: usize) -> bool {
        let inside = |p: usize, size: usize| p > REACH && p + REACH + 1 < size;
        inside(x, self.width) && inside(y, self.height)
    }

    /// Gradients along an axis at the pixels from `-REACH` to `REACH` beside one that has room, divided by their sum, so that every edge
    /// has about the same weight, whatever its strength.
    pub(crate) fn profile(&self, axis: Axis, x: usize, y: usize, out: &mut [f32]) {
        let step = match axis {
            Axis::X => 1,
            Axis::Y => self.width,
        };
        let first = y * self.width + x - REACH * step;
        let of = &self.along[axis.index()];
        let mut sum = FLOOR;
        for (k, value) in out.iter_mut().enumerate() {
            *value = of[first + k * step];
            sum += *value;
        }
        out.iter_mut().for_each(|v| *v /= sum);
    }

    /// Mean square of the gradient along both axes.
    pub(crate) fn energy(&self) -> f64 {
        let square = |v: &f32| f64::from(v * v);
        let sum: f64 = self.along.iter().flatten().map(square).sum();
        sum / (self.width * self.height).max(1) as f64
    }
}

/// `|a - b|`, up to the length of `out`.
fn difference(a: &[f32], b: &[f32], out: &mut [f32]) {
    for ((out, a), b) in out.iter_mut().zip(a).zip(b) {
        *out = (a - b).abs();
    }
}

/// The binomial kernel 1 4 6 4 1, about a Gaussian of 1 px.
const KERNEL: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];

fn blend(rows: [&[f32]; 5], out: &mut [f32]) {
    let [a, b, c, d, e] = rows.map(|row| &row[..out.len()]);
    for (i, out) in out.iter_mut().enumerate() {
        *out = KERNEL[0] * a[i]
            + KERNEL[1] * b[i]
            + KERNEL[2] * c[i]
            + KERNEL[3] * d[i]
            + KERNEL[4] * e[i];
    }
}

/// The image convolved along both axes, with replicated borders.
fn smoothed(image: &GrayImage) -> Vec<f32> {
    let (w, h) = (image.width(), image.height());
    if w == 0 || h == 0 {
        return Vec::new();
    }
    let mut rows = vec![0.0_f32; w * h];
    let mut padded = vec![0.0_f32; w + 4];
    for (y, out) in rows.chunks_exact_mut(w).enumerate() {
        let row = image.row(y);
        for (p, v) in padded[2..].iter_mut().zip(row) {
            *p = f32::from(*v);
        }
        let ends = [row[0], row[w - 1]].map(f32::from);
        padded[..2].fill(ends[0]);
        padded[w + 2..].fill(ends[1]);
        blend([0, 1, 2, 3, 4].map(|k| &padded[k..]), out);
    }
    let mut smooth = vec![0.0_f32; w * h];
    for (y, out) in smooth.chunks_exact_mut(w).enumerate() {
        let line = |k: usize| &rows[(y + k).saturating_sub(2).min(h - 1) * w..];
        blend([0, 1, 2, 3, 4].map(line), out);
    }
    smooth
}
