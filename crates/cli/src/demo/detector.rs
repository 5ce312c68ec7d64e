//! The simulator's own detections, generated frame by frame.

use crate::simulate::script_rows;
use stillpoint::detection::{DetectError, Detections, Detector, DetectorInfo, DetectorKind};
use stillpoint::imaging::RgbdFrame;
use stillpoint::simulator::{DetectionNoise, Simulator};

/// Gives the detections that `simulate` would write to `detections.csv`.
pub(crate) struct SimulatedDetector {
    simulator: Simulator,
    noise: DetectionNoise,
}

impl SimulatedDetector {
    /// For the frames of an equal simulator; `seed` is that of the detection noise.
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
        // Frame ids of the simulator are its frame numbers.
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

pub(crate) fn errors_in_words() -> String {
    let noise = DetectionNoise::default();
    format!(
        "the simulator's own, {:.0} % of the people missed and borders off by {} px",
        noise.drop * 100.0,
        noise.jitter_px
    )
}
