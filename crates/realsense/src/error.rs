//! Why there is no camera.

use std::path::PathBuf;

/// Why a camera does not run.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RealSenseError {
    /// There is no library.
    #[error(
        "expected librealsense 2.50 or later, found {found}; install it (Intel's packages: librealsense2; ROS 2: ros-$ROS_DISTRO-librealsense2; Homebrew: librealsense), or name its file in {}",
        crate::VARIABLE
    )]
    Library {
        /// What there is.
        found: String,
    },
    /// A library that cannot be used.
    #[error("{}: expected librealsense 2.50 or later, found {found}; name another file in {}", library.display(), crate::VARIABLE)]
    Unusable {
        /// The file.
        library: PathBuf,
        /// What it is.
        found: String,
    },
    /// Not the camera that is asked for, or more than one.
    #[error("expected {expected}, found {found}; {advice}")]
    Device {
        /// What was asked for.
        expected: String,
        /// What is connected.
        found: String,
        /// What to do.
        advice: &'static str,
    },
    /// It does not start, or gives no images.
    #[error("{device}: expected {expected}, found: {found}; {advice}")]
    Start {
        /// The device.
        device: String,
        /// What was asked for.
        expected: String,
        /// What the library said.
        found: String,
        /// What to do.
        advice: &'static str,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, RealSenseError>;
