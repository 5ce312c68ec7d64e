//! What a run made of its inertial sensor.

use crate::console;
use serde::{Deserialize, Serialize};
use stillpoint::slam::{FrameReport, InertialState, Outcome};

/// The inertial sensor, as known in the end.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct InertialJson {
    /// `confirmed`, `not confirmed yet`, or why it is ignored.
    pub(crate) state: String,
    /// Frames in which it was ignored.
    pub(crate) ignored_frames: usize,
    /// Frames whose direction it carried.
    pub(crate) carried_frames: usize,
    /// The gyroscope's bias, in its axes, rad/s.
    pub(crate) gyro_bias: [f64; 3],
    /// Its standard deviation, rad/s.
    pub(crate) gyro_bias_sigma: f64,
    /// The direction that points up in the trajectory's world; absent where it is not known.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) up: Option<[f64; 3]>,
}

impl InertialJson {
    /// Takes a frame's report, if it says something of a sensor. A sensor that is not listened to any more is told at once.
    pub(crate) fn take(known: &mut Option<Self>, report: &FrameReport) {
        let Some(said) = &report.inertial else {
            return;
        };
        let json = known.get_or_insert_default();
        let state = said.state.to_string();
        let ignored = matches!(said.state, InertialState::Ignored(_));
        if ignored && json.state != state {
            console::warn(&format!(
                "the inertial sensor is {state} (frame {})",
                report.frame
            ));
        }
        json.ignored_frames += usize::from(ignored);
        json.carried_frames += usize::from(matches!(report.outcome, Outcome::Carried { .. }));
        json.gyro_bias = said.gyro_bias;
        json.gyro_bias_sigma = said.gyro_bias_sigma;
        json.up = said.up;
        json.state = state;
    }

    /// One line for the end of a run.
    pub(crate) fn line(&self) -> String {
        let degrees = self.gyro_bias.map(|b| b.to_degrees());
        let [x, y, z] = degrees;
        let carried = match self.carried_frames {
            0 => String::new(),
            n => format!(", the direction of {n} frames is its own"),
        };
        format!(
            "inertial sensor: {}; bias {x:.2}, {y:.2}, {z:.2} deg/s (+-{:.2}){carried}",
            self.state,
            self.gyro_bias_sigma.to_degrees()
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn the_line_says_how_far_the_sensor_is_believed() {
        let json = InertialJson {
            state: "confirmed".into(),
            carried_frames: 8,
            gyro_bias: [0.01, 0.0, -0.02],
            gyro_bias_sigma: 0.001,
            ..InertialJson::default()
        };
        assert_eq!(
            json.line(),
            "inertial sensor: confirmed; bias 0.57, 0.00, -1.15 deg/s (+-0.06), the direction of 8 frames is its own"
        );
    }
}
