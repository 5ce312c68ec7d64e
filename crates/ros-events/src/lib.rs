//! Converts the events of a run to messages of ROS 2.
//!
//! Answers: which messages an [`Event`](stillpoint_slam::Event) becomes ([`Publisher`]), on which topics and in which frames, with the axes
//! of REP-103 ([`axes`]) and the frames of REP-105 ([`Odom`]: `odom` never jumps, corrections of the map are in `map -> odom`). Returns
//! values, and leaves writing and sending to the callers. Nothing feeds back into the system.
//!
//! | topic | message | when |
//! |---|---|---|
//! | `/tf_static` | `TFMessage`: `camera_link -> camera_color_optical_frame`, and joined submaps | once each |
//! | `/tf` | `TFMessage`: `map -> odom -> camera_link` | every frame with a pose |
//! | `/stillpoint/odometry` | `Odometry` of `camera_link` in `odom`, with covariances | every frame with a pose |
//! | `/stillpoint/path` | `Path` of the keyframes | once a second, more rarely in long runs, and after corrections of the map |
//! | `/stillpoint/map` | `PointCloud2` of the landmarks | as the path |
//! | `/stillpoint/objects` | `Detection3DArray` | every frame with a pose |
//! | `/stillpoint/objects/markers` | `MarkerArray` | every frame with a pose |
//! | `/stillpoint/camera_info` | `CameraInfo` | every picture |
//! | `/stillpoint/image/compressed` | `CompressedImage` | every picture |
//! | `/stillpoint/mask` | `Image`: moving regions | on request |
//! | `/stillpoint/grid`, `/stillpoint/surface` | `OccupancyGrid`, `PointCloud2` | when provided |
//! | `/diagnostics` | `DiagnosticArray` | every frame |

pub mod axes;
mod cloud;
mod diagnostics;
mod mount;
mod objects;
mod odom;
mod parts;
mod publisher;
mod topic;

pub use mount::Mount;
pub use odom::{Located, Odom};
pub use publisher::{FrameNames, Publisher};
pub use topic::{Outgoing, Topic};
