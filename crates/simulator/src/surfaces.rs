//! Distances of points to true surfaces, for evaluating reconstructions.

use std::collections::BTreeMap;
use stillpoint_geometry::Vec3;

/// Convex planar polygons, as those of [`Simulator::static_surfaces`](crate::Simulator::static_surfaces).
#[derive(Clone, Debug, Default)]
pub struct Surfaces(Vec<Polygon>);

#[derive(Clone, Debug)]
struct Polygon {
    corners: Vec<Vec3>,
    normal: Vec3,
}

impl Surfaces {
    /// From the corners of each polygon in order, m. Polygons of less than three corners are left out.
    #[must_use]
    pub fn new(polygons: Vec<Vec<Vec3>>) -> Self {
        let polygon = |corners: Vec<Vec3>| {
            let [a, b, c] = *corners.first_chunk::<3>()?;
            let normal = (b - a).cross(&(c - a)).normalize();
            Some(Polygon { corners, normal })
        };
        Self(polygons.into_iter().filter_map(polygon).collect())
    }

    /// Distance of a point from the nearest polygon, m; infinite without polygons.
    #[must_use]
    pub fn distance(&self, p: &Vec3) -> f64 {
        self.0.iter().fold(f64::INFINITY, |nearest, polygon| {
            let off = polygon.normal.dot(&(p - polygon.corners[0])).abs();
            // No point of a polygon is nearer than its plane.
            if off < nearest {
                nearest.min(polygon.distance(p, off))
            } else {
                nearest
            }
        })
    }
}

impl Polygon {
    /// Distance of a point that is `off` from the plane.
    fn distance(&self, p: &Vec3, off: f64) -> f64 {
        let (mut inside, mut nearest) = (true, f64::INFINITY);
        for (i, a) in self.corners.iter().enumerate() {
            let side = self.corners[(i + 1) % self.corners.len()] - a;
            inside &= self.normal.cross(&side).dot(&(p - a)) >= 0.0;
            let share = ((p - a).dot(&side) / side.norm_squared()).clamp(0.0, 1.0);
            nearest = nearest.min((a + side * share - p).norm());
        }
        if inside { off } else { nearest }
    }
}

/// The share of points that have one of the others within a distance, m; NaN without points.
#[must_use]
pub fn share_near(points: &[Vec3], others: &[Vec3], within: f64) -> f64 {
    let cell = |p: &Vec3| <[i32; 3]>::from(p.map(|v| (v / within).floor() as i32));
    let mut cells: BTreeMap<[i32; 3], Vec<&Vec3>> = BTreeMap::new();
    for p in others {
        cells.entry(cell(p)).or_default().push(p);
    }
    let near = |p: &&Vec3| {
        let at = cell(p);
        (0..27).any(|k| {
            let steps = [k % 3 - 1, k / 3 % 3 - 1, k / 9 - 1];
            // Distant cells saturate.
            let around = std::array::from_fn(|axis| at[axis].saturating_add(steps[axis]));
            let mut there = cells.get(&around).into_iter().flatten();
            there.any(|q| (*p - *q).norm() < within)
        })
    };
    points.iter().filter(near).count() as f64 / points.len() as f64
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// A square of 2 m in the plane z = 1, and one of 2 m in the plane x = 3.
    fn two() -> Surfaces {
        let (x, y, z) = (Vec3::x(), Vec3::y(), Vec3::z());
        let square = |m: Vec3, u: Vec3, v: Vec3| vec![m - u - v, m + u - v, m + u + v, m - u + v];
        Surfaces::new(vec![
            square(z, x, y),
            square(3.0 * x, y, z),
            vec![Vec3::zeros(); 2],
        ])
    }

    #[test]
    fn distances_match_manual_calculations() {
        for (p, expected) in [
            ([0.5, -0.5, 3.5], 2.5),
            ([0.5, 0.0, -1.0], 2.0),
            ([2.2, 0.0, 0.0], 0.8),
            // Beside the first one's border, and beside its corner.
            ([-2.0, 0.0, 1.0], 1.0),
            ([-2.0, -2.0, 1.0], 2.0_f64.sqrt()),
        ] {
            assert!(
                (two().distance(&Vec3::from(p)) - expected).abs() < 1e-12,
                "{p:?}"
            );
        }
        assert!(Surfaces::default().distance(&Vec3::zeros()).is_infinite());
    }

    #[test]
    fn far_or_non_finite_points_are_near_nothing() {
        let far = [Vec3::repeat(1e300), Vec3::repeat(f64::NAN)];
        assert_eq!(share_near(&far, &[Vec3::zeros()], 0.05), 0.0);
        assert_eq!(share_near(&[Vec3::zeros()], &far, 0.05), 0.0);
    }

    proptest! {
        /// No point of a polygon is nearer, and one of its points is as near.
        #[test]
        fn distance_is_the_minimum_over_the_surface(p in prop::array::uniform3(-5.0..5.0_f64), u in -1.0..1.0_f64, v in -1.0..1.0_f64) {
            let (p, distance) = (Vec3::from(p), two().distance(&Vec3::from(p)));
            for on in [Vec3::new(u, v, 1.0), Vec3::new(3.0, u, v)] {
                prop_assert!((on - p).norm() >= distance - 1e-12);
                prop_assert!(two().distance(&on) < 1e-12);
            }
        }

        #[test]
        fn share_near_equals_brute_force(points in prop::collection::vec(prop::array::uniform3(-0.2..0.2_f64), 1..30), others in prop::collection::vec(prop::array::uniform3(-0.2..0.2_f64), 0..30)) {
            let [points, others] = [points, others].map(|all| all.into_iter().map(Vec3::from).collect::<Vec<_>>());
            let near = |p: &&Vec3| others.iter().any(|q| (*p - q).norm() < 0.05);
            let expected = points.iter().filter(near).count() as f64 / points.len() as f64;
            prop_assert_eq!(share_near(&points, &others, 0.05), expected);
        }
    }
}
