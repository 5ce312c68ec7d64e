//! The stages of the extraction one by one, for benchmarks only: no part of the interface.

use stillpoint_imaging::{GrayImage, Simd};

use crate::{
    Descriptor,
    brief::Brief,
    fast::{Corner, FastDetector, FastOptions},
    orientation::{direction, moments},
    spread::Spread,
};

/// The sum of the distances of all pairs, each by [`Descriptor::distance`] or by its portable version.
#[must_use]
pub fn distances(descriptors: &[Descriptor], simd: Simd) -> u32 {
    let sum = |distance: fn(&Descriptor, &Descriptor) -> u32| {
        let of = |a: &Descriptor| descriptors.iter().map(|b| distance(a, b)).sum::<u32>();
        descriptors.iter().map(of).sum()
    };
    match simd {
        Simd::Scalar => sum(Descriptor::distance_portable),
        _ => sum(Descriptor::distance),
    }
}

/// The stages on one image, at its own scale.
#[derive(Clone, Debug)]
pub struct Stages {
    detector: FastDetector,
    spread: Spread,
    chosen: Vec<Corner>,
    brief: Brief,
    simd: Simd,
}

impl Stages {
    /// Buffers of all stages.
    #[must_use]
    pub fn new(simd: Simd) -> Self {
        Self {
            detector: FastDetector::new(simd),
            spread: Spread::default(),
            chosen: Vec::new(),
            brief: Brief::new(simd),
            simd,
        }
    }

    /// FAST scores, suppression and choice of threshold; returns the number of corners.
    pub fn fast(&mut self, image: &GrayImage) -> usize {
        let options = FastOptions {
            high: 20,
            low: 7,
            margin: 19,
        };
        self.detector.detect(image, &options).len()
    }

    /// Spreads `quota` of the corners of the last [`Stages::fast`]; returns the number chosen.
    pub fn spread(&mut self, image: &GrayImage, quota: usize) -> usize {
        let size = (image.width(), image.height());
        self.chosen.clear();
        self.spread
            .choose(self.detector.corners(), size, quota, &mut self.chosen);
        self.chosen.len()
    }

    /// Orientation of all chosen corners; returns the sum of their cosines.
    pub fn orient(&self, image: &GrayImage) -> f32 {
        let cosine = |corner: &Corner| {
            direction(moments(image, corner.x.into(), corner.y.into(), self.simd)).0
        };
        self.chosen.iter().map(cosine).sum()
    }

    /// Descriptors of all chosen corners, rotated by an arbitrary angle; returns their exclusive or.
    pub fn describe(&self, smooth: &GrayImage) -> Descriptor {
        let mut all = [0; 4];
        for corner in &self.chosen {
            let turn = (0.8, 0.6);
            let found = self
                .brief
                .describe(smooth, corner.x.into(), corner.y.into(), turn);
            for (sum, word) in all.iter_mut().zip(found.0) {
                *sum ^= word;
            }
        }
        Descriptor(all)
    }
}
