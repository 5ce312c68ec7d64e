//! Converts the library's camera description to calibrations.

use crate::library::{Description, Extrinsics, Intrinsics};
use stillpoint_geometry::Se3;
use stillpoint_geometry::nalgebra::{Matrix3, Rotation3, UnitQuaternion, Vector3};
use stillpoint_recordings::Pair;
use stillpoint_ros_messages::CameraInfo;

fn info((i, model): &(Intrinsics, String)) -> CameraInfo<'static> {
    let mut k = [0.0; 9];
    for (place, value) in [(0, i.fx), (2, i.ppx), (4, i.fy), (5, i.ppy), (8, 1.0)] {
        k[place] = f64::from(value);
    }
    CameraInfo {
        width: i.width.unsigned_abs(),
        height: i.height.unsigned_abs(),
        distortion_model: model.clone().into(),
        d: i.coefficients.iter().map(|c| f64::from(*c)).collect(),
        k,
        ..CameraInfo::default()
    }
}

/// The library's pose; `None` if its rotation is invalid.
pub(crate) fn pose(found: &Extrinsics) -> Option<Se3> {
    let matrix = Matrix3::from_column_slice(&found.rotation.map(f64::from));
    if !matrix.iter().all(|v| v.is_finite()) || (matrix.determinant() - 1.0).abs() > 0.01 {
        return None;
    }
    let rotation = UnitQuaternion::from_rotation_matrix(&Rotation3::from_matrix(&matrix));
    let [x, y, z] = found.translation.map(f64::from);
    Some(Se3::new(rotation, Vector3::new(x, y, z)))
}

/// Both cameras of a device, or the problem.
pub(crate) fn pair(name: &str, d: &Description) -> std::result::Result<Pair<'static>, String> {
    let colour_from_depth = pose(&d.colour_from_depth).ok_or_else(|| {
        format!(
            "a rotation between its cameras that is none: {:?}",
            d.colour_from_depth.rotation
        )
    })?;
    if !(d.unit.is_finite() && d.unit > 0.0) {
        return Err(format!("depth values of {} m", d.unit));
    }
    Ok(Pair {
        name: name.to_owned(),
        colour: info(&d.colour),
        depth: info(&d.depth),
        colour_from_depth: Some(colour_from_depth),
        depth_scale: Some((1.0 / d.unit * 1e3).round() / 1e3),
    })
}
