//! The simulator's own detections, frame by frame as they are needed.

use crate::simulate::script_rows;
use stillpoint::detection::{DetectError, Detections, Detector, DetectorInfo, DetectorKind};
use stillpoint::imaging::RgbdFrame;
use stillpoint::simulator::{DetectionNoise, Simulator};

/// What `simulate` would have written to `detections.csv`.
pub(crate) struct SimulatedDetector {
    simulator: Simulator,
    noise: DetectionNoise,
}

impl SimulatedDetector {
    /// For the frames of an equal simulator with this seed.
    pub(crate) fn new(simulator: Simulator, seed: u64) -> Self {
        let noise = DetectionNoise {
            seed,
            ..DetectionNoise::default()
        };
        Self { simulator, noise }
    }
}

impl Detector for SimulatedDetector {
    fn detect(&mut self, frame: &RgbdFrame) -> Result<Detections, DetectError> {
        // The simulator numbers its frames.
        let said = self.simulator.detections(frame.id.0 as usize, &self.noise);
        let rows = script_rows(&said);
        let mut items: Vec<_> = rows.into_iter().map(|r| r.detection).collect();
        items.sort_by(|a, b| b.score.total_cmp(&a.score));
        Ok(Detections {
            frame: frame.id,
            stamp: frame.stamp,
            items,
        })
    }

    fn info(&self) -> DetectorInfo {
        DetectorInfo::new(DetectorKind::Scripted, "simulator")
    }
}

/// What it leaves out and gets wrong, in words.
pub(crate) fn errors_in_words() -> String {
    let noise = DetectionNoise::default();
    format!(
        "the simulator's own, {:.0} % of the people missed and borders off by {} px",
        noise.drop * 100.0,
        noise.jitter_px
    )
}
