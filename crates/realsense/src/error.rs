//! Errors of cameras.

use std::path::PathBuf;

/// Error: a camera cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum RealSenseError {
    /// The library is missing.
    #[error(
        "expected librealsense 2.50 or later, found {found}; install it (Intel's packages: librealsense2; ROS 2: ros-$ROS_DISTRO-librealsense2; Homebrew: librealsense), or name its file in {}",
        crate::VARIABLE
    )]
    Library {
        /// Finding.
        found: String,
    },
    /// An unusable library.
    #[error("{}: expected librealsense 2.50 or later, found {found}; name another file in {}", library.display(), crate::VARIABLE)]
    Unusable {
        /// The file.
        library: PathBuf,
        /// The problem.
        found: String,
    },
    /// The requested camera is missing or ambiguous.
    #[error("expected {expected}, found {found}; {advice}")]
    Device {
        /// The request.
        expected: String,
        /// The connected devices.
        found: String,
        /// Remedy.
        advice: &'static str,
    },
    /// It does not start, or sends no images.
    #[error("{device}: expected {expected}, found: {found}; {advice}")]
    Start {
        /// The device.
        device: String,
        /// The request.
        expected: String,
        /// Error of the library.
        found: String,
        /// Remedy.
        advice: &'static str,
    },
}

/// Result of this crate.
pub type Result<T> = std::result::Result<T, RealSenseError>;
