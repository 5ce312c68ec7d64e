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

/// A camera with what its depth images mean.
#[derive(Clone, Debug, PartialEq)]
pub struct CameraModel {
    /// Where it comes from: a preset's name, or the name given in the file, or the file.
    pub name: String,
    /// Lens and size of the images, px. A size of 0 x 0 stands for the size of the images until a data set is opened.
    pub camera: Camera,
    /// Depth image values per metre.
    pub depth_scale: f64,
    /// Whether it is made of a data sheet's field of view and not of a calibration: a device differs by some per cent.
    pub nominal: bool,
    /// The inertial sensor that is fixed to it, if it is known.
    pub imu: Option<ImuModel>,
    /// The odometry of the base that carries it, if it is known how it stands on that.
    pub odometry: Option<OdometryModel>,
}

/// What the user asked for: the name of a preset, or a camera file.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum CameraChoice {
    /// A preset by its name, see [`CameraModel::preset_names`].
    Preset(String),
    /// A camera file, TOML or text.
    File(PathBuf),
}

impl CameraChoice {
    /// Takes the text for a preset's name if there is such a preset, else for a file.
    #[must_use]
    pub fn from_argument(text: &str) -> Self {
        if preset_text(text).is_some() {
            Self::Preset(text.to_owned())
        } else {
            Self::File(PathBuf::from(text))
        }
    }
}

