//! Writes pose graphs in the text format of g2o, for GTSAM, Ceres' examples and SE-Sync too.

use std::fmt::Write;
use stillpoint_geometry::{Mat6, Se3};

/// A relative pose between two vertices.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct GraphEdge {
    /// The vertex of the reference frame.
    pub from: u32,
    /// The vertex whose pose it is.
    pub to: u32,
    /// Maps coordinates of `to` to those of `from`, m.
    pub from_to: Se3,
    /// The inverse of its covariance, for a perturbation `[translation; rotation]` in the coordinates of `to`: m, rad.
    pub information: Mat6,
}

/// A file of `VERTEX_SE3:QUAT id x y z qx qy qz qw` and `EDGE_SE3:QUAT from to x y z qx qy qz qw` with the upper triangle of the
/// information matrix, which is about x y z qx qy qz: half angles. Vertices are poses that map a vertex's coordinates to the world's, m.
/// Numbers have 9 decimals; the sign of each quaternion is chosen so that `qw >= 0`.
#[must_use]
pub fn format(vertices: &[(u32, Se3)], edges: &[GraphEdge]) -> String {
    let mut text = String::with_capacity(110 * vertices.len() + 200 * edges.len());
    // Writing to a String cannot fail.
    for (id, world_from_vertex) in vertices {
        let _ = write!(text, "VERTEX_SE3:QUAT {id}");
        pose(&mut text, world_from_vertex);
        text.push('\n');
    }
    for edge in edges {
        let _ = write!(text, "EDGE_SE3:QUAT {} {}", edge.from, edge.to);
        pose(&mut text, &edge.from_to);
        for row in 0..6 {
            for column in row..6 {
                // The vector of a quaternion is half the angle, which doubles its square root of information.
                let halves = usize::from(row >= 3) + usize::from(column >= 3);
                let element = edge.information[(row, column)] * [1.0, 2.0, 4.0][halves];
                let _ = write!(text, " {}", element + 0.0);
            }
        }
        text.push('\n');
    }
    text
}

fn pose(text: &mut String, pose: &Se3) {
    let (t, mut q) = (pose.translation, pose.rotation.coords);
    if q.w < 0.0 {
        q = -q;
    }
    for number in [t.x, t.y, t.z, q.x, q.y, q.z, q.w] {
        // Adding 0.0 turns -0.0 into 0.0.
        let _ = write!(text, " {:.9}", number + 0.0);
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::{Vec3, so3};

    #[test]
    fn g2o_file_has_a_line_per_vertex_and_edge() {
        let turned = Se3::new(
            so3::exp(&Vec3::new(0.0, 0.0, 3.0)),
            Vec3::new(1.0, 2.0, -0.5),
        );
        let edge = GraphEdge {
            from: 4,
            to: 9,
            from_to: turned,
            information: Mat6::from_diagonal_element(30.0),
        };
        let text = format(&[(4, Se3::identity()), (9, turned)], &[edge]);
        let lines: Vec<&str> = text.lines().collect();
        assert_eq!(
            lines[0],
            "VERTEX_SE3:QUAT 4 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 0.000000000 1.000000000"
        );
        let numbers =
            "1.000000000 2.000000000 -0.500000000 0.000000000 0.000000000 0.997494987 0.070737202";
        assert_eq!(lines[1], format!("VERTEX_SE3:QUAT 9 {numbers}"));
        assert_eq!(
            lines[2],
            format!(
                "EDGE_SE3:QUAT 4 9 {numbers} 30 0 0 0 0 0 30 0 0 0 0 30 0 0 0 120 0 0 120 0 120"
            )
        );
        assert_eq!(lines.len(), 3);
    }
}
