//! How strongly a grey image changes along rows and along columns.

use stillpoint_imaging::GrayImage;

/// Reach of a profile to both sides of its pixel, px.
pub(crate) const REACH: usize = 40;
/// Entries of a profile.
pub(crate) const PROFILE: usize = 2 * REACH + 1;
/// Added to the sum of a profile before it is divided by it, grey levels per 2 px: where the image shows nothing, half a grey level of noise per pixel
/// is not to count as much as a contour.
const FLOOR: f32 = 40.0;

/// Along which axis of the image a surface ends.
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
        for y in 1..h.saturating_sub(1) {
            for x in 1..w.saturating_sub(1) {
                let i = y * w + x;
                along[0][i] = (smooth[i + 1] - smooth[i - 1]).abs();
                along[1][i] = (smooth[i + w] - smooth[i - w]).abs();
            }
        }
        Self {
            width: w,
            height: h,
            along,
        }
    }

    /// Whether a profile fits in at a pixel.
    pub(crate) fn has_room(&self, x: usize, y: usize) -> bool {
        let inside = |p: usize, size: usize| p > REACH && p + REACH + 1 < size;
        inside(x, self.width) && inside(y, self.height)
    }

    /// Gradients along an axis at the pixels from `-REACH` to `REACH` beside one that has room, divided by their sum: every edge has
    /// about one vote, however strong it is.
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

/// The image under the binomial kernel 1 4 6 4 1 along both axes, about a Gaussian of 1 px.
fn smoothed(image: &GrayImage) -> Vec<f32> {
    const KERNEL: [f32; 5] = [0.0625, 0.25, 0.375, 0.25, 0.0625];
    let (w, h) = (image.width(), image.height());
    let mut rows = vec![0.0_f32; w * h];
    for y in 0..h {
        let row = image.row(y);
        for x in 0..w {
            let at = |k: usize| f32::from(row[(x + k).saturating_sub(2).min(w - 1)]);
            rows[y * w + x] = (0..5).map(|k| KERNEL[k] * at(k)).sum();
        }
    }
    let mut out = vec![0.0_f32; w * h];
    for y in 0..h {
        let line = |k: usize| (y + k).saturating_sub(2).min(h - 1) * w;
        for x in 0..w {
            out[y * w + x] = (0..5).map(|k| KERNEL[k] * rows[line(k) + x]).sum();
        }
    }
    out
}
