//! Detects the format of a file of poses: columns, unit of the stamps, and quaternion order.
//!
//! Supports the TUM format, and EuRoC's `data.csv` (nanoseconds, position, quaternion with w first, possibly velocities and biases). Uses
//! the header with column names, the number of columns, the stamps, and the signs of quaternions.

use crate::error::Result;
use crate::lists::{Line, data_lines, parse_first_numbers, parse_numbers};
use crate::trajectory::StampedPose;
use crate::units::{BETWEEN_POSES, Unit};
use std::path::Path;
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};

/// Expected contents of a line, for messages.
const COLUMNS: &str = "8 numbers: timestamp tx ty tz qx qy qz qw";
/// Number of columns of the TUM format, and of EuRoC's state estimates.
const POSE: usize = 8;
const EUROC: usize = 17;
/// Number of lines used to detect the unit of the stamps.
const JUDGED: usize = 1000;

#[derive(Clone, Copy, Debug)]
pub(crate) struct PoseForm {
    pub(crate) unit: Unit,
    /// The quaternion is qw qx qy qz.
    pub(crate) w_first: bool,
    more: bool,
    /// Line number, from 1, of a header that is no comment.
    pub(crate) header: Option<usize>,
    /// Neither column names nor their number determine the quaternion order.
    undecided: bool,
}

/// Minimum of the largest w in a file, which distinguishes w from a component that is always zero, as for a robot that turns about one
/// axis: w is above it until the camera has turned by 168 degrees.
const CLEAR: f64 = 0.1;

impl PoseForm {
    pub(crate) fn of(text: &str) -> Self {
        let names_it = |l: &Line<'_>| w_first_by(l.text).is_some();
        let header = data_lines(text).next().filter(names_it).map(|l| l.number);
        let named = header.and_then(|n| text.lines().nth(n - 1));
        let comments = text.trim_start_matches('\u{feff}').lines();
        let comments = comments.take_while(|l| l.trim_start().starts_with('#'));
        let by_name = named.into_iter().chain(comments).find_map(w_first_by);
        let lines = || data_lines(text).filter(|l| Some(l.number) != header);
        let columns = lines().next().map_or(POSE, |l| l.columns().count());
        let stamp = |l: Line<'_>| l.columns().next()?.parse().ok();
        let stamps: Vec<f64> = lines().take(JUDGED).filter_map(stamp).collect();
        let unit = Unit::of(&stamps, BETWEEN_POSES);
        let commas = lines().next().is_some_and(|l| l.text.contains(','));
        // EuRoC's files have column names; without them, commas and nanoseconds identify the format.
        let as_euroc = columns == EUROC || (commas && unit == Unit::Nanoseconds);
        Self {
            unit,
            w_first: by_name.unwrap_or(as_euroc),
            more: columns == EUROC || (columns > POSE && by_name.is_some()),
            header,
            undecided: by_name.is_none() && !as_euroc,
        }
    }

    /// Reinterprets quaternions read with w last as w first if their signs show it: all signs flip between two lines, yet the first number
    /// is never negative, as many programs normalise w.
    pub(crate) fn judge_signs(&mut self, poses: &mut [StampedPose]) {
        if !self.undecided {
            return;
        }
        let numbers = |p: &StampedPose| p.world_from_camera.rotation.coords;
        let lowest = |at: usize| poses.iter().map(|p| numbers(p)[at]).fold(1.0, f64::min);
        let highest = poses.iter().map(|p| numbers(p)[0]).fold(0.0, f64::max);
        // Consecutive poses are similar: with consistent signs so are their numbers.
        let exchanged = |w: &[StampedPose]| numbers(&w[0]).dot(&numbers(&w[1])) < -0.5;
        self.w_first = lowest(0) >= 0.0
            && highest > CLEAR
            && lowest(3) < 0.0
            && poses.windows(2).any(exchanged);
        for p in poses.iter_mut().filter(|_| self.w_first) {
            let q = numbers(p);
            p.world_from_camera.rotation =
                UnitQuaternion::new_normalize(Quaternion::new(q[0], q[1], q[2], q[3]));
        }
    }

    /// Stamp, position and quaternion of a line.
    pub(crate) fn numbers(&self, line: &Line<'_>, path: &Path) -> Result<[f64; POSE]> {
        if self.more {
            parse_first_numbers(line, path, COLUMNS)
        } else {
            parse_numbers(line, path, COLUMNS)
        }
    }

    /// Findings about the file, one sentence each.
    pub(crate) fn remarks(&self, path: &Path) -> Vec<String> {
        let mut remarks: Vec<String> = self.unit.remark(path).into_iter().collect();
        if self.w_first {
            let form = if self.more { "EuRoC's columns, " } else { "" };
            let signs = if self.undecided {
                ", as the signs tell: the first number is never negative, though all signs are exchanged between two lines"
            } else {
                ""
            };
            remarks.push(format!(
                "{}: {form}quaternions with w first (qw qx qy qz){signs}",
                path.display()
            ));
        }
        remarks
    }
}

/// Whether the column names in a line have w before x in the quaternion; `None` without quaternion names.
fn w_first_by(line: &str) -> Option<bool> {
    let line = line.trim_start().trim_start_matches('#').to_lowercase();
    let separator = if line.contains(',') { ',' } else { ' ' };
    let place = |of: char| {
        line.split(separator).position(|name| {
            let name = name.split(['[', '(']).next().unwrap_or_default();
            let name: String = name.chars().filter(char::is_ascii_alphabetic).collect();
            name.starts_with('q') && name.ends_with(of)
        })
    };
    Some(place('w')? < place('x')?)
}

