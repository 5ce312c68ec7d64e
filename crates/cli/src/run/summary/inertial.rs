//! Figures of the inertial sensor.

use crate::console;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use std::fmt::Write;
use stillpoint::map::SubmapId;
use stillpoint::slam::{FrameReport, InertialState, Outcome};

/// Minimum deviation of the mount that is reported, rad: a degree.
const TELLING_TURN: f64 = 0.0175;
const TELLING_OFFSET: f64 = 2e-3;
/// Minimum deviation of mount or clock that is reported, in standard deviations.
const CERTAIN: f64 = 4.0;

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct InertialJson {
    /// `confirmed`, `not confirmed yet`, or why it is ignored.
    pub(crate) state: String,
    pub(crate) ignored_frames: usize,
    /// Number of frames whose rotation it predicted.
    pub(crate) carried_frames: usize,
    /// Gyroscope bias, in its axes, rad/s.
    pub(crate) gyro_bias: [f64; 3],
    pub(crate) gyro_bias_sigma: f64,
    /// Estimated rotation from the sensor's axes to the camera's, a quaternion x y z w.
    pub(crate) rotation: [f64; 4],
    /// Deviation from the stated rotation, rad.
    pub(crate) rotation_error: f64,
    /// Its standard deviation about an axis, rad.
    pub(crate) rotation_sigma: f64,
    /// Estimated offset to add to the sensor's stamps, s.
    pub(crate) time_offset: f64,
    /// Deviation from the stated offset, s.
    pub(crate) time_offset_error: f64,
    pub(crate) time_offset_sigma: f64,
    /// Up direction in the trajectory's world; absent if unknown.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) up: Option<[f64; 3]>,
    /// Last known up direction in the world of each submap.
    #[serde(skip)]
    ups: BTreeMap<SubmapId, [f64; 3]>,
}

impl InertialJson {
    /// Takes a frame's report, if it concerns a sensor. Reports at once when the sensor becomes ignored.
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
        let q = &said.camera_from_imu;
        json.rotation = [q.i, q.j, q.k, q.w];
        json.rotation_error = said.mount_error;
        json.rotation_sigma = said.mount_sigma;
        json.time_offset = said.time_offset;
        json.time_offset_error = said.time_offset_error;
        json.time_offset_sigma = said.time_offset_sigma;
        if ignored {
            json.ups.clear();
        }
        if let (Some(submap), Some(up)) = (report.submap, said.up) {
            json.ups.insert(submap, up);
        }
        json.state = state;
    }

    /// Sets the up direction of the trajectory's submap, at the end.
    pub(crate) fn settle(&mut self, submap: Option<SubmapId>) {
        self.up = submap.and_then(|id| self.ups.get(&id).copied());
    }

    pub(crate) fn line(&self) -> String {
        let degrees = self.gyro_bias.map(|b| b.to_degrees());
        let [x, y, z] = degrees;
        let carried = match self.carried_frames {
            0 => String::new(),
            n => format!(", the direction of {n} frames is its own"),
        };
        format!(
            "inertial sensor: {}; bias {x:.2}, {y:.2}, {z:.2} deg/s (+-{:.2}){}{carried}",
            self.state,
            self.gyro_bias_sigma.to_degrees(),
            self.stated_wrongly()
        )
    }

    /// Stated mount and clock values that the estimate contradicts, with the values to state instead.
    fn stated_wrongly(&self) -> String {
        let mut said = String::new();
        if self.rotation_error > TELLING_TURN.max(CERTAIN * self.rotation_sigma) {
            let [x, y, z, w] = self.rotation;
            said = format!(
                ", mounted {:.1} deg otherwise than stated (rotation = [{x:.4}, {y:.4}, {z:.4}, {w:.4}])",
                self.rotation_error.to_degrees()
            );
        }
        if self.time_offset_error.abs() > TELLING_OFFSET.max(CERTAIN * self.time_offset_sigma) {
            let ms = self.time_offset_error * 1e3;
            let _ = write!(
                said,
                ", its clock {ms:.1} ms off what is stated (time_offset = {:.4})",
                self.time_offset
            );
        }
        said
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn inertial_summary_line_shows_state_and_calibration() {
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
        let off = InertialJson {
            rotation: [0.0, 0.0, 0.017_452_4, 0.999_847_7],
            rotation_error: 0.0349,
            rotation_sigma: 0.004,
            time_offset: 0.0123,
            time_offset_error: -0.0031,
            time_offset_sigma: 0.0004,
            ..json
        };
        let line = off.line();
        let mount =
            "mounted 2.0 deg otherwise than stated (rotation = [0.0000, 0.0000, 0.0175, 0.9998])";
        assert!(line.contains(mount), "{line}");
        assert!(
            line.contains("clock -3.1 ms off what is stated (time_offset = 0.0123)"),
            "{line}"
        );
    }
}
