//! One way to open folders and files.

use crate::error::{RecordingError, Result};
use crate::file::FileRecording;
use crate::source::RecordingSource;
use std::path::Path;
use stillpoint_datasets::{
    CameraChoice, CameraModel, Dataset, DatasetSource, FrameOptions, SetBack, StampedPose,
};
use stillpoint_geometry::{ImuModel, OdometryModel};
use stillpoint_imaging::{FrameSource, ImuSample, OdometrySample, RgbdFrame, SourceError};

/// How to open a data set or recording; the default guesses everything.
#[derive(Clone, Debug)]
pub struct OpenOptions {
    /// The camera; `None` guesses it, or takes the recording's own.
    pub camera: Option<CameraChoice>,
    /// One unreadable frame ends the stream instead of being skipped.
    pub strict: bool,
    /// Largest difference between the stamps of colour and depth, s.
    pub max_dt: f64,
    /// The topic of colour images; `None` guesses it. Recordings only, as the options below.
    pub colour_topic: Option<String>,
    /// The topic of depth images; `None` guesses it.
    pub depth_topic: Option<String>,
    /// The topic of the colour camera's calibration; `None` takes the one beside the images, else the only one of their frame and size.
    pub info_topic: Option<String>,
    /// A topic of poses or odometry that is ground truth; `None` for no ground truth.
    pub truth_topic: Option<String>,
    /// The topic of the inertial sensor's angular rates; `None` takes the camera's own where it is known how it is mounted.
    pub imu_topic: Option<String>,
    /// No inertial sensor, of a folder neither.
    pub no_imu: bool,
    /// The topic of the wheels' odometry; `None` takes the only one that can be of wheels, where it is known how the camera stands on the base.
    pub odometry_topic: Option<String>,
    /// No odometry, of a folder neither.
    pub no_odometry: bool,
    /// Depth image values per metre; `None` for what the device says, else 1000, and 1 of floats.
    pub depth_scale: Option<f64>,
}

impl Default for OpenOptions {
    fn default() -> Self {
        let folders = stillpoint_datasets::OpenOptions::default();
        Self {
            camera: None,
            strict: false,
            max_dt: folders.max_dt,
            colour_topic: None,
            depth_topic: None,
            info_topic: None,
            truth_topic: None,
            imu_topic: None,
            no_imu: false,
            odometry_topic: None,
            no_odometry: false,
            depth_scale: None,
        }
    }
}

/// A camera that is asked for frames while they are taken.
pub trait Device: std::fmt::Debug + Send + Sync {
    /// What it is: its name and number.
    fn kind(&self) -> String;

    /// The camera of the frames.
    fn camera(&self) -> &CameraModel;

    /// What was found out about it, one sentence each, for the user to check.
    fn guesses(&self) -> &[String];

    /// Its frames from now on; `keep_colour` with their colours.
    ///
    /// # Errors
    /// Its frames were asked for before, or it does not start.
    fn frames(&self, keep_colour: bool) -> Result<Box<dyn FrameSource>>;
}

/// A data set folder, a recording or a camera.
#[derive(Debug)]
pub enum Input {
    /// A folder of images.
    Folder(Box<Dataset>),
    /// A file of messages.
    File(Box<FileRecording>),
    /// A camera.
    Device(Box<dyn Device>),
}

/// Whether what is at a path is a recording: a file that begins as one of the formats does, or a folder of rosbag2.
#[must_use]
pub fn is_recording(path: &Path) -> bool {
    if path.is_dir() {
        return crate::rosbag2::is_folder(path);
    }
    path.is_file() && crate::recording::begins_as_one(path)
}

/// Opens a data set folder or a recording.
///
/// # Errors
/// [`crate::RecordingError`]: see its variants.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Input> {
    if path.is_file() || crate::rosbag2::is_folder(path) {
        let file = FileRecording::open(path, options).map_err(RecordingError::on_one_line)?;
        return Ok(Input::File(Box::new(file)));
    }
    let folder = stillpoint_datasets::OpenOptions {
        camera: options.camera.clone(),
        strict: options.strict,
        max_dt: options.max_dt,
        ..stillpoint_datasets::OpenOptions::default()
    };
    let mut dataset = Dataset::open(path, &folder)?;
    if options.no_imu {
        dataset.leave_out_inertial();
    }
    if options.no_odometry {
        dataset.leave_out_odometry();
    }
    Ok(Input::Folder(Box::new(dataset)))
}

impl Input {
    /// What it is: the layout of a folder, the format of a file.
    #[must_use]
    pub fn kind(&self) -> String {
        match self {
            Self::Folder(d) => d.layout().to_string(),
            Self::File(f) => f.format().to_owned(),
            Self::Device(d) => d.kind(),
        }
    }

