//! Errors of data sets.

use std::path::{Path, PathBuf};

/// Result of this crate.
pub type Result<T> = std::result::Result<T, DatasetError>;

/// A data set, camera or trajectory file cannot be used. Every message states the location, the expectation, the finding, and the remedy.
#[derive(Debug, thiserror::Error)]
#[non_exhaustive]
pub enum DatasetError {
    /// The folder does not exist, or is not a folder.
    #[error("{}: expected a data set folder, found {found}; check the path", path.display())]
    NoFolder {
        /// The given path.
        path: PathBuf,
        /// Finding.
        found: &'static str,
    },
    /// The folder is empty.
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
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
    },
    /// The folder has no known layout.
    #[error("{}: expected rgb.txt and depth.txt or an associations file (TUM, Bonn), rgb/0.png and depth/0.png (ICL-NUIM, and others with a camera file), or frame-000000.color.png (7-Scenes); found {found}; {advice}", path.display())]
    UnknownLayout {
        /// The folder.
        path: PathBuf,
        /// Its contents.
        found: String,
        /// Remedy.
        advice: String,
    },
    /// The camera is unknown.
    #[error("{}: expected a known camera, found {found}; name a preset ({choices}) or a camera file, or put a camera.toml or camera.txt (fx fy cx cy depth_scale) into the folder", path.display())]
    UnknownCamera {
        /// The data set folder, or the given camera file.
        path: PathBuf,
        /// The places that were searched.
        found: String,
        /// The presets.
        choices: String,
    },
    /// The lens is not valid for this image size.
    #[error("{}: expected a camera with {}, found {name} with {}; correct the camera file, or name another camera", path.display(), reason.expected(), reason.found())]
    Camera {
        /// The data set folder.
        path: PathBuf,
        /// The camera's name.
        name: String,
        /// The reason.
        reason: stillpoint_geometry::CameraError,
    },
    /// A line of a text file cannot be parsed.
    #[error("{}:{line}: expected {expected}, found {found}; {advice}", path.display())]
    Malformed {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
        /// Remedy.
        advice: String,
    },
    /// A stamp is not later than the previous one.
    #[error("{}:{line}: expected a stamp after {previous:.6}, found {found:.6}, which {}", path.display(), behind(*previous, *found))]
    StampOrder {
        /// The file.
        path: PathBuf,
        /// Line, from 1.
        line: usize,
        /// The previous stamp, s.
        previous: f64,
        /// The stamp found, s.
        found: f64,
    },
    /// A list is empty, or no images can be associated.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    NoFrames {
        /// The list or folder.
        path: PathBuf,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
        /// Remedy.
        advice: String,
    },
    /// An image is missing, damaged, or of the wrong format or size.
    #[error("{}: expected {expected}, found {found}; {advice}", path.display())]
    Image {
        /// The image.
        path: PathBuf,
        /// Expectation.
        expected: String,
        /// Finding.
        found: String,
        /// Remedy.
        advice: String,
    },
    /// None of the examined depth images has a measurement.
    #[error("{}: expected depth values, found {images} depth images that are zero everywhere; check the export of the depth images", path.display())]
    DepthEmpty {
        /// The first of them.
        path: PathBuf,
        /// Their number.
        images: usize,
    },
    /// The system could not read a file.
    #[error("{}: expected to read it, found: {source}; check that the file exists and may be read", path.display())]
    Read {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// The system could not write a file.
    #[error("{}: expected to write it, found: {source}; check the folder's permissions and the free space", path.display())]
    Write {
        /// The file.
        path: PathBuf,
        /// The system's reason.
        source: std::io::Error,
    },
    /// An existing file or folder would be overwritten.
    #[error("{}: expected a new or empty folder, found {found}; choose another folder or remove this one", path.display())]
    Occupied {
        /// The folder.
        path: PathBuf,
        /// Its contents.
        found: String,
    },
}

impl DatasetError {
    /// The file or folder of the error.
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

    /// The line of the error, from 1, if any.
    #[must_use]
    pub fn line(&self) -> Option<usize> {
        match self {
            Self::Malformed { line, .. } | Self::StampOrder { line, .. } => Some(*line),
            _ => None,
        }
    }
}

/// Relation of a stamp to the previous one, with advice.
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

/// Quotes text from a file in one short line, without control characters.
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
