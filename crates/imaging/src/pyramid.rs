//! Image pyramids.
//!
//! Level `l` is smaller by exactly `s = factor^l` in both directions. Images are aligned at their upper left corner, so
//! with pixel centres at integers `x0 = (x_l + 0.5) s - 0.5`: positions have no bias that depends on the level.

use crate::{Blur, GrayImage, Simd, resize::Resizer, workers};

/// Scaled copies of an image, each made from the next finer one, and their smoothed versions. Buffers are reused.
#[derive(Clone, Debug)]
pub struct Pyramid {
    factor: f64,
    scales: Vec<f32>,
    levels: Vec<GrayImage>,
    smooth: Vec<GrayImage>,
    /// One per level from the second on, for the present image size.
    resizers: Vec<Resizer>,
    blurs: Vec<Blur>,
    simd: Simd,
}

impl Pyramid {
    /// A pyramid of `levels` levels, each smaller than the previous one by `factor`. Both are clamped to at least 1.
    #[must_use]
    pub fn new(levels: usize, factor: f32, simd: Simd) -> Self {
        let levels = levels.max(1);
        // NaN becomes 1 as well.
        let factor = f64::from(factor.max(1.0));
        let scales = (0..levels)
            .map(|level| power(factor, level) as f32)
            .collect();
        Self {
            factor,
            scales,
            levels: vec![GrayImage::default(); levels],
            smooth: vec![GrayImage::default(); levels],
            resizers: Vec::new(),
            blurs: vec![Blur::new(simd); levels],
            simd,
        }
    }

    /// Scales `image`. Level 0 is a copy of it; level `l` has `round(size / factor^l)` pixels, at least one.
    pub fn build(&mut self, image: &GrayImage) {
        let size = (image.width(), image.height());
        let base = &mut self.levels[0];
        if self.resizers.is_empty() || (base.width(), base.height()) != size {
            let sizes: Vec<_> = (0..self.levels.len())
                .map(|level| self.size_of(size, level))
                .collect();
            self.resizers = sizes
                .windows(2)
                .map(|pair| Resizer::new(pair[0], pair[1], self.factor, self.simd))
                .collect();
        }
        self.levels[0].resize(size.0, size.1);
        self.levels[0].data_mut().copy_from_slice(image.data());
        for (level, resizer) in self.resizers.iter_mut().enumerate() {
            let (finer, coarser) = self.levels.split_at_mut(level + 1);
            resizer.run(&finer[level], &mut coarser[0]);
        }
    }

    /// Smooths every level (7x7 Gaussian, sigma 2 px of that level) for [`Pyramid::smooth`].
    pub fn smooth_all(&mut self) {
        let mut nothing = vec![(); self.levels.len()];
        self.smooth_beside(&mut nothing, |_, ()| {});
    }

    /// Smooths every level and calls `work` with the level's image and item `l` of `beside`. Levels are shared among
    /// [`Workers`](crate::Workers).
    pub fn smooth_beside<T: Send>(
        &mut self,
        beside: &mut [T],
        work: impl Fn(&GrayImage, &mut T) + Sync,
    ) {
        let own = (&self.levels[..], &mut self.smooth[..], &mut self.blurs[..]);
        smooth_shared(own, beside, &work);
    }

    fn size_of(&self, base: (usize, usize), level: usize) -> (usize, usize) {
        let scale = power(self.factor, level);
        let scaled = |length: usize| match length {
            0 => 0,
            _ => ((length as f64 / scale).round() as usize).max(1),
        };
        (scaled(base.0), scaled(base.1))
    }

    /// Number of levels.
    #[must_use]
    pub fn levels(&self) -> usize {
        self.levels.len()
    }

    /// The image at level `level`. Panics when there is no such level.
    #[must_use]
    pub fn level(&self, level: usize) -> &GrayImage {
        &self.levels[level]
    }

    /// The smoothed image at level `level`, as of the last [`Pyramid::smooth_all`]. Panics when there is no such level.
    #[must_use]
    pub fn smooth(&self, level: usize) -> &GrayImage {
        &self.smooth[level]
    }

    /// Pixels of level 0 per pixel of level `level`: `factor^level`. Panics when there is no such level.
    #[must_use]
    pub fn scale(&self, level: usize) -> f32 {
        self.scales[level]
    }

    /// Position in level 0 of a position (px) in level `level`: `(x + 0.5) scale - 0.5`. Panics when there is no such level.
    #[must_use]
    pub fn to_base(&self, level: usize, x: f32, y: f32) -> (f32, f32) {
        let scale = self.scales[level];
        ((x + 0.5) * scale - 0.5, (y + 0.5) * scale - 0.5)
    }
}

type Smoothed<'a> = (&'a [GrayImage], &'a mut [GrayImage], &'a mut [Blur]);

/// Smooths levels and runs `work` on them, splitting in halves: the finest level costs as much as most others together.
fn smooth_shared<T: Send>(
    (levels, smooth, blurs): Smoothed<'_>,
    beside: &mut [T],
    work: &(impl Fn(&GrayImage, &mut T) + Sync),
) {
    let count = levels.len().min(beside.len());
    if count > 1 {
        let middle = count / 2;
        let (levels, smooth, blurs) = (
            levels.split_at(middle),
            smooth.split_at_mut(middle),
            blurs.split_at_mut(middle),
        );
        let beside = beside.split_at_mut(middle);
        workers::both(
            || smooth_shared((levels.0, smooth.0, blurs.0), beside.0, work),
            || smooth_shared((levels.1, smooth.1, blurs.1), beside.1, work),
        );
    } else if let ([level, ..], [smooth, ..], [blur, ..], [beside, ..]) =
        (levels, smooth, blurs, beside)
    {
        blur.run(level, smooth);
        work(level, beside);
    }
}

/// `base^exponent` by repeated multiplication, bit-identical on all platforms.
fn power(base: f64, exponent: usize) -> f64 {
    (0..exponent).fold(1.0, |product, _| product * base)
}
