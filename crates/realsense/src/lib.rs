//! Live Intel RealSense cameras.
//!
//! Answers: the connected cameras, their calibration, and their frames. Does not know the use of the frames. librealsense is loaded when a
//! camera is requested: neither builds nor other runs need it.
//!
//! ```no_run
//! use stillpoint_realsense::{Options, RealSense};
//! use stillpoint_recordings::Device;
//!
//! let camera = RealSense::open(&Options::default())?;
//! let mut frames = camera.frames(false)?;
//! while let Some(frame) = frames.next_frame() {
//!     println!("{:.6}", frame?.stamp);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod camera;
mod description;
mod error;
mod find;
mod inertial;
mod library;
mod source;

pub use camera::{Options, RealSense};
pub use error::{RealSenseError, Result};
pub use find::VARIABLE;
