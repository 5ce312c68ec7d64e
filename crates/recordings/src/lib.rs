//! Reads recordings of RGB-D cameras, and data set folders, through one [`open`].
//!
//! Finds the frames and the camera of a recording, and decodes its images to grey values and metres. Supports MCAP, ROS 1 bags, and rosbag2
//! with its databases (feature `sqlite`). The message types are in the crate `ros-messages`.
//!
//! A file is scanned once from its beginning: it needs no index, and a truncated file gives everything before the cut. Files are untrusted:
//! lengths are checked against the available bytes before any allocation.
//!
//! ```no_run
//! use stillpoint_imaging::FrameSource;
//! use stillpoint_recordings::{FrameOptions, OpenOptions, open};
//!
//! let input = open("walk.mcap".as_ref(), &OpenOptions::default())?;
//! let mut frames = input.frames(&FrameOptions::default())?;
//! while let Some(frame) = frames.next_frame() {
//!     println!("{:.6}", frame?.stamp);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod budget;
mod calibration;
mod choose;
#[cfg(test)]
mod d435;
mod decode;
mod error;
mod file;
mod incoming;
mod inertial;
mod info;
mod input;
mod messages;
mod names;
mod odometry;
mod optics;
mod orbbec;
mod placement;
mod probe;
mod raw;
mod realsense;
mod recording;
mod rectify;
mod register;
mod rosbag2;
mod setup;
mod source;
mod store;
mod transforms;
mod truth;
mod writer;

pub use error::{RecordingError, Result};
pub use file::FileRecording;
pub use incoming::{ImageMessage, Incoming, IncomingTopic, camera_info_topic, stamp_seconds};
pub use info::{Info, Topic, info};
pub use input::{Device, Input, OpenOptions, Source, Taken, is_recording, open};
pub use messages::{MessageFile, TopicInfo};
pub use names::says_registered;
pub use odometry::odometry_sample;
pub use optics::is_calibrated;
pub use raw::{Pair, RawFrames};
pub use source::RecordingSource;
pub use stillpoint_datasets::FrameOptions;
pub use transforms::Transforms;
pub use writer::{McapRecorder, TRUTH_TOPIC};
