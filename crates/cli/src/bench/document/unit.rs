//! The unit of time: how long a fixed piece of work takes on this machine, so that times of two machines can be compared.

use crate::failure::Failure;
use std::time::Instant;
use stillpoint::evaluation::timing::Stats;
use stillpoint::features::{Features, OrbConfig, OrbExtractor};
use stillpoint::imaging::{GrayImage, Simd};
use stillpoint::simulator::{Simulator, SimulatorConfig};

/// Images that the unit is measured on, one second apart.
const IMAGES: usize = 10;
/// How often each of them is taken.
const ROUNDS: usize = 20;

/// In words, for the report.
pub(crate) const WHAT: &str = "the median time in which this project's ORB extraction (1000 features, one thread) takes a 640x480 image of the \
                               simulated scene `xyz`";

/// Images of the same bytes on every machine.
pub(crate) struct Unit {
    images: Vec<GrayImage>,
    extractor: OrbExtractor,
    features: Features,
}

impl Unit {
    /// Renders the images.
    ///
    /// # Errors
    /// A simulator without the scene.
    pub(crate) fn new(simd: Simd) -> Result<Self, Failure> {
        let simulator = Simulator::new(&SimulatorConfig::default()).map_err(Failure::input)?;
        let images = (0..IMAGES).map(|i| simulator.frame(30 * i).gray);
        Ok(Self {
            images: images.collect(),
            extractor: OrbExtractor::new(&OrbConfig::default(), simd),
            features: Features::default(),
        })
    }

    /// Takes all images several times; ms per image.
    pub(crate) fn measure(&mut self) -> Stats {
        let mut times = Vec::with_capacity(IMAGES * ROUNDS);
        for round in 0..=ROUNDS {
            for image in &self.images {
                let start = Instant::now();
                self.extractor.extract(image, &mut self.features);
                // The first round grows buffers and wakes the processor up.
                if round > 0 {
                    times.push(start.elapsed().as_secs_f64() * 1e3);
                }
            }
        }
        Stats::of(&times)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_unit_is_the_time_of_every_image_and_round() {
        let mut unit = Unit::new(Simd::detect()).unwrap();
        let stats = unit.measure();
        assert_eq!(stats.n, IMAGES * ROUNDS);
        assert!(stats.median > 0.0 && stats.median <= stats.max);
        assert!(unit.features.len() > 500);
    }
}
