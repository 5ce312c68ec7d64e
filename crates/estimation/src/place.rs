//! Prior on the position of a point between two frames.

use stillpoint_geometry::{Mat3, Se3, Vec3};

/// Expected position in frame B of a point of frame A, as an additional measurement of a motion `b_from_a`. With the
/// origin of A it constrains the distance of A from B; with the origin of B, the position of B in A.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct KnownPlace {
    /// The point in coordinates of A, m.
    pub in_a: Vec3,
    /// The same point in coordinates of B, m.
    pub in_b: Vec3,
    /// Inverse covariance of `in_b`, 1/m^2.
    pub information: Mat3,
}

impl KnownPlace {
    /// Expected minus predicted position, m, and the predicted position, m.
    pub(crate) fn offset(&self, b_from_a: &Se3) -> (Vec3, Vec3) {
        let seen = b_from_a.transform(&self.in_a);
        (self.in_b - seen, seen)
    }
}
