//! Odometry of data sets: `odometry.csv`, and the `[odometry]` table of a camera file, described in the crate's documentation.

use crate::error::Result;
use crate::lists::{Line, parse_numbers};
use crate::samples::{self, TableError};
use crate::units::Unit;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use stillpoint_geometry::OdometryModel;
use stillpoint_imaging::OdometrySample;

/// File name in a data set folder.
pub(crate) const FILE: &str = "odometry.csv";
const HEADER: &str = "# timestamp (s), place x, y, z (m), orientation x, y, z, w, sigma of place (m), of direction (rad)\n";
const EXPECTED: &str = "8 numbers: timestamp, place x y z (m), orientation x y z w; or 10, with standard deviations of place (m) and direction (rad)";
/// Required contents of a table, for messages.
const MOUNT: &str = "base_from_camera: rotation = [x, y, z, w], which turns the camera's axes to the base's, and translation = [x, y, z], the camera on the base in m";

/// The `[odometry]` table of a camera file. The camera's pose on the base is required; the default noise is that of an indoor robot.
#[derive(Debug, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct OdometryTable {
    /// Rotation from the camera's axes to the base's, quaternion `[x, y, z, w]`.
    rotation: Option<[f64; 4]>,
    /// Position of the camera in the base's axes, m.
    translation: Option<[f64; 3]>,
    time_offset: Option<f64>,
    slip_per_metre: Option<f64>,
    slip_per_radian: Option<f64>,
    turn_per_metre: Option<f64>,
}

impl OdometryTable {
    /// The odometry model, or expectation and finding.
    pub(crate) fn model(&self) -> std::result::Result<OdometryModel, TableError> {
        let missing = |what: &str| (format!("[odometry] with {MOUNT}"), format!("no {what}"));
        let rotation = self.rotation.ok_or_else(|| missing("rotation"))?;
        let place = self.translation.ok_or_else(|| missing("translation"))?;
        let usual = OdometryModel::mounted(samples::mount("odometry", rotation, place)?);
        let model = OdometryModel {
            base_from_camera: usual.base_from_camera,
            time_offset: self.time_offset.unwrap_or(usual.time_offset),
            slip_per_metre: self.slip_per_metre.unwrap_or(usual.slip_per_metre),
            slip_per_radian: self.slip_per_radian.unwrap_or(usual.slip_per_radian),
            turn_per_metre: self.turn_per_metre.unwrap_or(usual.turn_per_metre),
        };
        model.check().map_err(|e| samples::figure("odometry", &e))?;
        Ok(model)
    }
}

pub(crate) fn to_toml(m: &OdometryModel) -> String {
    format!(
        "\n[odometry] # rotation and translation (m) bring the camera's coordinates to those of the base\n{}slip_per_metre = {:?} # m/m\nslip_per_radian = {:?} # rad/rad\nturn_per_metre = {:?} # rad/m\n",
        samples::mount_to_toml(&m.base_from_camera, m.time_offset, FILE),
        m.slip_per_metre,
        m.slip_per_radian,
        m.turn_per_metre,
    )
}

/// The samples of a folder in time order; `None` without the file. Without the camera's pose on the base they are ignored, with a warning.
pub(crate) fn read(
    folder: &Path,
    model: Option<&OdometryModel>,
    warnings: &mut Vec<String>,
) -> Result<Arc<[OdometrySample]>> {
    let unknown = format!(
        "the camera file does not say how the camera stands on the base; add a table [odometry] with {MOUNT}"
    );
    let unknown = model.is_none().then_some(unknown.as_str());
    samples::read(&folder.join(FILE), unknown, warnings, sample)
}

fn sample(line: &Line<'_>, path: &Path, unit: Unit) -> Result<OdometrySample> {
    let mut sigmas = None;
    let stand = match line.columns().count() {
        10 => {
            let all = parse_numbers::<10>(line, path, EXPECTED)?;
            let [stand @ .., place, turn] = all;
            sigmas = Some([place, turn]);
            stand
        }
        _ => parse_numbers::<8>(line, path, EXPECTED)?,
    };
    let [stamp, x, y, z, i, j, k, w] = stand;
    let sample = OdometrySample {
        stamp: stamp / unit.per_second(),
        position: [x, y, z],
        orientation: [i, j, k, w],
        sigmas,
    };
    let length = sample.length();
    if !sample.is_pose() {
        let found = format!("one of length {length}");
        return Err(line.malformed(path, "an orientation x y z w of length 1", found));
    }
    if sigmas.is_some_and(|s| s.iter().any(|v| *v < 0.0)) {
        let expected = "standard deviations of 0 or more";
        return Err(line.malformed(path, expected, line.text.to_owned()));
    }
    Ok(sample)
}

