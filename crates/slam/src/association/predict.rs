//! Predicts where a landmark appears in an image and on which pyramid level.
//!
//! Both follow ORB-SLAM2 (Mur-Artal, Tardos 2017): a landmark is searched at distances that the pyramid covers, with a
//! margin of a fifth, on the level whose scale corresponds to the distance.

use stillpoint_features::Window;
use stillpoint_geometry::Vec3;
use stillpoint_map::{KeyframeData, Landmark, ScaleRange};

/// Share of the minimum distance below which a landmark is not searched, as in ORB-SLAM2 (Mur-Artal, Tardos 2017): half
/// a level of 1.45 beyond the pyramid.
const NEARER: f64 = 0.8;
/// Share of the maximum distance beyond which a landmark is not searched, as in ORB-SLAM2 (Mur-Artal, Tardos 2017):
/// half a level of 1.45 beyond the pyramid.
const FARTHER: f64 = 1.2;
/// Tolerance when rounding up to a level, share of a level, chosen far above the rounding error, so that a distance
/// exactly on a level is not raised to the next.
const LEVEL_SLACK: f64 = 1e-3;
/// Minimum depth of a projected point, m. Chosen: a sixth of the default of `sensor.min_depth`.
const MIN_Z: f64 = 0.05;
/// Maximum predicted level: the top one of 16 (the maximum of `features.levels`). A landmark nearer than its coarsest
/// level is predicted one level above the top, so that the window holds only the top level.
const TOP_LEVEL: f64 = 15.0;

/// Whether a landmark can be matched at this distance (m).
pub(crate) fn is_in_range(range: &ScaleRange, distance: f64) -> bool {
    distance >= NEARER * f64::from(range.min_distance)
        && distance <= FARTHER * f64::from(range.max_distance)
}

/// Predicted pyramid level, at most `top`, at this distance (m). `log_scale` is the logarithm of the scale factor
/// between levels.
pub(crate) fn level_at(range: &ScaleRange, distance: f64, log_scale: f64, top: f64) -> u8 {
    let ratio = f64::from(range.max_distance) / distance;
    libm::ceil(libm::log(ratio) / log_scale - LEVEL_SLACK).clamp(0.0, top) as u8
}

/// Search window of a landmark at `p` (camera coordinates, m), or `None` if it is outside the image or its scale range.
/// `radius_px` applies to level 0.
pub(crate) fn window_of(
    data: &KeyframeData,
    landmark: &Landmark,
    p: &Vec3,
    radius_px: f32,
    scale_factor: f64,
) -> Option<Window> {
    if p.z <= MIN_Z {
        return None;
    }
    let px = data.camera.project(p);
    // Cached bounds: undistorting the image border for each landmark would dominate mapping time.
    let bounds = data.grid.bounds().map(f64::from);
    if px.x < bounds[0] || px.y < bounds[1] || px.x > bounds[2] || px.y > bounds[3] {
        return None;
    }
    let (distance, range) = (p.norm(), &landmark.scale_range);
    if !is_in_range(range, distance) {
        return None;
    }
    let level = level_at(range, distance, libm::log(scale_factor), TOP_LEVEL);
    Some(Window {
        x: px.x as f32,
        y: px.y as f32,
        radius: radius_px * libm::pow(scale_factor, f64::from(level)) as f32,
        min_level: level.saturating_sub(1),
        max_level: level,
    })
}
