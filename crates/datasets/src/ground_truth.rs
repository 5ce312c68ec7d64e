//! Ground truth in this project's conventions: `world_from_camera` of the colour camera, x right, y down, z forward.

use crate::error::{DatasetError, Result};
use crate::index::{NUMBERED_RATE, seven_scenes_number};
use crate::layout::{Layout, icl_ground_truth, names_in};
use crate::lists::{data_lines, parse_numbers, read_text};
use crate::trajectory::{self, StampedPose};
use std::path::{Path, PathBuf};
use stillpoint_geometry::nalgebra::Matrix4;
use stillpoint_geometry::{Mat3, Se3, Vec3};

/// The ground truth file of a folder; for 7-Scenes, which has a file per frame, the folder itself.
pub(crate) fn find(folder: &Path, layout: Layout) -> Result<Option<PathBuf>> {
    let names = names_in(folder)?;
    Ok(match layout {
        Layout::SevenScenes => names
            .iter()
            .any(|n| n.ends_with(".pose.txt"))
            .then(|| folder.to_owned()),
        Layout::IclNuim => icl_ground_truth(&names)
            .map(str::to_owned)
            .or_else(|| Some("groundtruth.txt".to_owned()))
            .map(|n| folder.join(n))
            .filter(|p| p.is_file()),
        Layout::Tum | Layout::Bonn | Layout::Numbered => {
            Some(folder.join("groundtruth.txt")).filter(|p| p.is_file())
        }
    })
}

/// Ground truth with remarks about its file.
type Said = (Vec<StampedPose>, Vec<String>);

/// Reads the ground truth of a folder, in time order.
pub(crate) fn read(folder: &Path, layout: Layout) -> Result<Option<Said>> {
    let Some(path) = find(folder, layout)? else {
        return Ok(None);
    };
    let (mut poses, said) = match layout {
        Layout::SevenScenes => return Ok(Some((read_seven_scenes(folder)?, Vec::new()))),
        _ => trajectory::read_said(&path)?,
    };
    match layout {
        Layout::Bonn => {
            for p in &mut poses {
                p.world_from_camera = bonn_camera_from_marker_pose(&p.world_from_camera);
            }
        }
        Layout::IclNuim => {
            // Frame numbers, as in the data set, unless the file was converted to seconds.
            let numbered = poses.iter().all(|p| p.stamp.fract() == 0.0);
            let rate = if numbered { NUMBERED_RATE } else { 1.0 };
            for p in &mut poses {
                p.stamp /= rate;
                p.world_from_camera = mirror_y(&p.world_from_camera);
            }
        }
        Layout::Tum | Layout::Numbered | Layout::SevenScenes => {}
    }
    Ok(Some((poses, said)))
}

/// The rotation nearest to a 3x3 matrix that is a rotation up to scale; `None` for others.
fn nearest_rotation(m: &Mat3) -> Option<Mat3> {
    let svd = m.svd(true, true);
    let (u, v_t) = (svd.u?, svd.v_t?);
    let s = svd.singular_values;
    let r = u * v_t;
    (r.determinant() > 0.0 && s.min() > 0.5 * s.max() && s.iter().all(|x| x.is_finite()))
        .then_some(r)
}

/// Converts a marker pose of the Bonn data set: `T = T_ros T_gt T_ros T_m` (the script published with the data set). `T_m` has a uniform
/// scale of 1.0593, which a rigid pose cannot represent: only its rotation is used.
fn bonn_camera_from_marker_pose(gt: &Se3) -> Se3 {
    let ros = Matrix4::new(
        -1.0, 0.0, 0.0, 0.0, //
        0.0, 0.0, 1.0, 0.0, //
        0.0, 1.0, 0.0, 0.0, //
        0.0, 0.0, 0.0, 1.0,
    );
    let marker = Matrix4::new(
        1.0157, 0.1828, -0.2389, 0.0113, //
        0.0009, -0.8431, -0.6413, -0.0098, //
        -0.3009, 0.6147, -0.8085, 0.0111, //
        0.0, 0.0, 0.0, 1.0,
    );
    let t = ros * gt.to_matrix() * ros * marker;
    let linear: Mat3 = t.fixed_view::<3, 3>(0, 0).into();
    // All factors are rotations up to scale; a test checks this.
    let rotation = nearest_rotation(&linear).unwrap_or_else(Mat3::identity);
    Se3::from_matrix(&rotation, Vec3::new(t[(0, 3)], t[(1, 3)], t[(2, 3)]))
}

/// `S T S` with `S = diag(1, -1, 1, 1)`: from ICL-NUIM's left-handed camera (fy < 0) to fy > 0.
fn mirror_y(pose: &Se3) -> Se3 {
    let q = pose.rotation;
    let t = pose.translation;
    // Conjugation by a reflection of y keeps w and the y component, and negates the other two.
    Se3::new(
        stillpoint_geometry::nalgebra::UnitQuaternion::new_normalize(
            stillpoint_geometry::nalgebra::Quaternion::new(q.w, -q.i, q.j, -q.k),
        ),
        Vec3::new(t.x, -t.y, t.z),
    )
}

