//! RGB-D data sets, stamp association, and files for other programs.
//!
//! Finds the frames and the camera of a folder, decodes its images, and converts ground truth to this project's conventions. Also writes
//! data sets, trajectories, point clouds and pose graphs. Trajectories are evaluated in the crate `evaluation`.
//!
//! # Layouts
//! | layout | recognised by | stamps | ground truth |
//! |---|---|---|---|
//! | TUM | `rgb.txt` and `depth.txt`, else `associations.txt` | s | `groundtruth.txt` |
//! | Bonn | as TUM, with "bonn" in the folder's name or the camera | s | of a marker, converted to the camera |
//! | ICL-NUIM | `*.gt.freiburg`, or associations that list depth first and frame numbers, or `rgb/0.png` with the preset `icl_nuim` | number / 30 Hz | left-handed, mirrored |
//! | numbered images | `rgb/0.png` and `depth/0.png`, with a camera that is given | number / 30 Hz | `groundtruth.txt` |
//! | 7-Scenes | `frame-000000.color.png`, `.depth.png`, `.pose.txt` | number / 30 Hz | one matrix per frame |
//!
//! # Camera files
//! The camera is the given one, else `camera.toml` or `camera.txt` in the folder, else that of the layout (ICL-NUIM; 7-Scenes in a folder
//! `seq-NN`), else a preset if the folder's name contains `freiburg1` or `fr1`, `freiburg2` or `fr2`, `freiburg3` or `fr3`, or `bonn`. A
//! `camera.txt` holds one line `fx fy cx cy depth_scale` and comments that start with `#`. A `camera.toml`:
//!
//! ```toml
//! name = "my camera"          # optional
//! width = 640                 # px; optional, else the size of the images
//! height = 480
//! fx = 525.0                  # focal lengths and principal point, px
//! fy = 525.0
//! cx = 319.5
//! cy = 239.5
//! distortion = [0.0, 0.0, 0.0, 0.0, 0.0] # k1 k2 p1 p2 k3; optional
//! depth_scale = 5000.0        # depth image values per metre
//! ```
//!
//! # Use
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
mod disturb;
mod error;
mod fault;
mod ground_truth;
mod imu;
mod index;
mod layout;
mod lists;
mod odometry;
mod picture;
pub mod point_cloud;
mod pose_form;
pub mod pose_graph;
mod presets;
mod probe;
mod read_ahead;
mod recorder;
mod regular;
mod samples;
mod set_back;
mod source;
mod splice;
pub mod trajectory;
mod units;
mod write;

pub use associate::{DEFAULT_MAX_DT, associate};
pub use camera::{CameraChoice, CameraModel};
pub use dataset::{Counts, Dataset, Entry, OpenOptions};
pub use decode::{read_colour, read_depth, read_gray};
pub use disturb::{Disturbance, Disturbed};
pub use error::{DatasetError, Result};
pub use fault::{Fault, Faulty};
pub use layout::Layout;
pub use picture::{MOST_PIXELS, decode_image, image_format, image_size};
pub use probe::ScaleDoubt;
pub use read_ahead::ReadAhead;
pub use recorder::{ColourFormat, MoverRow, Recorder};
pub use regular::{open_regular, read_regular, read_regular_text};
pub use set_back::{Mended, SetBack, mend};
pub use source::{DatasetSource, FrameOptions};
pub use splice::{AdaptorError, Clip, Origin, Part, Splice};
pub use stillpoint_files::AtomicFile;
pub use trajectory::StampedPose;
pub use write::write_atomic;