/// The keys of a camera file.
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

    /// Reads a camera file: TOML when it is named so, else text.
    ///
    /// # Errors
    /// [`DatasetError::UnknownCamera`] when there is no such file, [`DatasetError::Read`], [`DatasetError::Malformed`].
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

    /// The camera that a user chose.
    ///
    /// # Errors
    /// As [`CameraModel::preset`] and [`CameraModel::from_file`].
    pub fn choose(choice: &CameraChoice) -> Result<Self> {
        match choice {
            CameraChoice::Preset(name) => Self::preset(name),
            CameraChoice::File(path) => Self::from_file(path),
        }
    }

    /// Parses a camera in TOML; `path` is named in errors.
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

    /// Parses `fx fy cx cy depth_scale`; `path` is named in errors.
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

    /// The text of a camera file that reads back as this camera.
    #[must_use]
    pub fn to_toml(&self) -> String {
        let c = &self.camera;
        let d = &c.distortion;
        // The name is quoted as a TOML basic string; other escapes than these two cannot occur after the filter.
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

    /// Figures that no camera has are mistakes in the file. Of a camera without a size, what does not depend on it.
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
        // Whether a lens can be inverted depends on where the image ends: that is asked when the size is known.
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

    /// Checks the camera once a data set has told the size of its images.
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

/// The five coefficients of a lens; none stand for zeros.
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

/// The error of a data set folder that says nothing about its camera.
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
mod tests {
    use super::*;
    use proptest::prelude::*;

    #[test]
    fn presets_read_and_hold_the_published_figures() {
        for name in CameraModel::preset_names() {
            let m = CameraModel::preset(name).unwrap();
            assert_eq!(m.name, name);
            let size = (m.camera.width, m.camera.height);
            assert!(
                size == (640, 480) || (size == (1280, 720) && m.nominal),
                "{name}"
            );
        }
        let fr1 = CameraModel::preset("freiburg1").unwrap();
        assert_eq!(fr1.camera.distortion.k3, 1.163314);
        assert_eq!(CameraModel::preset("fr2").unwrap().depth_scale, 5208.0);
        assert_eq!(
            CameraModel::preset("seven_scenes").unwrap().depth_scale,
            1000.0
        );
        assert_eq!(
            CameraModel::preset("bonn_calibrated").unwrap().depth_scale,
            4720.0
        );
        assert!(!fr1.nominal);
        // By its field of view; the device of a recording has 613.2 px.
        let d435 = CameraModel::preset("d435").unwrap();
        assert!(d435.nominal && (d435.camera.fx / 613.2 - 1.0).abs() < 0.03);
    }

    #[test]
    fn unknown_presets_list_the_choices() {
        let e = CameraModel::choose(&CameraChoice::from_argument("fr9"))
            .unwrap_err()
            .to_string();
        assert!(
            e.contains("fr9") && e.contains("tum_fr1, tum_fr2") && e.contains("seven_scenes"),
            "{e}"
        );
    }

    #[test]
    fn broken_camera_files_name_line_and_reason() {
        let toml = |t: &str| {
            CameraModel::parse_toml(t, Path::new("camera.toml"))
                .unwrap_err()
                .to_string()
        };
        let text = |t: &str| {
            CameraModel::parse_text(t, Path::new("camera.txt"))
                .unwrap_err()
                .to_string()
        };
        let good = "fx = 500.0\nfy = 500.0\ncx = 320.0\ncy = 240.0\ndepth_scale = 5000.0\n";
        assert!(toml(&format!("{good}fz = 1.0\n")).contains("camera.toml:6:"));
        assert!(toml("fx = 500.0\n").contains("fy"));
        assert!(toml(&good.replace("5000.0", "0.0")).contains("depth_scale above 0"));
        assert!(toml(&good.replacen("500.0", "-1.0", 1)).contains("focal lengths"));
        assert!(toml(&format!("width = 640\n{good}")).contains("both width and height"));
        // Freiburg 1 without k3, with values behind it, and with a power too many.
        let lens =
            |values: &str| format!("width = 640\nheight = 480\n{good}distortion = {values}\n");
        let folded = toml(&lens("[0.2624, -0.9531, -0.0054, 0.0026, 0.0]"));
        assert!(folded.contains("k3 is 0: was it left out?"), "{folded}");
        for (values, part) in [
            ("[0.26, -0.95, 0.0, 0.0]", "4 values; add k3"),
            ("[0.26, -0.95, 0.0, 0.0, 1.16, 0.1]", "6 values; calibrate"),
            ("[0.26, -0.95, 0.0, 0.0, 1.16, 0.0, 0.0]", "7 values"),
            ("[]", "0 values"),
            ("[1e100, 0.0, 0.0, 0.0, 0.0]", "k1 = 1e100"),
            ("[inf, 0.0, 0.0, 0.0, 0.0]", "finite distortion"),
        ] {
            let e = toml(&lens(values));
            assert!(e.contains(part), "{e}");
        }
        assert!(toml(&lens("[1.0]")).contains("camera.toml:8:"));
        assert!(text("# only a comment\n").contains("no such line"));
        assert!(text("# c\n500 500 320 240\n").contains("camera.txt:2:"));
        assert!(text("500 500 320 240 5000\n1 2 3 4 5\n").contains("a second line"));
        assert!(text("500 500 320 240 -5\n").contains("depth_scale"));
        let ok = CameraModel::parse_text("# c\n585 585 320 240 5000\n", Path::new("camera.txt"))
            .unwrap();
        assert_eq!((ok.camera.fx, ok.depth_scale), (585.0, 5000.0));
    }

    proptest! {
        #[test]
        fn to_toml_reads_back(f in 1.0..2000.0f64, c in -10.0..1000.0f64, k in -2.0..2.0f64, s in 1.0..1e5f64, name in "\\PC{0,20}") {
            // Without a size, since not every lens can be inverted within every image.
            let m = CameraModel {
                name,
                camera: Camera { distortion: BrownConrady { k1: k, k2: -k, p1: 1e-300 * k, p2: 0.0, k3: k * k },
                    ..Camera::pinhole(0, 0, [f, f + 1.0, c, c]) },
                depth_scale: s,
                nominal: s > 5e4,
                imu: None,
                odometry: None,
            };
            let back = CameraModel::parse_toml(&m.to_toml(), Path::new("c.toml")).unwrap();
            prop_assert_eq!(back.camera, m.camera);
            prop_assert_eq!(back.depth_scale, m.depth_scale);
            prop_assert_eq!(back.nominal, m.nominal);
        }

        #[test]
        fn random_text_never_panics(text in "\\PC{0,100}", tail in proptest::collection::vec(any::<u8>(), 0..50)) {
            let text = text + &String::from_utf8_lossy(&tail);
            let _ = CameraModel::parse_toml(&text, Path::new("c"));
            let _ = CameraModel::parse_text(&text, Path::new("c"));
        }
    }
}
