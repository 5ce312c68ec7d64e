//! Visual SLAM that stays still while the world moves: the whole library under one name.
//!
//! Answers: where to find everything. Holds no logic of its own: every module is one of the project's crates.
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
/// Surface, mesh and grids of what stands still.
pub use stillpoint_dense as dense;
/// Object detectors, and the objects they see, tracked through time.
pub use stillpoint_detection as detection;
/// What is wrong with a stream, from a few seconds of it.
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
/// Networks that detect, and the cache of models.
#[cfg(feature = "inference")]
pub use stillpoint_inference as inference;
/// The system with threads, at the pace of a camera.
pub use stillpoint_live as live;
/// Keyframes, landmarks, views.
pub use stillpoint_map as map;
/// Known models, downloads, and checkpoints turned into ONNX.
#[cfg(feature = "models")]
pub use stillpoint_models as models;
/// Place recognition.
pub use stillpoint_place as place;
/// RealSense cameras.
#[cfg(feature = "realsense")]
pub use stillpoint_realsense as realsense;
/// Recordings (MCAP, bags) and data sets, behind one `open`.
pub use stillpoint_recordings as recordings;
/// What happens in a run as messages of ROS.
pub use stillpoint_ros_events as ros_events;
/// Messages of ROS as bytes and back.
pub use stillpoint_ros_messages as ros_messages;
/// Rendered rooms with exact ground truth.
pub use stillpoint_simulator as simulator;
/// The system itself.
pub use stillpoint_slam as slam;
/// Pictures of what the system saw.
pub use stillpoint_view as view;