pub(crate) fn to_text(samples: &[OdometrySample]) -> String {
    let mut text = HEADER.to_owned();
    for s in samples {
        let ([x, y, z], [i, j, k, w]) = (s.position, s.orientation);
        // Microseconds for the stamp, as for images; micrometres are finer than any encoder.
        let _ = write!(
            text,
            "{:.6},{x:.6},{y:.6},{z:.6},{i:.9},{j:.9},{k:.9},{w:.9}",
            s.stamp
        );
        if let Some([place, turn]) = s.sigmas {
            let _ = write!(text, ",{place:.6},{turn:.6}");
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use proptest::prelude::*;
    use stillpoint_geometry::{Se3, Vec3, so3};

    const LENS: &str = "fx = 500.0\nfy = 500.0\ncx = 320.0\ncy = 240.0\ndepth_scale = 5000.0\n";

    fn camera(table: &str) -> Result<CameraModel> {
        CameraModel::parse_toml(&format!("{LENS}{table}"), Path::new("camera.toml"))
    }

    fn parse(text: &str) -> Result<Arc<[OdometrySample]>> {
        samples::parse(text, Path::new("odometry.csv"), sample)
    }

    #[test]
    fn odometry_table_requires_the_camera_mount() {
        assert_eq!(camera("").unwrap().odometry, None);
        let table = "[odometry]\nrotation = [0.0, 0.0, 0.0, 1.0]\ntranslation = [0.1, 0.0, 0.5]\n";
        let model = camera(table).unwrap().odometry.unwrap();
        let mount = Se3::new(so3::exp(&Vec3::zeros()), Vec3::new(0.1, 0.0, 0.5));
        assert_eq!(model, OdometryModel::mounted(mount));
        let noisy = camera(&format!("{table}slip_per_metre = 0.1\n"));
        assert_eq!(noisy.unwrap().odometry.unwrap().slip_per_metre, 0.1);
        let refused = |table: &str| camera(table).unwrap_err().to_string();
        let e = refused("[odometry]\ntranslation = [0.1, 0.0, 0.5]\n");
        assert!(
            e.contains("base_from_camera") && e.contains("no rotation"),
            "{e}"
        );
        let e = refused("[odometry]\nrotation = [0.0, 0.0, 0.0, 1.0]\n");
        assert!(
            e.contains("camera.toml:6:") && e.contains("no translation"),
            "{e}"
        );
        let e = refused(&table.replace("1.0", "2.0"));
        assert!(e.contains("length 1") && e.contains("length 2"), "{e}");
        assert!(refused(&format!("{table}slip = 1.0\n")).contains("slip"));
        let e = refused(&format!("{table}time_offset = 9.0\n"));
        assert!(e.contains("time_offset within 1 s"), "{e}");
    }

    #[test]
    fn malformed_odometry_lines_report_the_reason() {
        for (text, part) in [
            ("1 0 0 0 0 0 0\n", "odometry.csv:1:"),
            ("# c\n1,0,0,0,0,0,0,1\n1,0,0,0,0,0,0,1\n", "repeats"),
            ("2,0,0,0,0,0,0,1\n1,0,0,0,0,0,0,1\n", "goes back"),
            ("2,0,nan,0,0,0,0,1\n", "finite"),
            ("2,0,0,0,0,0,0,1,0.1\n", "9 columns"),
            ("2,0,0,0,0,0,0,0\n", "length 0"),
            ("2,0,0,0,0,0,0,1,-0.1,0.1\n", "0 or more"),
        ] {
            let e = parse(text).unwrap_err().to_string();
            assert!(e.contains(part) && e.contains("odometry.csv:"), "{e}");
        }
        let read = parse("1,0,0,0,0,0,0,1\n2,1,0,0,0,0,0,1,0.1,0.2\n").unwrap();
        assert_eq!((read[0].sigmas, read[1].sigmas), (None, Some([0.1, 0.2])));
    }

    proptest! {
        #[test]
        fn odometry_samples_and_model_round_trip(values in proptest::collection::vec(proptest::array::uniform6(-3.0..3.0f64), 0..20), known in any::<bool>()) {
            let samples: Vec<OdometrySample> = values.iter().enumerate().map(|(k, v)| {
                let turn = so3::exp(&Vec3::new(v[3], v[4], v[5]));
                OdometrySample {
                    stamp: 0.02 * k as f64,
                    position: [v[0], v[1], v[2]],
                    orientation: [turn.i, turn.j, turn.k, turn.w],
                    sigmas: known.then_some([v[0].abs(), v[1].abs()]),
                }
            }).collect();
            let back = parse(&to_text(&samples)).unwrap();
            prop_assert_eq!(back.len(), samples.len());
            for (a, b) in back.iter().zip(&samples) {
                prop_assert!((a.stamp - b.stamp).abs() < 1e-6 && a.sigmas.is_some() == known);
                for k in 0..3 {
                    prop_assert!((a.position[k] - b.position[k]).abs() < 1e-6);
                    prop_assert!((a.orientation[k] - b.orientation[k]).abs() < 1e-9);
                }
            }
            let mount = Se3::new(so3::exp(&Vec3::new(0.1, -0.7, 0.3)), Vec3::new(0.2, 0.0, 0.4));
            let model = OdometryModel { time_offset: 0.01, ..OdometryModel::mounted(mount) };
            let with = CameraModel { odometry: Some(model), ..camera("").unwrap() };
            let read = CameraModel::parse_toml(&with.to_toml(), Path::new("c.toml")).unwrap().odometry.unwrap();
            prop_assert!(read.base_from_camera.rotation.angle_to(&mount.rotation) < 1e-7);
            prop_assert_eq!(read.time_offset, 0.01);
        }

        #[test]
        fn random_text_never_panics(text in "\\PC{0,80}(\n\\PC{0,80}){0,3}") {
            let _ = parse(&text);
        }
    }
}