#[cfg(test)]
mod tests {
    use crate::trajectory;
    use std::path::Path;

    const EUROC: &str = "#timestamp, p_RS_R_x [m], p_RS_R_y [m], p_RS_R_z [m], q_RS_w [], q_RS_x [], q_RS_y [], q_RS_z [], v_RS_R_x [m s^-1], v_RS_R_y [m s^-1], v_RS_R_z [m s^-1], b_w_RS_S_x [rad s^-1], b_w_RS_S_y [rad s^-1], b_w_RS_S_z [rad s^-1], b_a_RS_S_x [m s^-2], b_a_RS_S_y [m s^-2], b_a_RS_S_z [m s^-2]";

    /// The first pose: stamp, x, and w of the quaternion.
    fn first(text: &str) -> (f64, f64, f64) {
        let poses = trajectory::parse(text, Path::new("data.csv")).unwrap();
        let p = &poses[0];
        let q = p.world_from_camera.rotation;
        (p.stamp, p.world_from_camera.translation.x, q.w)
    }

    #[test]
    fn euroc_files_are_read_with_and_without_header() {
        let row = "1403636580838555648,4.5,-1.6,0.8,0.6,0,0.8,0,1,2,3,4,5,6,7,8,9";
        let expected = (1_403_636_580.838_555_6, 4.5, 0.6);
        for text in [format!("{EUROC}\n{row}\n"), format!("{row}\n")] {
            let found = first(&text);
            assert!((found.0 - expected.0).abs() < 1e-6, "{found:?}");
            assert_eq!((found.1, found.2), (expected.1, expected.2));
        }
        let short = "1403636580838555648,4.5,-1.6,0.8,0.6,0,0.8,0\n";
        assert_eq!(first(short).2, 0.6);
    }

    #[test]
    fn header_determines_the_quaternion_order() {
        let rows = "1.5 1 2 3 0.6 0 0.8 0\n2.5 1 2 3 0.6 0 0.8 0\n";
        for (header, w) in [
            ("# timestamp tx ty tz qw qx qy qz\n", 0.6),
            ("timestamp tx ty tz qw qx qy qz\n", 0.6),
            ("# ground truth\n# time x y z q_w q_x q_y q_z\n", 0.6),
            ("# timestamp tx ty tz qx qy qz qw\n", 0.0),
            ("", 0.0),
        ] {
            assert_eq!(first(&format!("{header}{rows}")), (1.5, 1.0, w), "{header}");
        }
    }

    /// Poses of a rotating camera, with w never negative; the quaternion components start at index `first` of the cycle w, x, y, z.
    fn turning(first: usize, clear: f64) -> String {
        let row = |k: u32| {
            let half = 0.05 * f64::from(k);
            let q = [half.cos(), clear * half.sin(), 0.0, half.sin()];
            let sign = if q[0] < 0.0 { -1.0 } else { 1.0 };
            let n: Vec<String> = (0..4)
                .map(|i| (sign * q[(first + i) % 4]).to_string())
                .collect();
            format!("{}.5 1 2 3 {}\n", k, n.join(" "))
        };
        (0..90).map(row).collect()
    }

    #[test]
    fn quaternion_order_is_inferred_from_signs() {
        for clear in [0.0, 0.5] {
            let parsed = |first| trajectory::parse_said(&turning(first, clear), Path::new("t"));
            let (poses, said) = parsed(0).unwrap();
            assert!(said.len() == 1 && said[0].contains("w first"), "{said:?}");
            let (same, nothing) = parsed(1).unwrap();
            assert!(nothing.is_empty(), "{nothing:?}");
            for (a, b) in poses.iter().zip(&same) {
                let between = a.world_from_camera.rotation.inverse() * b.world_from_camera.rotation;
                assert!(between.angle() < 1e-6, "{a:?} {b:?}");
            }
        }
        // Signs that were not normalised determine nothing.
        let kept: String = turning(0, 0.5)
            .lines()
            .take(30)
            .collect::<Vec<_>>()
            .join("\n");
        let (_, said) = trajectory::parse_said(&kept, Path::new("t")).unwrap();
        assert!(said.is_empty(), "{said:?}");
    }

    #[test]
    fn stamp_units_are_recognised_and_reported() {
        for (scale, word) in [
            (1e3, "milliseconds"),
            (1e6, "microseconds"),
            (1e9, "nanoseconds"),
        ] {
            let text: String = (0..9)
                .map(|i| {
                    format!(
                        "{} 1 2 3 0 0 0 1\n",
                        (130_503_110_200_u64 + i) as f64 / 100.0 * scale
                    )
                })
                .collect();
            let (poses, said) = trajectory::parse_said(&text, Path::new("t")).unwrap();
            assert!((poses[8].stamp - 1_305_031_102.08).abs() < 1e-6, "{word}");
            assert!(said.len() == 1 && said[0].contains(word), "{said:?}");
        }
    }

    #[test]
    fn other_column_counts_are_refused() {
        for text in ["1 2 3 4 5 6 7 8 9 10 11 12\n", "1 2 3\n"] {
            let e = trajectory::parse(text, Path::new("t"))
                .unwrap_err()
                .to_string();
            assert!(e.contains("8 numbers") && e.contains("columns"), "{e}");
        }
    }
}
