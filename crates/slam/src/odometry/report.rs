//! State of the odometry, for reports.

use crate::trust::SensorState;

/// Why odometry is ignored.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OdometryFault {
    /// It stands still while the camera moves: stuck, or not connected.
    Stuck,
    /// It jumps back and forth as no base does.
    Noisy,
    /// It contradicts the camera's motion: wrong mount, stamps of another clock, or wheels that slip all the time.
    Contradicts,
}

impl std::fmt::Display for OdometryFault {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Stuck => "it stands still while the camera moves: is it connected?",
            Self::Noisy => "its poses jump to and fro",
            Self::Contradicts => {
                "it moves otherwise than the camera: check base_from_camera and time_offset"
            }
        })
    }
}

/// Trust in the odometry.
pub type OdometryState = SensorState<OdometryFault>;

/// State of the odometry at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryReport {
    /// Trust in the odometry.
    pub state: OdometryState,
    /// Number of valid samples.
    pub samples: u64,
    /// Number of detected wheel slips.
    pub slips: u32,
}
