//! Point clouds in the PLY format, binary little-endian, as MeshLab, CloudCompare, Open3D and Blender read them.

use std::fmt::Write;

/// A point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// Position, m.
    pub position: [f64; 3],
    /// Unit vector towards where it was seen from; zero where that is not known.
    pub normal: [f64; 3],
    /// One number for each name that [`format`] is given.
    pub counts: [u32; 4],
}

/// A PLY file: `x y z nx ny nz` as floats, then the four counts under their names as unsigned integers. `comment` has one line.
#[must_use]
pub fn format(points: &[CloudPoint], names: [&str; 4], comment: &str) -> Vec<u8> {
    let mut head = String::from("ply\nformat binary_little_endian 1.0\n");
    // Writing to a String cannot fail.
    let _ = writeln!(head, "comment {}", comment.replace(['\r', '\n'], " "));
    let _ = writeln!(head, "element vertex {}", points.len());
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        let _ = writeln!(head, "property float {name}");
    }
    for name in names {
        let _ = writeln!(head, "property uint {name}");
    }
    head.push_str("end_header\n");
    let mut bytes = head.into_bytes();
    bytes.reserve(40 * points.len());
    for point in points {
        for x in point.position.iter().chain(&point.normal) {
            bytes.extend((*x as f32).to_le_bytes());
        }
        for n in point.counts {
            bytes.extend(n.to_le_bytes());
        }
    }
    bytes
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn a_cloud_is_a_header_and_forty_bytes_per_point() {
        let point = CloudPoint {
            position: [1.0, -2.0, 0.5],
            normal: [0.0, 0.0, -1.0],
            counts: [7, 8, 9, u32::MAX],
        };
        let bytes = format(&[point, point], ["a", "b", "c", "d"], "two\nlines");
        let end = b"end_header\n";
        let at = bytes.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        let head = std::str::from_utf8(&bytes[..at]).unwrap();
        assert_eq!(
            head,
            "ply\nformat binary_little_endian 1.0\ncomment two lines\nelement vertex 2\n\
             property float x\nproperty float y\nproperty float z\n\
             property float nx\nproperty float ny\nproperty float nz\n\
             property uint a\nproperty uint b\nproperty uint c\nproperty uint d\nend_header\n"
        );
        let body = &bytes[at..];
        assert_eq!(body.len(), 80);
        assert_eq!(body[..40], body[40..]);
        assert_eq!(body[..4], 1f32.to_le_bytes());
        assert_eq!(body[4..8], (-2f32).to_le_bytes());
        assert_eq!(body[20..24], (-1f32).to_le_bytes());
        assert_eq!(body[24..28], [7, 0, 0, 0]);
        assert_eq!(body[36..40], [255; 4]);
    }
}
