//! Spatial extent of points, to detect degenerate configurations.

use stillpoint_geometry::{Mat3, Vec3};

/// The smallest height of a triangle, m.
pub(crate) fn height(p: &[Vec3; 3]) -> f64 {
    let sides = [p[1] - p[0], p[2] - p[0], p[2] - p[1]];
    let longest = sides.iter().fold(0.0, |a, s| f64::max(a, s.norm()));
    if longest > 0.0 {
        sides[0].cross(&sides[1]).norm() / longest
    } else {
        0.0
    }
}

/// Root mean square distance of points from their best-fitting line, m; 0 for no points.
pub(crate) fn spread(points: &[Vec3]) -> f64 {
    let count = points.len().max(1) as f64;
    let mean = points.iter().fold(Vec3::zeros(), |a, p| a + p) / count;
    let mut scatter = Mat3::zeros();
    for p in points {
        let d = p - mean;
        scatter += d * d.transpose();
    }
    let values = scatter.symmetric_eigenvalues();
    ((values.sum() - values.max()).max(0.0) / count).sqrt()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    proptest! {
        /// Points at equal distance from a line have this spread, for any direction of the line.
        #[test]
        fn spread_is_the_distance_from_a_line(a in prop::array::uniform3(-1.0..1.0f64), away in 0.0..0.2f64) {
            let line = Vec3::from(a);
            prop_assume!(line.norm() > 0.5);
            let across = line.cross(&Vec3::new(0.3, -0.2, 0.9)).normalize() * away;
            let points: Vec<Vec3> = (-4..=4).flat_map(|i| [-1.0, 1.0].map(|s| line * f64::from(i) + across * s)).collect();
            prop_assert!((spread(&points) - away).abs() < 1e-7, "{} {away}", spread(&points));
            let triangle = [points[0], points[8], points[8] + across];
            prop_assert!((height(&triangle) - away).abs() < 0.1 * away + 1e-9);
        }
    }

    #[test]
    fn empty_or_coincident_points_have_no_extent() {
        assert_eq!(spread(&[]), 0.0);
        assert_eq!(height(&[Vec3::zeros(); 3]), 0.0);
    }
}
