//! Cameras: presets and camera files.
//!
//! The crate's documentation describes the formats.

use crate::error::{DatasetError, Result, quote};
use crate::imu::{self, ImuTable};
use crate::lists::{data_lines, parse_numbers, read_text};
use crate::odometry::{self, OdometryTable};
use crate::presets::{preset_names, preset_text};
use std::path::{Path, PathBuf};
use stillpoint_geometry::{BrownConrady, Camera, ImuModel, OdometryModel};

/// A camera with the scale of its depth images.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraModel {
    /// Name of the preset, or from the camera file, or the file.
    pub name: String,
    /// Lens and size of the images, px. A size of 0 x 0 is replaced by that of the images when a data set is opened.
    pub camera: Camera,
    /// Depth image values per metre.
    pub depth_scale: f64,
    /// Whether it comes from a data sheet's field of view instead of a calibration: a device differs by some per cent.
    pub nominal: bool,
    /// The inertial sensor mounted on it, if known.
    pub imu: Option<ImuModel>,
    /// The odometry of the base that carries it, if the camera's pose on it is known.
    pub odometry: Option<OdometryModel>,
}

/// The user's choice: a preset, or a camera file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraChoice {
    /// A preset, see [`CameraModel::preset_names`].
    Preset(String),
    /// A camera file, TOML or text.
    File(PathBuf),
}

impl CameraChoice {
    /// A preset if one has this name, else a file.
    #[must_use]
    pub fn from_argument(text: &str) -> Self {
        if preset_text(text).is_some() {
            Self::Preset(text.to_owned())
        } else {
            Self::File(PathBuf::from(text))
        }
    }
}

#[derive(serde::Deserialize)]
#[serde(deny_unknown_fields)]
struct CameraFile {
    name: Option<String>,
    #[serde(default)]
    width: u32,
    #[serde(default)]
    height: u32,
    fx: f64,
    fy: f64,
    cx: f64,
    cy: f64,
    #[serde(default)]
    distortion: Option<Vec<f64>>,
    depth_scale: f64,
    #[serde(default)]
    nominal: bool,
    imu: Option<ImuTable>,
    odometry: Option<OdometryTable>,
}

