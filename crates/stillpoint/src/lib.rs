//! Visual SLAM for dynamic scenes: facade of the whole library. Every module re-exports one of the project's crates.
//!
//! ```no_run
//! use stillpoint::datasets::{Dataset, FrameOptions, OpenOptions};
//! use stillpoint::imaging::{FrameSource, Simd};
//! use stillpoint::slam::{Config, Event, System};
//!
//! let dataset = Dataset::open("rgbd_dataset_freiburg1_xyz".as_ref(), &OpenOptions::default())?;
//! let mut frames = dataset.frames(&FrameOptions::default())?;
//! let mut system = System::new(Config::default(), dataset.camera().camera, Simd::detect())?;
//! while let Some(frame) = frames.next_frame() {
//!     for event in system.step(frame?) {
//!         if let Event::Frame(tracked) = event {
//!             println!("{}: {:?}", tracked.report.frame, tracked.report.outcome);
//!         }
//!     }
//! }
//! # Ok::<(), Box<dyn std::error::Error>>(())
//! ```

/// Data sets, trajectory files and their formats.
pub use stillpoint_datasets as datasets;
/// Surface, mesh and grids of the static scene.
pub use stillpoint_dense as dense;
/// Object detectors and object tracking.
pub use stillpoint_detection as detection;
/// Diagnosis of a stream from a few seconds of it.
pub use stillpoint_doctor as doctor;
/// Solvers: pose, bundle adjustment, triangulation.
pub use stillpoint_estimation as estimation;
/// ATE, RPE and plots.
pub use stillpoint_evaluation as evaluation;
/// Keypoints, descriptors, matching.
pub use stillpoint_features as features;
/// Downloads and archives.
#[cfg(feature = "pull")]
pub use stillpoint_fetch as fetch;
/// Rotations, rigid motions, cameras.
pub use stillpoint_geometry as geometry;
/// Images, pyramids, frames.
pub use stillpoint_imaging as imaging;
/// Detection networks and the model cache.
#[cfg(feature = "inference")]
pub use stillpoint_inference as inference;
/// The multithreaded system, in real time.
pub use stillpoint_live as live;
/// Keyframes, landmarks, views.
pub use stillpoint_map as map;
/// Known models, downloads, and conversion of checkpoints to ONNX.
#[cfg(feature = "models")]
pub use stillpoint_models as models;
/// Place recognition.
pub use stillpoint_place as place;
/// RealSense cameras.
#[cfg(feature = "realsense")]
pub use stillpoint_realsense as realsense;
/// Recordings (MCAP, bags) and data sets, behind one `open`.
pub use stillpoint_recordings as recordings;
/// Events of a run as ROS messages.
pub use stillpoint_ros_events as ros_events;
/// Encoding and decoding of ROS messages.
pub use stillpoint_ros_messages as ros_messages;
/// Rendered rooms with exact ground truth.
pub use stillpoint_simulator as simulator;
/// The SLAM system.
pub use stillpoint_slam as slam;
/// Visualisation.
pub use stillpoint_view as view;
