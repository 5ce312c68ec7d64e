//! Writes point clouds as PLY and PCD, binary little-endian, for MeshLab, CloudCompare, Open3D, Blender and PCL.

use std::fmt::Write;
use std::path::Path;

/// A format of point clouds.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum CloudFormat {
    /// Stanford's polygon format.
    Ply,
    /// The format of the Point Cloud Library, version 0.7.
    Pcd,
}

impl CloudFormat {
    /// The format for a file extension.
    #[must_use]
    pub fn of(path: &Path) -> Option<Self> {
        match path.extension()?.to_str()?.to_ascii_lowercase().as_str() {
            "ply" => Some(Self::Ply),
            "pcd" => Some(Self::Pcd),
            _ => None,
        }
    }
}

/// A point of a cloud.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CloudPoint {
    /// Position, m.
    pub position: [f64; 3],
    /// Unit vector towards the observing cameras; zero if unknown.
    pub normal: [f64; 3],
    /// One number for each name given to [`format()`].
    pub counts: [u32; 4],
}

/// A file of points: position and normal as floats (`x y z nx ny nz`; in a PCD file `normal_x normal_y normal_z`), then the four counts
/// under their names as unsigned integers. `comment` has one line.
#[must_use]
pub fn format(
    format: CloudFormat,
    points: &[CloudPoint],
    names: [&str; 4],
    comment: &str,
) -> Vec<u8> {
    let comment = comment.replace(['\r', '\n'], " ");
    let head = match format {
        CloudFormat::Ply => ply_head(points.len(), names, &comment),
        CloudFormat::Pcd => pcd_head(points.len(), names, &comment),
    };
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

fn ply_head(points: usize, names: [&str; 4], comment: &str) -> String {
    let mut head = String::from("ply\nformat binary_little_endian 1.0\n");
    // Writing to a String cannot fail.
    let _ = writeln!(head, "comment {comment}");
    let _ = writeln!(head, "element vertex {points}");
    for name in ["x", "y", "z", "nx", "ny", "nz"] {
        let _ = writeln!(head, "property float {name}");
    }
    for name in names {
        let _ = writeln!(head, "property uint {name}");
    }
    head.push_str("end_header\n");
    head
}

/// An unorganised cloud: one row of points, with the viewpoint at the origin.
fn pcd_head(points: usize, names: [&str; 4], comment: &str) -> String {
    format!(
        "# .PCD v0.7 - Point Cloud Data file format\n# {comment}\nVERSION 0.7\n\
         FIELDS x y z normal_x normal_y normal_z {}\nSIZE{}\nTYPE{}{}\nCOUNT{}\n\
         WIDTH {points}\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS {points}\nDATA binary\n",
        names.join(" "),
        " 4".repeat(10),
        " F".repeat(6),
        " U".repeat(4),
        " 1".repeat(10),
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn point_cloud_has_a_header_and_40_bytes_per_point() {
        let point = CloudPoint {
            position: [1.0, -2.0, 0.5],
            normal: [0.0, 0.0, -1.0],
            counts: [7, 8, 9, u32::MAX],
        };
        let names = ["a", "b", "c", "d"];
        let bytes = format(CloudFormat::Ply, &[point, point], names, "two\nlines");
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
        let other = format(CloudFormat::Pcd, &[point, point], names, "two\nlines");
        let end = b"DATA binary\n";
        let at = other.windows(end.len()).position(|w| w == end).unwrap() + end.len();
        assert_eq!(
            std::str::from_utf8(&other[..at]).unwrap(),
            "# .PCD v0.7 - Point Cloud Data file format\n# two lines\nVERSION 0.7\n\
             FIELDS x y z normal_x normal_y normal_z a b c d\n\
             SIZE 4 4 4 4 4 4 4 4 4 4\nTYPE F F F F F F U U U U\nCOUNT 1 1 1 1 1 1 1 1 1 1\n\
             WIDTH 2\nHEIGHT 1\nVIEWPOINT 0 0 0 1 0 0 0\nPOINTS 2\nDATA binary\n"
        );
        assert_eq!(other[at..], *body);
    }

    #[test]
    fn file_extension_selects_the_format() {
        let of = |name: &str| CloudFormat::of(Path::new(name));
        assert_eq!(of("a/desk.ply"), Some(CloudFormat::Ply));
        assert_eq!(of("desk.PCD"), Some(CloudFormat::Pcd));
        assert_eq!((of("desk.xyz"), of("desk"), of(".ply")), (None, None, None));
    }
}
