//! What can be wrong with a data set, said so that the user can correct it.

use std::path::{Path, PathBuf};

/// Result of this crate.
pub type Result<T> = std::result::Result<T, DatasetError>;

/// A data set, camera or trajectory file cannot be used. Every message names the place, what was expected, what was
/// found, and what to do.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// The folder does not exist, or is no folder.
    #[error("{}: expected a data set folder, found {found}; check the path", path.display())]
    NoFolder {
        /// The folder asked for.
        path: PathBuf,
        /// What is there instead.
        found: &'static str,
    },
    /// The folder is there and holds nothing.
    #[error("{}: expected a data set, found an empty folder; unpack the data set into it", path.display())]
    EmptyFolder {
        /// The folder.
        path: PathBuf,
    },
    /// There are colour images, but no depth images.
    #[error("{}: expected {expected}, found {found}; an RGB-D data set is needed: get or export its depth images", path.display())]
    NoDepth {
        /// The folder or list.
        path: PathBuf,
        /// What the layout asks for.
        expected: String,
        /// What is there.
        found: String,
    },
    /// None of the layouts fits.
    #[error("{}: expected rgb.txt and depth.txt or an associations file (TUM, Bonn), rgb/0.png and depth/0.png (ICL-NUIM, and others with a camera file), or frame-000000.color.png (7-Scenes); found {found}; {advice}", path.display())]
    UnknownLayout {
        /// The folder.
        path: PathBuf,
        /// What it holds.
        found: String,
        /// What to do.
        advice: String,
    },
    /// Nothing tells the camera.
    #[error("{}: expected a known camera, found {found}; name a preset ({choices}) or a camera file, or put a camera.toml or camera.txt (fx fy cx cy depth_scale) into the folder", path.display())]
    UnknownCamera {
        /// The data set folder, or the camera file asked for.
        path: PathBuf,
        /// What was looked at.
        found: String,
        /// The presets.
        choices: String,
    },
    /// The lens cannot be that of images of this size.
    #[error("{}: expected a camera with {}, found {name} with {}; correct the camera file, or name another camera", path.display(), reason.expected(), reason.found())]
    Camera {
        /// The data set folder.
        path: PathBuf,
        /// The camera's name.
        name: String,
        /// What is wrong.
        reason: stillpoint_geometry::CameraError,
    },
    /// A line of a text file does not read.
    #[error("{}:{line}: expected {expected}, found {found}; {advice}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// What the line should hold.
        expected: String,
        /// What it holds.
        found: String,
        /// What to do.
        advice: String,
    },
    /// A stamp is not later than the one before it.
    #[error("{}:{line}: expected a stamp after {previous:.6}, found {found:.6}, which {}", path.display(), behind(*previous, *found))]
    StampOrder {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The stamp before, s.
        previous: f64,
        /// The stamp found, s.
        found: f64,
    },
    /// A list holds nothing, or nothing fits together.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    NoFrames {
        /// The list or folder.
        path: PathBuf,
        /// What was needed.
        expected: String,
        /// What was there.
        found: String,
        /// What to do.
        advice: String,
    },
    /// An image is missing, broken or of the wrong kind or size.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// What was needed.
        expected: String,
        /// What was there.
        found: String,
        /// What to do.
        advice: String,
    },
    /// No depth image that was looked at holds a measurement.
    #[error("{}: expected depth values, found {images} depth images that are zero everywhere; check the export of the depth images", path.display())]
    DepthEmpty {
        /// The first of them.
        path: PathBuf,
        /// How many were looked at.
        images: usize,
    },
    /// Reading failed for a reason of the system.
    #[error("{}: expected to read it, found: {source}; check that the file exists and may be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Writing failed for a reason of the system.
    #[error("{}: expected to write it, found: {source}; check the folder's permissions and the free space", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// Something is there that would be overwritten.
    #[error("{}: expected a new or empty folder, found {found}; choose another folder or remove this one", path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// What it holds.
        found: String,
    },
}

impl DatasetError {
    /// The file or folder that the error is about.
    #[must_use]
    pub fn path(&self) -> &Path {
        match self {
            Self::NoFolder { path, .. }
            | Self::EmptyFolder { path }
            | Self::NoDepth { path, .. }
            | Self::UnknownLayout { path, .. }
            | Self::UnknownCamera { path, .. }
            | Self::Camera { path, .. }
            | Self::Malformed { path, .. }
            | Self::StampOrder { path, .. }
            | Self::NoFrames { path, .. }
            | Self::Image { path, .. }
            | Self::DepthEmpty { path, .. }
            | Self::Read { path, .. }
            | Self::Write { path, .. }
            | Self::Occupied { path, .. } => path,
        }
    }

    /// The line, from 1, where the error is about one.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        match self {
            Self::Malformed { line, .. } | Self::StampOrder { line, .. } => Some(*line),
            _ => None,
        }
    }
}

/// How a stamp is behind the one before, and what to do.
fn behind(previous: f64, found: f64) -> String {
    if found < previous {
        format!(
            "goes back by {:.6} s; where the clock was set back, add that and a usual step to the stamps from there on, else sort the lines by stamp",
            previous - found
        )
    } else {
        "repeats; keep one line of each stamp".to_owned()
    }
}

/// Text of a file as it may be quoted in a message: one line, not too long, no control characters.
pub(crate) fn quote(text: &str) -> String {
    const LONGEST: usize = 60;
    let mut s: String = text
        .chars()
        .take(LONGEST)
        .map(|c| if c.is_control() { ' ' } else { c })
        .collect();
    if text.chars().nth(LONGEST).is_some() {
        s.push_str("...");
    }
    format!("\"{s}\"")
}
