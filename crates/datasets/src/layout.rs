//! Recognises the layout of a data set folder.

use crate::error::{DatasetError, Result};
use crate::index::numbered;
use crate::lists::{parse_associations, read_text};
use std::path::Path;

/// The supported layouts.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Layout {
    /// TUM RGB-D: `rgb.txt` and `depth.txt`, or an associations file.
    Tum,
    /// Bonn RGB-D Dynamic: as TUM, with ground truth of a marker instead of the camera.
    Bonn,
    /// ICL-NUIM in the TUM-compatible form: numbered images, left-handed ground truth.
    IclNuim,
    /// `rgb/0.png` and `depth/0.png` and so on, of any camera: pairs by number.
    Numbered,
    /// Microsoft 7-Scenes: `frame-000000.color.png`, `.depth.png`, `.pose.txt`.
    SevenScenes,
}

impl std::fmt::Display for Layout {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Tum => "TUM",
            Self::Bonn => "Bonn",
            Self::IclNuim => "ICL-NUIM",
            Self::Numbered => "numbered images",
            Self::SevenScenes => "7-Scenes",
        })
    }
}

impl std::str::FromStr for Layout {
    type Err = String;
    /// From `tum`, `bonn`, `icl` (or `icl-nuim`), `numbered`, `7scenes` (or `7-scenes`).
    fn from_str(s: &str) -> std::result::Result<Self, String> {
        match s.to_lowercase().as_str() {
            "tum" => Ok(Self::Tum),
            "bonn" => Ok(Self::Bonn),
            "icl" | "icl-nuim" | "icl_nuim" => Ok(Self::IclNuim),
            "numbered" => Ok(Self::Numbered),
            "7scenes" | "7-scenes" | "seven_scenes" => Ok(Self::SevenScenes),
            _ => Err(format!(
                "expected a layout (tum, bonn, icl, numbered, 7scenes), found \"{s}\""
            )),
        }
    }
}

/// Common names of association files.
const ASSOCIATION_NAMES: [&str; 5] = [
    "associations.txt",
    "associate.txt",
    "association.txt",
    "associated.txt",
    "assoc.txt",
];

pub(crate) fn names_in(folder: &Path) -> Result<Vec<String>> {
    let read = |source| DatasetError::Read {
        path: folder.to_owned(),
        source,
    };
    let mut names = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(read)? {
        names.push(
            entry
                .map_err(read)?
                .file_name()
                .to_string_lossy()
                .into_owned(),
        );
    }
    names.sort_unstable();
    Ok(names)
}

pub(crate) fn has(names: &[String], name: &str) -> bool {
    names.iter().any(|n| n == name)
}

/// Whether both lists of the TUM layout exist.
pub(crate) fn has_lists(names: &[String]) -> bool {
    has(names, "rgb.txt") && has(names, "depth.txt")
}

pub(crate) fn association_file(names: &[String]) -> Option<&'static str> {
    ASSOCIATION_NAMES.into_iter().find(|n| has(names, n))
}

/// ICL-NUIM's ground truth file: `livingRoom0.gt.freiburg`, `traj0.gt.freiburg`.
pub(crate) fn icl_ground_truth(names: &[String]) -> Option<&str> {
    names
        .iter()
        .map(String::as_str)
        .find(|n| n.ends_with(".gt.freiburg"))
}

/// The layout of a folder with the reason; `looks_like_bonn` comes from the folder's name.
pub(crate) fn guess(
    folder: &Path,
    names: &[String],
    looks_like_bonn: bool,
) -> Result<(Layout, String)> {
    if names.iter().any(|n| {
        n.starts_with("frame-") && (n.ends_with(".color.png") || n.ends_with(".depth.png"))
    }) {
        return Ok((
            Layout::SevenScenes,
            "frame-NNNNNN.color.png, .depth.png".into(),
        ));
    }
    if icl_ground_truth(names).is_some() {
        return Ok((Layout::IclNuim, "a .gt.freiburg file".into()));
    }
    let files = if has_lists(names) {
        "rgb.txt and depth.txt"
    } else if let Some(file) = association_file(names) {
        let path = folder.join(file);
        let list = parse_associations(&read_text(&path)?, &path)?;
        if list.depth_first && list.is_numbered() {
            let why = format!("{file} lists depth first and frame numbers");
            return Ok((Layout::IclNuim, why));
        }
        file
    } else if has(names, "rgb.txt") {
        "rgb.txt"
    } else if numbered(&folder.join("rgb")).is_ok_and(|l| l.first().is_some_and(|f| f.0 < 2)) {
        // This naming is too common to imply a camera.
        return Ok((Layout::Numbered, "images rgb/0.png, rgb/1.png, ...".into()));
    } else {
        return Err(unknown(folder, names));
    };
    if looks_like_bonn {
        Ok((Layout::Bonn, format!("{files}, \"bonn\" in the name")))
    } else {
        Ok((Layout::Tum, files.into()))
    }
}

pub(crate) fn unknown(folder: &Path, names: &[String]) -> DatasetError {
    const SHOWN: usize = 6;
    let mut found = names
        .iter()
        .take(SHOWN)
        .cloned()
        .collect::<Vec<_>>()
        .join(", ");
    if names.len() > SHOWN {
        found += &format!(", ... ({} names)", names.len());
    }
    // Giving the parent folder is the usual mistake.
    let below = names.iter().find(|n| {
        let inner = names_in(&folder.join(n)).unwrap_or_default();
        !inner.is_empty() && guess_is_possible(&inner)
    });
    let advice = below.map_or("name the folder of one sequence".to_owned(), |n| {
        format!("did you mean {}?", folder.join(n).display())
    });
    DatasetError::UnknownLayout {
        path: folder.to_owned(),
        found,
        advice,
    }
}

fn guess_is_possible(names: &[String]) -> bool {
    has(names, "rgb.txt")
        || association_file(names).is_some()
        || icl_ground_truth(names).is_some()
        || names.iter().any(|n| n.ends_with(".color.png"))
}
