//! Figures of the wheel odometry.

use crate::console;
use serde::{Deserialize, Serialize};
use stillpoint::slam::{FrameReport, OdometryState, Outcome};

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct OdometryJson {
    /// `confirmed`, `not confirmed yet`, or why it is ignored.
    pub(crate) state: String,
    /// Number of used samples: those in time order, and poses.
    pub(crate) samples: u64,
    pub(crate) ignored_frames: usize,
    /// Frames without a visual pose in which the odometry, while confirmed, propagated the camera.
    pub(crate) carried_frames: usize,
    /// Number of detected wheel slips.
    pub(crate) slips: u32,
}

impl OdometryJson {
    /// Takes a frame's report, if it concerns odometry. Reports at once when the odometry becomes ignored.
    pub(crate) fn take(known: &mut Option<Self>, report: &FrameReport) {
        let Some(said) = &report.odometry else {
            return;
        };
        let json = known.get_or_insert_default();
        let state = said.state.to_string();
        let ignored = matches!(said.state, OdometryState::Ignored(_));
        if ignored && json.state != state {
            console::warn(&format!("the odometry is {state} (frame {})", report.frame));
        }
        let believed = said.state == OdometryState::Confirmed;
        let carried = matches!(report.outcome, Outcome::Carried { .. });
        json.ignored_frames += usize::from(ignored);
        json.carried_frames += usize::from(carried && believed);
        json.samples = said.samples;
        json.slips = said.slips;
        json.state = state;
    }

    pub(crate) fn line(&self) -> String {
        let mut said = format!("odometry: {}; {} samples", self.state, self.samples);
        if self.slips > 0 {
            said += &format!(", wheels slipped {} times", self.slips);
        }
        if self.carried_frames > 0 {
            said += &format!(", {} frames are carried", self.carried_frames);
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn odometry_summary_line_shows_state_and_counts() {
        let mut json = OdometryJson {
            state: "confirmed".into(),
            samples: 500,
            ..OdometryJson::default()
        };
        assert_eq!(json.line(), "odometry: confirmed; 500 samples");
        (json.slips, json.carried_frames) = (2, 80);
        let more = "500 samples, wheels slipped 2 times, 80 frames are carried";
        assert!(json.line().ends_with(more), "{}", json.line());
    }
}
