//! Where a landmark should appear, and on which level of the pyramid.
//!
//! Both follow ORB-SLAM2 (Mur-Artal, Tardos 2017): a landmark is recognised within the distances at which the pyramid shows it as its
//! descriptor knows it, with a fifth to spare, and on the level that makes up for the distance.

use stillpoint_features::Window;
use stillpoint_geometry::Vec3;
use stillpoint_map::{KeyframeData, Landmark, ScaleRange};

/// Share of the nearest distance down to which a landmark is still recognised: about a level of 1.2 beyond the pyramid, as in ORB-SLAM2 (Mur-Artal,
/// Tardos 2017).
const NEARER: f64 = 0.8;
/// Share of the farthest distance up to which it is, as in ORB-SLAM2 (Mur-Artal, Tardos 2017): a level of 1.2 beyond the pyramid.
const FARTHER: f64 = 1.2;
/// A level is taken when it is missed by no more than this share of a level, chosen far above what rounding does: where the distance is that of the
/// level itself, rounding must not lift it.
const LEVEL_SLACK: f64 = 1e-3;
/// Points nearer than this have no useful projection, m. Chosen: a sixth of the default of `sensor.min_depth`.
const MIN_Z: f64 = 0.05;
/// Above any level that a pyramid has, or the top one of 16 (the most that `features.levels` allows): a landmark that is nearer than its coarsest
/// level shows it is looked for one level above the top, where the window holds the top level alone.
const TOP_LEVEL: f64 = 15.0;

/// Whether a landmark can be recognised from a distance (m).
pub(crate) fn is_in_range(range: &ScaleRange, distance: f64) -> bool {
    distance >= NEARER * f64::from(range.min_distance)
        && distance <= FARTHER * f64::from(range.max_distance)
}

/// The pyramid level, up to `top`, on which a landmark appears from a distance (m). `log_scale` is the logarithm of the factor between
/// two levels.
pub(crate) fn level_at(range: &ScaleRange, distance: f64, log_scale: f64, top: f64) -> u8 {
    let ratio = f64::from(range.max_distance) / distance;
    libm::ceil(libm::log(ratio) / log_scale - LEVEL_SLACK).clamp(0.0, top) as u8
}

/// Where a keyframe should see a landmark at `p` (m, its camera coordinates): none when outside its image, or too near or far
/// to be recognised. `radius_px` is the radius on level 0.
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
    // Those of the image: undistorting its border again for each landmark would take most of mapping's time.
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
