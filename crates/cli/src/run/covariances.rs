//! `trajectory_covariance.txt`: covariances of the poses in `trajectory.txt`, line by line, in the format of `smfeval` (`--cov`).

use crate::run::session::Poses;
use std::fmt::Write;
use stillpoint::geometry::Mat6;

/// File header: the conventions in the notation of smfeval, then the columns.
const HEAD: &str = "#%TANGENT_CONVENTION right_perturbation
#%TANGENT_ORDER translation_rotation
# truth = pose * exp(e); lower triangle of the covariance of e, row by row: m^2, m rad, rad^2
# timestamp c11 c21 c22 c31 c32 c33 c41 c42 c43 c44 c51 c52 c53 c54 c55 c61 c62 c63 c64 c65 c66
";

/// The files by name: covariances relative to the map's origin, and within the map around each pose. Empty without covariances.
pub(crate) fn files(poses: &Poses) -> Vec<(&'static str, String)> {
    let all = &poses.covariances;
    if all.is_empty() || all.len() != poses.final_poses.len() {
        return Vec::new();
    }
    let stamps = || poses.final_poses.iter().map(|p| p.stamp);
    vec![
        (
            "trajectory_covariance.txt",
            text(stamps().zip(all.iter().map(|c| &c.from_origin))),
        ),
        (
            "trajectory_covariance_in_map.txt",
            text(stamps().zip(all.iter().map(|c| &c.in_map))),
        ),
    ]
}

fn text<'a>(lines: impl Iterator<Item = (f64, &'a Mat6)>) -> String {
    let mut text = HEAD.to_owned();
    for (stamp, covariance) in lines {
        // Writing to a String cannot fail. Stamps are formatted as in trajectory.txt.
        let _ = write!(text, "{stamp:.6}");
        for row in 0..6 {
            for column in 0..=row {
                let _ = write!(text, " {:.9e}", covariance[(row, column)]);
            }
        }
        text.push('\n');
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::datasets::StampedPose;
    use stillpoint::geometry::Se3;
    use stillpoint::slam::PoseCovariance;

    #[test]
    fn covariance_line_has_stamp_and_lower_triangle() {
        let from_origin = Mat6::from_fn(|r, c| (10 * (r.max(c) + 1) + r.min(c) + 1) as f64);
        let poses = Poses {
            final_poses: vec![StampedPose {
                stamp: 1.25,
                world_from_camera: Se3::identity(),
            }],
            covariances: vec![PoseCovariance {
                in_map: Mat6::identity(),
                from_origin,
            }],
            ..Poses::default()
        };
        let files = files(&poses);
        assert_eq!(files.len(), 2);
        let lines: Vec<&str> = files[0].1.lines().filter(|l| !l.starts_with('#')).collect();
        let numbers: Vec<f64> = lines[0].split(' ').map(|n| n.parse().unwrap()).collect();
        assert_eq!((lines.len(), numbers.len()), (1, 22));
        assert_eq!(numbers[..7], [1.25, 11.0, 21.0, 22.0, 31.0, 32.0, 33.0]);
        assert_eq!(numbers[21], 66.0);
        assert!(super::files(&Poses::default()).is_empty());
    }
}
