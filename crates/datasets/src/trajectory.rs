//! Trajectories in the TUM format: `timestamp tx ty tz qx qy qz qw`, one pose per line, seconds and metres. EuRoC's format is read as well.

use crate::error::{DatasetError, Result, quote};
use crate::lists::{Line, data_lines, read_text};
use crate::pose_form::PoseForm;
use crate::write::write_atomic;
use std::fmt::Write;
use std::path::Path;
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{Se3, Vec3};

/// A pose of the colour camera at a time.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct StampedPose {
    /// Time, s.
    pub stamp: f64,
    /// Pose: maps camera coordinates to world coordinates, m.
    pub world_from_camera: Se3,
}

/// Reads a trajectory in the TUM format. Lines that are blank or start with `#` are skipped; columns are separated by blanks or commas;
/// quaternions are normalised. Also reads the variants that [`read_said`] recognises.
///
/// # Errors
/// [`DatasetError::Read`], [`DatasetError::Malformed`] for a line without eight finite numbers or with a zero quaternion,
/// [`DatasetError::StampOrder`] for stamps that go back or repeat. A file without poses gives an empty list.
pub fn read(path: &Path) -> Result<Vec<StampedPose>> {
    read_said(path).map(|(poses, _)| poses)
}

/// Like [`read`], with the findings about the file, one sentence each: stamps in milliseconds, microseconds or nanoseconds, EuRoC's
/// columns, quaternions with w first by the header or by their signs.
///
/// # Errors
/// As [`read`].
pub fn read_said(path: &Path) -> Result<(Vec<StampedPose>, Vec<String>)> {
    parse_said(&read_text(path)?, path)
}

/// Parses a trajectory; `path` is for messages. See [`read`].
///
/// # Errors
/// As [`read`], without [`DatasetError::Read`].
pub fn parse(text: &str, path: &Path) -> Result<Vec<StampedPose>> {
    parse_said(text, path).map(|(poses, _)| poses)
}

pub(crate) fn parse_said(text: &str, path: &Path) -> Result<(Vec<StampedPose>, Vec<String>)> {
    let mut form = PoseForm::of(text);
    let mut poses: Vec<StampedPose> = Vec::new();
    for line in data_lines(text).filter(|l| Some(l.number) != form.header) {
        let pose = parse_line(&line, path, &form)?;
        if let Some(last) = poses.last()
            && pose.stamp <= last.stamp
        {
            return Err(DatasetError::StampOrder {
                path: path.to_owned(),
                line: line.number,
                previous: last.stamp,
                found: pose.stamp,
            });
        }
        poses.push(pose);
    }
    form.judge_signs(&mut poses);
    Ok((poses, form.remarks(path)))
}

fn parse_line(line: &Line<'_>, path: &Path, form: &PoseForm) -> Result<StampedPose> {
    let [stamp, x, y, z, a, b, c, d] = form.numbers(line, path)?;
    let q = if form.w_first {
        Quaternion::new(a, b, c, d)
    } else {
        Quaternion::new(d, a, b, c)
    };
    // Below this the direction of the four numbers is noise; quaternions in files have a norm near 1.
    if !(1e-6..1e6).contains(&q.norm()) {
        return Err(DatasetError::Malformed {
            path: path.to_owned(),
            line: line.number,
            expected: "a unit quaternion qx qy qz qw".into(),
            found: quote(line.text),
            advice: "a lost frame must be left out, not written as zeros".into(),
        });
    }
    Ok(StampedPose {
        stamp: stamp / form.unit.per_second(),
        world_from_camera: Se3::new(UnitQuaternion::new_normalize(q), Vec3::new(x, y, z)),
    })
}

/// The text of a TUM trajectory: a comment line, then one line per pose, stamps with 6 decimals, other numbers with 9. The sign of each
/// quaternion is chosen so that `qw >= 0`.
#[must_use]
pub fn format(poses: &[StampedPose]) -> String {
    let mut text = String::with_capacity(40 + poses.len() * 110);
    text.push_str("# timestamp tx ty tz qx qy qz qw\n");
    for p in poses {
        let t = p.world_from_camera.translation;
        let mut q = p.world_from_camera.rotation.coords;
        if q.w < 0.0 {
            q = -q;
        }
        // Writing to a String cannot fail. Adding 0.0 turns -0.0 into 0.0.
        let _ = writeln!(
            text,
            "{:.6} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9} {:.9}",
            p.stamp,
            t.x + 0.0,
            t.y + 0.0,
            t.z + 0.0,
            q.x + 0.0,
            q.y + 0.0,
            q.z + 0.0,
            q.w + 0.0
        );
    }
    text
}

