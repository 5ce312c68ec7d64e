//! Opens data set folders, recordings and cameras alike.

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
    /// The camera; `None` guesses it, or uses the recording's own.
    pub camera: Option<CameraChoice>,
    /// End the stream at an unreadable frame instead of skipping it.
    pub strict: bool,
    /// Maximum difference between the stamps of colour and depth, s.
    pub max_dt: f64,
    /// The topic of colour images; `None` guesses it. Recordings only, as the options below.
    pub colour_topic: Option<String>,
    /// The topic of depth images; `None` guesses it.
    pub depth_topic: Option<String>,
    /// The topic of the colour camera's calibration; `None` uses the one beside the images, else the only one of their frame and size.
    pub info_topic: Option<String>,
    /// A topic of ground truth poses or odometry; `None` for no ground truth.
    pub truth_topic: Option<String>,
    /// The topic of the inertial sensor's angular rates; `None` uses the camera's own sensor where its mounting is known.
    pub imu_topic: Option<String>,
    /// Do not use an inertial sensor, also of a folder.
    pub no_imu: bool,
    /// The topic of wheel odometry; `None` uses the only candidate, where the camera's pose on the base is known.
    pub odometry_topic: Option<String>,
    /// Do not use odometry, also of a folder.
    pub no_odometry: bool,
    /// Depth values per metre; `None` uses the device's value, else 1000, and 1 for floats.
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

/// A live camera.
pub trait Device: std::fmt::Debug + Send + Sync {
    /// Its name and serial number.
    fn kind(&self) -> String;

    /// The camera of the frames.
    fn camera(&self) -> &CameraModel;

    /// Guesses about it, one sentence each, for the user to check.
    fn guesses(&self) -> &[String];

    /// Starts its frames; `keep_colour` includes colour images.
    ///
    /// # Errors
    /// A second call, or a camera that does not start.
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

/// Whether a path is a recording: a file with the signature of a known format, or a rosbag2 folder.
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
    /// The layout of a folder, or the format of a file.
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

    /// The model of the base's odometry, if there are samples of it.
    #[must_use]
    pub fn odometry(&self) -> Option<OdometryModel> {
        match self {
            Self::Folder(d) => d.camera().odometry.filter(|_| !d.odometry().is_empty()),
            Self::File(f) => f.camera().odometry,
            Self::Device(d) => d.camera().odometry,
        }
    }

    /// The model of the inertial sensor, if there are samples of it.
    #[must_use]
    pub fn imu(&self) -> Option<ImuModel> {
        match self {
            Self::Folder(d) => d.camera().imu.filter(|_| !d.inertial().is_empty()),
            Self::File(f) => f.camera().imu,
            Self::Device(d) => d.camera().imu,
        }
    }

    /// Colour and depth stamps of each frame, s, in time order; empty for a live camera.
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

    /// Guesses with their reasons, one sentence each, for the user to check.
    #[must_use]
    pub fn guesses(&self) -> &[String] {
        match self {
            Self::Folder(d) => d.guesses(),
            Self::File(f) => f.guesses(),
            Self::Device(d) => d.guesses(),
        }
    }

    /// Suspicious but usable properties, one sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Folder(d) => d.warnings(),
            Self::File(f) => f.warnings(),
            Self::Device(_) => &[],
        }
    }

    /// A source of the decoded frames. Those of a camera start at once, whatever the start option.
    ///
    /// # Errors
    /// A start after the last frame; a camera that does not start.
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

    /// Where the clock that stamped the images was set back.
    #[must_use]
    pub fn set_back(&self) -> &[SetBack] {
        match self {
            Self::Folder(d) => d.set_back(),
            Self::File(f) => f.set_back(),
            Self::Device(_) => &[],
        }
    }

    /// Ground truth poses `world_from_camera` of the colour camera, if any.
    ///
    /// # Errors
    /// As [`Dataset::ground_truth`].
    pub fn ground_truth(&self) -> Result<Option<Vec<StampedPose>>> {
        Ok(self.ground_truth_said()?.map(|(poses, _)| poses))
    }

    /// Like [`Self::ground_truth`], with remarks about its file, one sentence each.
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

/// A limited number of frames of a camera.
pub struct Taken {
    frames: Box<dyn FrameSource>,
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
