//! RGB-D data sets, stamp association and trajectory files.
//!
//! Answers: which frames a folder holds, with which camera they were taken, what their pixels are, and what the ground
//! truth says in this project's conventions. Also writes data sets and trajectories. Does not judge trajectories (crate
//! `evaluation`) and does not know what is done with the frames.
//!
//! ```no_run
//! use stillpoint_datasets::{Dataset, FrameOptions, OpenOptions, ReadAhead};
//! use stillpoint_imaging::FrameSource;
//!
//! let dataset = Dataset::open("rgbd_dataset_freiburg1_xyz".as_ref(), &OpenOptions::default())?;
//! let mut frames = ReadAhead::new(dataset.frames(&FrameOptions::default())?);
//! while let Some(frame) = frames.next_frame() {
//!     let frame = frame?;
//!     println!("{} {:.6}", frame.id, frame.stamp);
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

mod associate;
mod camera;
mod dataset;
mod decode;
mod error;
mod ground_truth;
mod layout;
mod lists;
mod presets;
mod probe;
mod read_ahead;
mod recorder;
mod source;
pub mod trajectory;
mod write;

pub use associate::{DEFAULT_MAX_DT, associate};
pub use camera::{CameraChoice, CameraModel};
pub use dataset::{Counts, Dataset, Entry, OpenOptions};
pub use decode::{read_colour, read_depth, read_gray};
pub use error::{DatasetError, Result};
pub use layout::Layout;
pub use read_ahead::ReadAhead;
pub use recorder::{ColourFormat, Recorder};
pub use source::{DatasetSource, FrameOptions};
pub use trajectory::StampedPose;
pub use write::write_atomic;
