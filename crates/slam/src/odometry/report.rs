//! What is said of the odometry.

use crate::trust::SensorState;

/// What is wrong with odometry that is not listened to.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum OdometryFault {
    /// It stands still while the camera moves: it is stuck, or not connected.
    Stuck,
    /// It jumps to and fro as no base does.
    Noisy,
    /// It moves otherwise than the camera: the camera is mounted otherwise than stated, stamps are of another clock, or wheels slip all the time.
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

/// How far the odometry is believed.
pub type OdometryState = SensorState<OdometryFault>;

/// What is known of the odometry at a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct OdometryReport {
    /// Whether it is believed.
    pub state: OdometryState,
    /// Samples that were used so far: in order of time, and of numbers.
    pub samples: u64,
    /// How often the wheels were seen to slip.
    pub slips: u32,
}
