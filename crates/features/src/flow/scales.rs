//! The scales of the flow search.
//!
//! A feature pyramid ends too early for fast motion, so halves of its last level in use are appended, which are small
//! and cheap. Coordinates follow the pyramid's rule, `x0 = (x_l + 0.5) s - 0.5`.

use stillpoint_imaging::{GrayImage, Pyramid};

/// The images of one pyramid at every scale in use, finest first.
#[derive(Clone, Debug, Default)]
pub(crate) struct Scales {
    levels: Vec<usize>,
    /// Further scales, each half of the one before.
    halves: Vec<GrayImage>,
    /// Pixels of level 0 per pixel, for all scales.
    scales: Vec<f32>,
}

impl Scales {
    /// Takes every `step`-th level of `pyramid` and appends halves until there are `count` scales.
    pub(crate) fn build(&mut self, pyramid: &Pyramid, count: usize, step: usize) {
        self.levels.clear();
        self.levels
            .extend((0..pyramid.levels()).step_by(step).take(count));
        self.scales.clear();
        self.scales
            .extend(self.levels.iter().map(|&level| pyramid.scale(level)));
        self.halves
            .resize_with(count - self.levels.len(), GrayImage::default);
        let mut finer = pyramid.level(self.levels[self.levels.len() - 1]);
        for half in &mut self.halves {
            halve(finer, half);
            finer = half;
            self.scales.push(2.0 * self.scales[self.scales.len() - 1]);
        }
    }

    pub(crate) fn len(&self) -> usize {
        self.scales.len()
    }

    /// Pixels of level 0 per pixel of scale `i`.
    pub(crate) fn scale(&self, i: usize) -> f32 {
        self.scales[i]
    }

    /// The image at scale `i`; `pyramid` is the one passed to [`Self::build`].
    pub(crate) fn image<'a>(&'a self, pyramid: &'a Pyramid, i: usize) -> &'a GrayImage {
        match self.levels.get(i) {
            Some(&level) => pyramid.level(level),
            None => &self.halves[i - self.levels.len()],
        }
    }

    /// Converts a position from level 0 to scale `i`, px.
    pub(crate) fn at_scale(&self, i: usize, [x, y]: [f32; 2]) -> [f32; 2] {
        let scale = self.scales[i];
        [(x + 0.5) / scale - 0.5, (y + 0.5) / scale - 0.5]
    }

    /// Converts a position from scale `i` to level 0, px.
    pub(crate) fn to_base(&self, i: usize, [x, y]: [f32; 2]) -> [f32; 2] {
        let scale = self.scales[i];
        [(x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5]
    }
}

/// Means of 2x2 pixels, rounded; an odd last row or column is left out.
fn halve(image: &GrayImage, out: &mut GrayImage) {
    let (width, height) = (image.width() / 2, image.height() / 2);
    out.resize(width, height);
    if width == 0 {
        return;
    }
    for (y, out) in out.data_mut().chunks_exact_mut(width).enumerate() {
        let (above, below) = (image.row(2 * y), image.row(2 * y + 1));
        let pairs = above.chunks_exact(2).zip(below.chunks_exact(2));
        for (out, (a, b)) in out.iter_mut().zip(pairs) {
            let sum = u16::from(a[0]) + u16::from(a[1]) + u16::from(b[0]) + u16::from(b[1]);
            *out = ((sum + 2) / 4) as u8;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::Simd;

    /// A plane of grey values keeps its values, so positions at all scales correspond.
    #[test]
    fn appended_half_scales_keep_positions() {
        let plane = |i: usize| (10 + (i % 240) / 2 + (i / 240) / 3) as u8;
        let data = (0..240 * 180).map(plane).collect();
        let mut pyramid = Pyramid::new(8, 1.2, Simd::Scalar);
        pyramid.build(&GrayImage::from_vec(240, 180, data).unwrap());
        let mut scales = Scales::default();
        scales.build(&pyramid, 4, 4);
        assert_eq!(scales.len(), 4);
        let expected = [1.0, 2.0736, 4.1472, 8.2944];
        for (i, expected) in expected.into_iter().enumerate() {
            assert!((scales.scale(i) - expected).abs() < 1e-4);
            let [x, y] = scales.at_scale(i, [120.0, 90.0]);
            let image = scales.image(&pyramid, i);
            let value = f32::from(image.at(x.round() as usize, y.round() as usize));
            let [x, y] = scales.to_base(i, [x.round(), y.round()]);
            assert!(
                (value - (10.0 + x / 2.0 + y / 3.0)).abs() < 1.5,
                "scale {i}: {value}"
            );
        }
        let widths = [0, 1, 2, 3].map(|i| scales.image(&pyramid, i).width());
        assert_eq!(widths, [240, 116, 58, 29]);
        // With fewer scales than levels there are no halves.
        scales.build(&pyramid, 2, 3);
        assert_eq!((scales.len(), scales.halves.len()), (2, 0));
        assert_eq!(scales.image(&pyramid, 1), pyramid.level(3));
    }
}
