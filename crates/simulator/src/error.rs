//! Errors of the configuration.

use crate::catalogue::scene_names;
use crate::shutter::Shutter;
use stillpoint_geometry::Camera;

/// An invalid configuration.
#[derive(Clone, Debug, PartialEq)]
pub enum SimulatorError {
    /// No scene has this name.
    UnknownScene {
        /// The given name.
        found: String,
        /// The scene with the most similar name.
        nearest: &'static str,
    },
    /// The delay of depth images is not between 0 and the time between two frames, s.
    DepthDelay(f64),
    /// A time of the shutter is not between 0 and the time between two frames.
    Shutter(Shutter),
    /// The rate is not between 1 and 1000, 1/s.
    Rate(f64),
    /// The scale is not between 0.01 and 100.
    Scale(f64),
    /// The camera's size or focal length cannot be rendered.
    Camera(Box<Camera>),
}

impl std::fmt::Display for SimulatorError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::UnknownScene { found, nearest } => {
                let names = scene_names().join(", ");
                write!(
                    f,
                    "expected a scene ({names}), found \"{found}\"; did you mean \"{nearest}\"?"
                )
            }
            Self::DepthDelay(found) => {
                write!(
                    f,
                    "expected a depth delay from 0 to the time between two frames (0.0333 s at 30 per second), found {found}"
                )
            }
            Self::Shutter(found) => write!(
                f,
                "expected readouts and an exposure from 0 to the time between two frames (0.0333 s at 30 per second), found {found:?}"
            ),
            Self::Rate(found) => {
                write!(
                    f,
                    "expected a rate of 1 to 1000 frames per second, found {found}"
                )
            }
            Self::Scale(found) => {
                write!(f, "expected a scale from 0.01 to 100, found {found}")
            }
            Self::Camera(found) => write!(
                f,
                "expected a camera of 32 to 4096 px with focal lengths of 16 to 8192 px, its principal point in the image and a finite, one-to-one distortion, found {found:?}"
            ),
        }
    }
}

impl std::error::Error for SimulatorError {}
