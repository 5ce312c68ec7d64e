//! One way to open folders and files.

use crate::error::Result;
use crate::file::FileRecording;
use crate::source::RecordingSource;
use std::path::Path;
use stillpoint_datasets::{
    CameraChoice, CameraModel, Dataset, DatasetSource, FrameOptions, StampedPose,
};
use stillpoint_imaging::{FrameSource, RgbdFrame, SourceError};

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
    /// A topic of poses or odometry that is ground truth; `None` for no ground truth.
    pub truth_topic: Option<String>,
    /// Depth image values per metre; `None` for what the device says, else 1000.
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
            truth_topic: None,
            depth_scale: None,
        }
    }
}

/// A data set folder or a recording.
#[derive(Debug)]
pub enum Input {
    /// A folder of images.
    Folder(Box<Dataset>),
    /// A file of messages.
    File(Box<FileRecording>),
}

/// Opens a data set folder or a recording.
///
/// # Errors
/// [`crate::RecordingError`]: see its variants.
pub fn open(path: &Path, options: &OpenOptions) -> Result<Input> {
    if path.is_file() || crate::rosbag2::is_folder(path) {
        return FileRecording::open(path, options).map(|f| Input::File(Box::new(f)));
    }
    let folder = stillpoint_datasets::OpenOptions {
        camera: options.camera.clone(),
        strict: options.strict,
        max_dt: options.max_dt,
        ..stillpoint_datasets::OpenOptions::default()
    };
    Ok(Input::Folder(Box::new(Dataset::open(path, &folder)?)))
}

impl Input {
    /// What it is: the layout of a folder, the format of a file.
    #[must_use]
    pub fn kind(&self) -> String {
        match self {
            Self::Folder(d) => d.layout().to_string(),
            Self::File(f) => f.format().to_owned(),
        }
    }

    /// The camera, with the size of the images.
    #[must_use]
    pub fn camera(&self) -> &CameraModel {
        match self {
            Self::Folder(d) => d.camera(),
            Self::File(f) => f.camera(),
        }
    }

    /// Stamps of colour and depth of each frame, s, in order of time.
    #[must_use]
    pub fn stamps(&self) -> Vec<(f64, f64)> {
        match self {
            Self::Folder(d) => d
                .entries()
                .iter()
                .map(|e| (e.stamp, e.depth_stamp))
                .collect(),
            Self::File(f) => f.stamps().collect(),
        }
    }

    /// What was guessed and why, one sentence each, for the user to check.
    #[must_use]
    pub fn guesses(&self) -> &[String] {
        match self {
            Self::Folder(d) => d.guesses(),
            Self::File(f) => f.guesses(),
        }
    }

    /// What looks wrong but can be worked with, one sentence each.
    #[must_use]
    pub fn warnings(&self) -> &[String] {
        match self {
            Self::Folder(d) => d.warnings(),
            Self::File(f) => f.warnings(),
        }
    }

    /// A source of the frames, decoded.
    ///
    /// # Errors
    /// A start behind the last frame.
    pub fn frames(&self, options: &FrameOptions) -> Result<Source> {
        Ok(match self {
            Self::Folder(d) => Source::Folder(d.frames(options)?),
            Self::File(f) => Source::File(f.frames(options)?),
        })
    }

    /// The ground truth as poses `world_from_camera` of the colour camera, if there is any.
    ///
    /// # Errors
    /// As [`Dataset::ground_truth`].
    pub fn ground_truth(&self) -> Result<Option<Vec<StampedPose>>> {
        match self {
            Self::Folder(d) => Ok(d.ground_truth()?),
            Self::File(f) => Ok(f.ground_truth()),
        }
    }
}

/// The frames of an [`Input`].
#[derive(Debug)]
pub enum Source {
    /// Of a folder.
    Folder(DatasetSource),
    /// Of a file.
    File(RecordingSource),
}

impl FrameSource for Source {
    fn next_frame(&mut self) -> Option<std::result::Result<RgbdFrame, SourceError>> {
        match self {
            Self::Folder(s) => s.next_frame(),
            Self::File(s) => s.next_frame(),
        }
    }

    fn remaining(&self) -> Option<usize> {
        match self {
            Self::Folder(s) => s.remaining(),
            Self::File(s) => s.remaining(),
        }
    }
}