impl CameraModel {
    /// The names of the presets.
    pub fn preset_names() -> impl Iterator<Item = &'static str> {
        preset_names()
    }

    /// A preset by its name or one of its short names (`fr1`, `freiburg1`, `icl`, `7scenes`, ...).
    ///
    /// # Errors
    /// [`DatasetError::UnknownCamera`] with the choices.
    pub fn preset(name: &str) -> Result<Self> {
        let (name, text) = preset_text(name).ok_or_else(|| unknown(Path::new(name)))?;
        Self::parse_toml(text, &PathBuf::from(format!("preset {name}")))
    }

    /// Reads a camera file: TOML by its extension, else text.
    ///
    /// # Errors
    /// [`DatasetError::UnknownCamera`] for a missing file, [`DatasetError::Read`], [`DatasetError::Malformed`].
    pub fn from_file(path: &Path) -> Result<Self> {
        if !path.is_file() {
            return Err(unknown(path));
        }
        let text = read_text(path)?;
        if path.extension().is_some_and(|e| e == "toml") {
            Self::parse_toml(&text, path)
        } else {
            Self::parse_text(&text, path)
        }
    }

    /// The camera that the user chose.
    ///
    /// # Errors
    /// As [`CameraModel::preset`] and [`CameraModel::from_file`].
    pub fn choose(choice: &CameraChoice) -> Result<Self> {
        match choice {
            CameraChoice::Preset(name) => Self::preset(name),
            CameraChoice::File(path) => Self::from_file(path),
        }
    }

    /// Parses a camera in TOML; `path` is for messages.
    ///
    /// # Errors
    /// [`DatasetError::Malformed`].
    pub fn parse_toml(text: &str, path: &Path) -> Result<Self> {
        let file: CameraFile = toml::from_str(text).map_err(|e| {
            let at = e.span().map_or(0, |s| s.start.min(text.len()));
            DatasetError::Malformed {
                path: path.to_owned(),
                line: text.as_bytes()[..at].iter().filter(|b| **b == b'\n').count() + 1,
                expected: "a camera: fx, fy, cx, cy, depth_scale, and where wanted name, width, height, distortion = [k1, k2, p1, p2, k3]".into(),
                found: e.message().replace('\n', " "),
                advice: "correct the camera file".into(),
            }
        })?;
        let [k1, k2, p1, p2, k3] = coefficients(file.distortion.as_deref(), text, path)?;
        let malformed = |table: &str, (expected, found): (String, String)| {
            let is_table = |l: &str| l.trim_start().starts_with(table);
            DatasetError::Malformed {
                path: path.to_owned(),
                line: text.lines().position(is_table).map_or(1, |i| i + 1),
                expected,
                found,
                advice: "correct the camera file".into(),
            }
        };
        let imu = file.imu.as_ref().map(ImuTable::model).transpose();
        let imu = imu.map_err(|e| malformed("[imu]", e))?;
        let odometry = file.odometry.as_ref().map(OdometryTable::model);
        let odometry = odometry.transpose();
        let odometry = odometry.map_err(|e| malformed("[odometry]", e))?;
        let model = Self {
            imu,
            odometry,
            name: file.name.unwrap_or_else(|| path.display().to_string()),
            camera: Camera {
                distortion: BrownConrady { k1, k2, p1, p2, k3 },
                ..Camera::pinhole(
                    file.width,
                    file.height,
                    [file.fx, file.fy, file.cx, file.cy],
                )
            },
            depth_scale: file.depth_scale,
            nominal: file.nominal,
        };
        model.check(path, 1)?;
        Ok(model)
    }

    /// Parses `fx fy cx cy depth_scale`; `path` is for messages.
    ///
    /// # Errors
    /// [`DatasetError::Malformed`].
    fn parse_text(text: &str, path: &Path) -> Result<Self> {
        const EXPECTED: &str = "one line of 5 numbers: fx fy cx cy depth_scale";
        let malformed = |line, found: String| DatasetError::Malformed {
            path: path.to_owned(),
            line,
            expected: EXPECTED.into(),
            found,
            advice: "correct the camera file, or write a camera.toml".into(),
        };
        let mut lines = data_lines(text);
        let line = lines
            .next()
            .ok_or_else(|| malformed(1, "no such line".into()))?;
        if let Some(second) = lines.next() {
            return Err(malformed(
                second.number,
                format!("a second line {}", quote(second.text)),
            ));
        }
        let [fx, fy, cx, cy, depth_scale] = parse_numbers::<5>(&line, path, EXPECTED)?;
        let model = Self {
            name: path.display().to_string(),
            camera: Camera::pinhole(0, 0, [fx, fy, cx, cy]),
            depth_scale,
            nominal: false,
            imu: None,
            odometry: None,
        };
        model.check(path, line.number)?;
        Ok(model)
    }

    /// The camera as a TOML file.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let c = &self.camera;
        let d = &c.distortion;
        // Quoted as a TOML basic string; after the filter only these two characters need escapes.
        let name: String = self
            .name
            .chars()
            .filter(|c| !c.is_control())
            .collect::<String>()
            .replace('\\', "\\\\")
            .replace('"', "\\\"");
        format!(
            "name = \"{name}\"\nwidth = {}\nheight = {}\nfx = {:?}\nfy = {:?}\ncx = {:?}\ncy = {:?}\ndistortion = [{:?}, {:?}, {:?}, {:?}, {:?}] # k1 k2 p1 p2 k3\ndepth_scale = {:?} # depth image values per metre\n{}{}{}",
            c.width,
            c.height,
            c.fx,
            c.fy,
            c.cx,
            c.cy,
            d.k1,
            d.k2,
            d.p1,
            d.p2,
            d.k3,
            self.depth_scale,
            if self.nominal {
                "nominal = true # not calibrated\n"
            } else {
                ""
            },
            self.imu.as_ref().map(imu::to_toml).unwrap_or_default(),
            self.odometry
                .as_ref()
                .map(odometry::to_toml)
                .unwrap_or_default(),
        )
    }

    /// Rejects impossible values. Without an image size, only checks that do not depend on it.
    fn check(&self, path: &Path, line: usize) -> Result<()> {
        let c = &self.camera;
        let malformed = |expected: String, found: String| DatasetError::Malformed {
            path: path.to_owned(),
            line,
            expected,
            found,
            advice: "correct the camera file".into(),
        };
        if !(self.depth_scale.is_finite() && self.depth_scale > 0.0) {
            return Err(malformed(
                "a depth_scale above 0 values per metre".into(),
                self.depth_scale.to_string(),
            ));
        }
        if (c.width == 0) != (c.height == 0) {
            return Err(malformed(
                "both width and height, or neither".into(),
                format!("{} x {}", c.width, c.height),
            ));
        }
        // Whether a lens is invertible depends on the image size, so it is checked once that is known.
        let checked = if c.width > 0 {
            c.check()
        } else {
            let (width, height) = (1, 1);
            Camera {
                width,
                height,
                ..*c
            }
            .check_figures()
        };
        checked.map_err(|e| malformed(e.expected(), e.found()))
    }

    /// Checks the lens with the size of a data set's images.
    ///
    /// # Errors
    /// [`DatasetError::Camera`].
    pub(crate) fn check_lens(&self, dataset: &Path) -> Result<()> {
        self.camera.check().map_err(|reason| DatasetError::Camera {
            path: dataset.to_owned(),
            name: self.name.clone(),
            reason,
        })
    }
}

/// The five coefficients of a lens; zeros if none are given.
fn coefficients(given: Option<&[f64]>, text: &str, path: &Path) -> Result<[f64; 5]> {
    let given = given.unwrap_or(&[0.0; 5]);
    <[f64; 5]>::try_from(given).map_err(|_| {
        let advice = match given.len() {
            4 => "add k3, which is 0 where the calibration has none",
            6.. => {
                "calibrate with this model, since others have coefficients that cannot be left out"
            }
            _ => "correct the camera file",
        };
        let is_key = |l: &str| l.trim_start().starts_with("distortion");
        DatasetError::Malformed {
            path: path.to_owned(),
            line: text.lines().position(is_key).map_or(1, |i| i + 1),
            expected: "distortion = [k1, k2, p1, p2, k3], five coefficients".into(),
            found: format!("{} values", given.len()),
            advice: advice.into(),
        }
    })
}

fn choices() -> String {
    CameraModel::preset_names().collect::<Vec<_>>().join(", ")
}

fn unknown(path: &Path) -> DatasetError {
    DatasetError::UnknownCamera {
        path: path.to_owned(),
        found: "neither a preset nor a file of this name".into(),
        choices: choices(),
    }
}

/// Error: the camera of a data set folder is unknown.
pub(crate) fn unknown_for_folder(path: &Path) -> DatasetError {
    DatasetError::UnknownCamera {
        path: path.to_owned(),
        found:
            "no camera.toml or camera.txt in the folder and no fr1, fr2, fr3 or bonn in its name"
                .into(),
        choices: choices(),
    }
}

#[cfg(test)]
mod tests;
