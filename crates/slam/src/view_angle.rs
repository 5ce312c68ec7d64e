//! How far apart two views are, in one number.

use stillpoint_geometry::Se3;

/// By how much two views of a scene at so many m differ, rad: the turn between both, and the angle under which their distance appears.
pub(crate) fn view_angle(motion: &Se3, depth: f64) -> f64 {
    motion.rotation.angle() + motion.translation.norm() / depth
}
