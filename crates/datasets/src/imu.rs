//! Inertial sensors of data sets: `imu.csv`, and the `[imu]` table of a camera file, described in the crate's documentation. The TUM data
//! sets' `accelerometer.txt` is not read, since it has no angular rates.

use crate::error::Result;
use crate::lists::{Line, parse_numbers};
use crate::samples::{self, TableError};
use crate::units::Unit;
use std::fmt::Write;
use std::path::Path;
use std::sync::Arc;
use stillpoint_geometry::ImuModel;
use stillpoint_imaging::ImuSample;

/// File name in a data set folder.
pub(crate) const FILE: &str = "imu.csv";
const HEADER: &str =
    "# timestamp (s), angular rate x, y, z (rad/s), specific force x, y, z (m/s^2)\n";
const EXPECTED: &str =
    "7 numbers: timestamp, angular rate x y z (rad/s), specific force x y z (m/s^2)";

/// The `[imu]` table of a camera file. Defaults are those of a BMI055 at the camera's own position and axes.
#[derive(Debug, Default, serde::Deserialize)]
#[serde(deny_unknown_fields)]
pub(crate) struct ImuTable {
    /// Rotation from the sensor's axes to the camera's, quaternion `[x, y, z, w]`.
    rotation: Option<[f64; 4]>,
    /// Position of the sensor in the camera's axes, m.
    translation: Option<[f64; 3]>,
    time_offset: Option<f64>,
    gyro_noise: Option<f64>,
    gyro_bias: Option<f64>,
    gyro_walk: Option<f64>,
    accel_noise: Option<f64>,
    accel_bias: Option<f64>,
    accel_walk: Option<f64>,
}

impl ImuTable {
    /// The sensor model, or expectation and finding.
    pub(crate) fn model(&self) -> std::result::Result<ImuModel, TableError> {
        let usual = ImuModel::bmi055();
        let rotation = self.rotation.unwrap_or([0.0, 0.0, 0.0, 1.0]);
        let place = self.translation.unwrap_or_default();
        let model = ImuModel {
            camera_from_imu: samples::mount("imu", rotation, place)?,
            time_offset: self.time_offset.unwrap_or(usual.time_offset),
            gyro_noise: self.gyro_noise.unwrap_or(usual.gyro_noise),
            gyro_bias: self.gyro_bias.unwrap_or(usual.gyro_bias),
            gyro_walk: self.gyro_walk.unwrap_or(usual.gyro_walk),
            accel_noise: self.accel_noise.unwrap_or(usual.accel_noise),
            accel_bias: self.accel_bias.unwrap_or(usual.accel_bias),
            accel_walk: self.accel_walk.unwrap_or(usual.accel_walk),
        };
        model.check().map_err(|e| samples::figure("imu", &e))?;
        Ok(model)
    }
}

pub(crate) fn to_toml(m: &ImuModel) -> String {
    format!(
        "\n[imu] # rotation and translation (m) bring the sensor's coordinates to those of the camera; noise in SI units\n{}gyro_noise = {:?}\ngyro_bias = {:?}\ngyro_walk = {:?}\naccel_noise = {:?}\naccel_bias = {:?}\naccel_walk = {:?}\n",
        samples::mount_to_toml(&m.camera_from_imu, m.time_offset, FILE),
        m.gyro_noise,
        m.gyro_bias,
        m.gyro_walk,
        m.accel_noise,
        m.accel_bias,
        m.accel_walk,
    )
}

/// The samples of a folder in time order; `None` without the file. Without a known mounting they are ignored, with a warning.
pub(crate) fn read(
    folder: &Path,
    model: Option<&ImuModel>,
    warnings: &mut Vec<String>,
) -> Result<Arc<[ImuSample]>> {
    let unknown = "the camera file says nothing of the sensor; add a table [imu] with rotation = [x, y, z, w] to it";
    let unknown = model.is_none().then_some(unknown);
    samples::read(&folder.join(FILE), unknown, warnings, sample)
}

fn sample(line: &Line<'_>, path: &Path, unit: Unit) -> Result<ImuSample> {
    let [stamp, x, y, z, u, v, w] = parse_numbers::<7>(line, path, EXPECTED)?;
    Ok(ImuSample {
        stamp: stamp / unit.per_second(),
        angular_rate: [x, y, z],
        specific_force: [u, v, w],
    })
}