    /// The camera, with the size of the images.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        match self {
            Self::Folder(d) => d.camera(),
            Self::File(f) => f.camera(),
            Self::Device(d) => d.camera(),
        }
    }

    /// The odometry of the base that carries the camera, where there are samples of it.
    #[must_use]
    pub fn odometry(&self) -> Option<OdometryModel> {
        match self {
            Self::Folder(d) => d.camera().odometry.filter(|_| !d.odometry().is_empty()),
            Self::File(f) => f.camera().odometry,
            Self::Device(d) => d.camera().odometry,
        }
    }

    /// The inertial sensor of the camera, where there are samples of it.
    #[must_use]
    pub fn imu(&self) -> Option<ImuModel> {
        match self {
            Self::Folder(d) => d.camera().imu.filter(|_| !d.inertial().is_empty()),
            Self::File(f) => f.camera().imu,
            Self::Device(d) => d.camera().imu,
        }
    }

    /// Stamps of colour and depth of each frame, s, in order of time; none of frames that are still to come.
    #[must_use]
    pub fn stamps(&self) -> Vec<(f64, f64)> {
        match self {
            Self::Folder(d) => d
                .entries()
                .iter()
                .map(|e| (e.stamp, e.depth_stamp))
                .collect(),
            Self::File(f) => f.stamps().collect(),
            Self::Device(_) => Vec::new(),
        }
    }

    /// What was guessed and why, one sentence each, for the user to check.
    #[must_use]
    pub fn guesses(&self) -> &[String] {
        match self {
            Self::Folder(d) => d.guesses(),
            Self::File(f) => f.guesses(),
            Self::Device(d) => d.guesses(),
        }
    }

    /// What looks wrong but can be worked with, one sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Folder(d) => d.warnings(),
            Self::File(f) => f.warnings(),
            Self::Device(_) => &[],
        }
    }

    /// A source of the frames, decoded. Those of a camera begin now, whatever the start.
    ///
    /// # Errors
    /// A start behind the last frame; a camera that does not start.
    pub fn frames(&self, options: &FrameOptions) -> Result<Source> {
        Ok(match self {
            Self::Folder(d) => Source::Folder(d.frames(options)?),
            Self::File(f) => Source::File(f.frames(options)?),
            Self::Device(d) => Source::Device(Box::new(Taken {
                frames: d.frames(options.keep_colour)?,
                left: options.max_frames,
            })),
        })
    }

    /// Where the clock was set back that stamped the images.
    #[must_use]
    pub fn set_back(&self) -> &[SetBack] {
        match self {
            Self::Folder(d) => d.set_back(),
            Self::File(f) => f.set_back(),
            Self::Device(_) => &[],
        }
    }

    /// The ground truth as poses `world_from_camera` of the colour camera, if there is any.
    ///
    /// # Errors
    /// As [`Dataset::ground_truth`].
    pub fn ground_truth(&self) -> Result<Option<Vec<StampedPose>>> {
        Ok(self.ground_truth_said()?.map(|(poses, _)| poses))
    }

    /// The same, and in a sentence each what was found out about its file.
    ///
    /// # Errors
    /// As [`Dataset::ground_truth`].
    pub fn ground_truth_said(&self) -> Result<Option<(Vec<StampedPose>, Vec<String>)>> {
        match self {
            Self::Folder(d) => Ok(d.ground_truth_said()?),
            Self::File(f) => Ok(f.ground_truth_said()),
            Self::Device(_) => Ok(None),
        }
    }
}

/// Some of the frames of a camera.
pub struct Taken {
    frames: Box<dyn FrameSource>,
    /// Frames that are still to be given; `None` for all.
    left: Option<usize>,
}

impl std::fmt::Debug for Taken {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_struct("Taken")
            .field("left", &self.left)
            .finish_non_exhaustive()
    }
}

impl FrameSource for Taken {
    fn next_frame(&mut self) -> Option<std::result::Result<RgbdFrame, SourceError>> {
        if self.left == Some(0) {
            return None;
        }
        let next = self.frames.next_frame()?;
        if next.is_ok() {
            self.left = self.left.map(|n| n - 1);
        }
        Some(next)
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        self.frames.take_inertial()
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        self.frames.take_odometry()
    }

    fn is_live(&self) -> bool {
        self.frames.is_live()
    }
}

/// The frames of an [`Input`].
#[derive(Debug)]
pub enum Source {
    /// Of a folder.
    Folder(DatasetSource),
    /// Of a file.
    File(RecordingSource),
    /// Of a camera.
    Device(Box<Taken>),
}

impl FrameSource for Source {
    fn next_frame(&mut self) -> Option<std::result::Result<RgbdFrame, SourceError>> {
        match self {
            Self::Folder(s) => s.next_frame(),
            Self::File(s) => s.next_frame(),
            Self::Device(s) => s.next_frame(),
        }
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        match self {
            Self::Folder(s) => s.take_inertial(),
            Self::File(s) => s.take_inertial(),
            Self::Device(s) => s.take_inertial(),
        }
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        match self {
            Self::Folder(s) => s.take_odometry(),
            Self::File(s) => s.take_odometry(),
            Self::Device(s) => s.take_odometry(),
        }
    }

    fn remaining(&self) -> Option<usize> {
        match self {
            Self::Folder(s) => s.remaining(),
            Self::File(s) => s.remaining(),
            Self::Device(s) => s.remaining(),
        }
    }

    fn is_live(&self) -> bool {
        matches!(self, Self::Device(s) if s.is_live())
    }
}
