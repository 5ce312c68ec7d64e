//! Triangulation of a point from two rays.

use stillpoint_geometry::Vec3;

/// A triangulated point.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Triangulation {
    /// World position, m.
    pub point: Vec3,
    /// Cosine of the angle between the two rays.
    pub cos_parallax: f64,
}

/// The midpoint of two rays where they are nearest (Hartley, Zisserman, "Multiple View Geometry", 12.1; bundle
/// adjustment refines it). `None` if the rays are parallel or the point lies behind a camera. Centres in m, directions
/// of any length, world coordinates.
#[must_use]
pub fn triangulate_midpoint(
    centre_a: &Vec3,
    direction_a: &Vec3,
    centre_b: &Vec3,
    direction_b: &Vec3,
) -> Option<Triangulation> {
    let (u, v) = (direction_a.normalize(), direction_b.normalize());
    let cos = u.dot(&v);
    let sin2 = 1.0 - cos * cos;
    if sin2 < 1e-10 {
        return None;
    }
    let w = centre_b - centre_a;
    let (a, b) = (w.dot(&u), w.dot(&v));
    let s = (a - cos * b) / sin2;
    let t = (cos * a - b) / sin2;
    if s <= 0.0 || t <= 0.0 {
        return None;
    }
    let point = (centre_a + u * s + centre_b + v * t) * 0.5;
    point
        .iter()
        .all(|x| x.is_finite())
        .then_some(Triangulation {
            point,
            cos_parallax: cos,
        })
}
