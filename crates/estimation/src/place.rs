//! A place that is known from elsewhere: where one frame sees a point of another.

use stillpoint_geometry::{Mat3, Se3, Vec3};

/// Where frame B is expected to see a point of frame A, and how well that is known: one measurement more of a motion `b_from_a`. With the origin of A it says
/// how far B is from A; with a point that B is expected to be at, and the origin of B, where B is in A.
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
    /// What is missing from where a motion brings the point to where it is expected, m, and where it brings it, m.
    pub(crate) fn offset(&self, b_from_a: &Se3) -> (Vec3, Vec3) {
        let seen = b_from_a.transform(&self.in_a);
        (self.in_b - seen, seen)
    }
}