/// One 4x4 `world_from_camera` per `frame-NNNNNN.pose.txt`. Frames with a non-finite matrix, which marks lost tracking, are left out.
fn read_seven_scenes(folder: &Path) -> Result<Vec<StampedPose>> {
    let mut numbered: Vec<(u32, PathBuf)> = names_in(folder)?
        .iter()
        .filter_map(|n| Some((seven_scenes_number(n, ".pose.txt")?, folder.join(n))))
        .collect();
    numbered.sort();
    let mut poses = Vec::new();
    for (number, path) in numbered {
        if let Some(world_from_camera) = parse_matrix(&read_text(&path)?, &path)? {
            poses.push(StampedPose {
                stamp: f64::from(number) / NUMBERED_RATE,
                world_from_camera,
            });
        }
    }
    Ok(poses)
}

/// A 4x4 pose matrix, row by row; `None` for the mark of a missing pose.
fn parse_matrix(text: &str, path: &Path) -> Result<Option<Se3>> {
    const EXPECTED: &str = "4 rows of 4 numbers: a world_from_camera matrix";
    let malformed = |line: usize, found: String| DatasetError::Malformed {
        path: path.to_owned(),
        line,
        expected: EXPECTED.into(),
        found,
        advice: "export the pose again, or remove the file".into(),
    };
    let lines: Vec<_> = data_lines(text).collect();
    if lines.len() != 4 {
        return Err(malformed(1, format!("{} rows", lines.len())));
    }
    let lost = |w: &str| w.parse::<f64>().is_ok_and(|x| !x.is_finite());
    if lines.iter().any(|l| l.columns().any(lost)) {
        return Ok(None);
    }
    let mut m = Matrix4::zeros();
    for (r, line) in lines.iter().enumerate() {
        let row = parse_numbers::<4>(line, path, EXPECTED)?;
        for (c, v) in row.into_iter().enumerate() {
            m[(r, c)] = v;
        }
    }
    let linear: Mat3 = m.fixed_view::<3, 3>(0, 0).into();
    let scale = linear.determinant();
    match nearest_rotation(&linear) {
        Some(r) if (scale - 1.0).abs() < 0.05 => Ok(Some(Se3::from_matrix(
            &r,
            Vec3::new(m[(0, 3)], m[(1, 3)], m[(2, 3)]),
        ))),
        _ => Err(malformed(
            1,
            format!("a matrix of determinant {scale:.3}, which is no rotation"),
        )),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::so3;

    fn pose() -> Se3 {
        Se3::new(
            so3::exp(&Vec3::new(0.3, -0.7, 0.2)),
            Vec3::new(1.0, 2.0, 3.0),
        )
    }

    #[test]
    fn mirrored_pose_equals_the_matrix_product() {
        let s = Matrix4::from_diagonal(&[1.0, -1.0, 1.0, 1.0].into());
        let expected = s * pose().to_matrix() * s;
        assert!((mirror_y(&pose()).to_matrix() - expected).norm() < 1e-14);
    }

    #[test]
    fn bonn_pose_is_rigid_and_moves_with_the_marker() {
        let (a, b) = (pose(), Se3::new(pose().rotation, Vec3::new(1.0, 2.5, 3.0)));
        let (ca, cb) = (
            bonn_camera_from_marker_pose(&a),
            bonn_camera_from_marker_pose(&b),
        );
        // T_ros maps (0, 0.5, 0) to (0, 0, 0.5); the rotation is the same.
        assert!((cb.translation - ca.translation - Vec3::new(0.0, 0.0, 0.5)).norm() < 1e-12);
        assert!((ca.inverse() * cb).rotation.angle() < 1e-7);
        let r = ca.rotation_matrix();
        assert!((r * r.transpose() - Mat3::identity()).norm() < 1e-12);
        // The marker's matrix is a rotation up to its scale of 1.0593, to the published precision.
        let at_identity = bonn_camera_from_marker_pose(&Se3::identity()).rotation_matrix() * 1.0593;
        assert!((at_identity[(0, 0)] - 1.0157).abs() < 2e-3);
        assert!((at_identity[(2, 1)] - 0.6147).abs() < 2e-3);
    }

    #[test]
    fn pose_matrices_are_validated() {
        let p = Path::new("frame-000000.pose.txt");
        let good = "1 0 0 5\n0 1 0 6\n0 0 1 7\n0 0 0 1\n";
        let pose = parse_matrix(good, p).unwrap().unwrap();
        assert_eq!(pose.translation, Vec3::new(5.0, 6.0, 7.0));
        let lost = good.replace('5', "-1.#INF").replace("-1.#INF", "inf");
        assert_eq!(parse_matrix(&lost, p).unwrap(), None);
        for (text, part) in [
            ("1 0 0 0\n", "1 rows"),
            ("1 0 0 0\n0 1 0\n0 0 1 0\n0 0 0 1\n", ":2:"),
            ("1 0 0 0\n0 1 x 0\n0 0 1 0\n0 0 0 1\n", "\"x\""),
            ("2 0 0 0\n0 2 0 0\n0 0 2 0\n0 0 0 1\n", "no rotation"),
            ("1 0 0 0\n0 -1 0 0\n0 0 1 0\n0 0 0 1\n", "no rotation"),
        ] {
            let e = parse_matrix(text, p).unwrap_err().to_string();
            assert!(e.contains(part), "{e}");
        }
    }
}