pub(crate) fn to_text(samples: &[ImuSample]) -> String {
    let mut text = HEADER.to_owned();
    for s in samples {
        let ([x, y, z], [u, v, w]) = (s.angular_rate, s.specific_force);
        // Microseconds for the stamp, as for images; nine digits exceed any sensor's precision.
        let _ = writeln!(
            text,
            "{:.6},{x:.9},{y:.9},{z:.9},{u:.9},{v:.9},{w:.9}",
            s.stamp
        );
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::camera::CameraModel;
    use proptest::prelude::*;
    use stillpoint_geometry::Vec3;

    const LENS: &str = "fx = 500.0\nfy = 500.0\ncx = 320.0\ncy = 240.0\ndepth_scale = 5000.0\n";

    fn parse(text: &str, path: &Path) -> Result<Arc<[ImuSample]>> {
        samples::parse(text, path, sample)
    }

    fn camera(table: &str) -> Result<CameraModel> {
        CameraModel::parse_toml(&format!("{LENS}{table}"), Path::new("camera.toml"))
    }

    #[test]
    fn missing_imu_settings_default_to_a_bmi055() {
        assert_eq!(camera("").unwrap().imu, None);
        assert_eq!(camera("[imu]\n").unwrap().imu, Some(ImuModel::bmi055()));
        let half = 0.5_f64.sqrt();
        let turned = camera(&format!(
            "[imu]\nrotation = [0.0, 0.0, {half}, {half}]\ntranslation = [0.01, 0.0, -0.02]\ngyro_noise = 0.001\n"
        ));
        let model = turned.unwrap().imu.unwrap();
        let x = model.camera_from_imu.transform(&Vec3::x());
        assert!((x - Vec3::new(0.01, 1.0, -0.02)).norm() < 1e-12);
        assert_eq!(model.gyro_noise, 0.001);
    }

    #[test]
    fn invalid_imu_tables_and_files_report_the_reason() {
        let refused = |table: &str| camera(table).unwrap_err().to_string();
        let e = refused("[imu]\nrotation = [0.0, 0.0, 0.0, 2.0]\n");
        assert!(
            e.contains("a quaternion of length 1") && e.contains("length 2"),
            "{e}"
        );
        assert!(refused("[imu]\ngyro_noise = -1.0\n").contains("gyro_noise above 0"));
        assert!(refused("[imu]\ngyro = 1.0\n").contains("gyro"));
        for (text, part) in [
            ("1 0 0 0 0 0\n", "imu.csv:1:"),
            ("# c\n1,0,0,0,0,0,9.8\n1,0,0,0,0,0,9.8\n", "repeats"),
            ("2,0,0,0,0,0,9.8\n1,0,0,0,0,0,9.8\n", "goes back"),
            ("2,0,0,nan,0,0,9.8\n", "finite"),
            ("2,0,0,0,0,0,9.8,1\n", "8 columns"),
        ] {
            let e = parse(text, Path::new("imu.csv")).unwrap_err().to_string();
            assert!(e.contains(part) && e.contains("imu.csv:"), "{e}");
        }
    }

    #[test]
    fn nanosecond_stamps_become_seconds() {
        let text: String = (0..9_u64)
            .map(|i| {
                format!(
                    "{},0,0,0,0,0,9.8\n",
                    1_305_031_102_000_000_000 + i * 5_000_000
                )
            })
            .collect();
        let read = parse(&text, Path::new("imu.csv")).unwrap();
        assert!(
            (read[8].stamp - 1_305_031_102.04).abs() < 1e-6,
            "{}",
            read[8].stamp
        );
    }

    proptest! {
        #[test]
        fn imu_samples_and_model_round_trip(values in proptest::collection::vec(proptest::array::uniform6(-50.0..50.0f64), 0..20), x in -0.5..0.5f64, y in -0.5..0.5f64) {
            let samples: Vec<ImuSample> = values.iter().enumerate().map(|(k, v)| ImuSample {
                stamp: 0.005 * k as f64,
                angular_rate: [v[0], v[1], v[2]],
                specific_force: [v[3], v[4], v[5]],
            }).collect();
            let back = parse(&to_text(&samples), Path::new("imu.csv")).unwrap();
            prop_assert_eq!(back.len(), samples.len());
            for (a, b) in back.iter().zip(&samples) {
                prop_assert!((a.stamp - b.stamp).abs() < 1e-6);
                for k in 0..3 {
                    prop_assert!((a.angular_rate[k] - b.angular_rate[k]).abs() < 1e-9);
                    prop_assert!((a.specific_force[k] - b.specific_force[k]).abs() < 1e-9);
                }
            }
            let model = ImuModel::bmi055().turned(Vec3::new(x, y, 0.3));
            let with = CameraModel { imu: Some(model), ..camera("").unwrap() };
            let read = CameraModel::parse_toml(&with.to_toml(), Path::new("c.toml")).unwrap().imu.unwrap();
            prop_assert!(read.camera_from_imu.rotation.angle_to(&model.camera_from_imu.rotation) < 1e-7);
            prop_assert_eq!(read.gyro_bias, model.gyro_bias);
        }

        #[test]
        fn random_text_never_panics(text in "\\PC{0,80}(\n\\PC{0,80}){0,3}") {
            let _ = parse(&text, Path::new("imu.csv"));
        }
    }
}