/// Writes a TUM trajectory atomically, see [`format`](fn@format) and [`write_atomic`].
///
/// # Errors
/// [`DatasetError::Write`].
pub fn write(path: &Path, poses: &[StampedPose]) -> Result<()> {
    write_atomic(path, format(poses).as_bytes())
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn check(text: &str, expected: &[&str]) {
        let e = parse(text, Path::new("dir/t.txt")).unwrap_err().to_string();
        for part in expected {
            assert!(e.contains(part), "{e:?} lacks {part:?}");
        }
    }

    #[test]
    fn comments_blanks_commas_and_crlf_are_read() {
        let text = "\u{feff}# head\r\n\r\n1.5, 1,2,3, 0,0,0,2\r\n  \n2.5\t1 2 3 0 0 0 1";
        let poses = parse(text, Path::new("t")).unwrap();
        assert_eq!(poses.len(), 2);
        assert_eq!(
            poses[0].world_from_camera,
            Se3::new(UnitQuaternion::identity(), Vec3::new(1.0, 2.0, 3.0))
        );
        assert_eq!(poses[1].stamp, 2.5);
        assert!(parse("", Path::new("t")).unwrap().is_empty());
    }

    #[test]
    fn malformed_trajectories_report_line_and_reason() {
        check(
            "# x\n1 0 0 0 0 0 0\n",
            &["dir/t.txt:2:", "8 numbers", "7 columns"],
        );
        check("1 0 0 0 0 0 0 1 9\n", &["t.txt:1:", "9 columns"]);
        check("1 0 zero 0 0 0 0 1\n", &["t.txt:1:", "\"zero\""]);
        check("1 0 nan 0 0 0 0 1\n", &["t.txt:1:", "finite", "nan"]);
        check("1 0 inf 0 0 0 0 1\n", &["finite", "inf"]);
        check("1 0 0 0 0 0 0 0\n", &["unit quaternion", "left out"]);
        check(
            "2 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n",
            &["t.txt:2:", "after 2.000000", "goes back"],
        );
        check(
            "2 0 0 0 0 0 0 1\n2 0 0 0 0 0 0 1\n",
            &["t.txt:2:", "repeats"],
        );
    }

    #[test]
    fn missing_file_is_reported() {
        let e = read(Path::new("/no/such/file.txt")).unwrap_err();
        assert!(e.to_string().contains("/no/such/file.txt"));
    }

    proptest! {
        #[test]
        fn trajectory_round_trips(
            rows in proptest::collection::vec((0.001..0.1f64, proptest::array::uniform3(-100.0..100.0f64),
                proptest::array::uniform3(-3.0..3.0f64)), 0..20)
        ) {
            let mut stamp = 1_305_031_102.0;
            let poses: Vec<StampedPose> = rows.iter().map(|(dt, t, w)| {
                stamp += dt;
                StampedPose { stamp, world_from_camera: Se3::new(
                    stillpoint_geometry::so3::exp(&Vec3::from(*w)), Vec3::from(*t)) }
            }).collect();
            let back = parse(&format(&poses), Path::new("t")).unwrap();
            prop_assert_eq!(back.len(), poses.len());
            for (a, b) in poses.iter().zip(&back) {
                prop_assert!((a.stamp - b.stamp).abs() < 6e-7);
                let d = a.world_from_camera.inverse() * b.world_from_camera;
                prop_assert!(d.log().norm() < 1e-8);
            }
        }

        #[test]
        fn random_text_never_panics(text in "\\PC{0,200}") {
            let _ = parse(&text, Path::new("t"));
        }

        #[test]
        fn mutated_trajectories_never_panic(at in 0usize..200, byte in any::<u8>()) {
            let mut bytes = b"1.0 0 0 0 0 0 0 1\n2.0 1e3 -0.5 0 0.1 0.2 0.3 0.9\n3.5 1 2 3 0 0 1 0\n".to_vec();
            let at = at % bytes.len();
            bytes[at] = byte;
            let _ = parse(&String::from_utf8_lossy(&bytes), Path::new("t"));
        }
    }
}
