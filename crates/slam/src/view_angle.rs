//! Difference between two views as an angle.

use stillpoint_geometry::Se3;

/// Difference between two views of a scene at depth `depth` (m), rad: rotation plus the angle subtended by the
/// translation.
pub(crate) fn view_angle(motion: &Se3, depth: f64) -> f64 {
    motion.rotation.angle() + motion.translation.norm() / depth
}
