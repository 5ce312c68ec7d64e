//! What a feature measured, as estimation takes it.

use stillpoint_estimation::Measurement;
use stillpoint_geometry::Camera;
use stillpoint_map::KeyframeData;

/// What a feature measured: its undistorted pixel, and its depth (m) where it has one, each with its standard deviation.
pub(crate) fn measurement(data: &KeyframeData, feature: usize) -> Measurement {
    let depth = data
        .depth(feature)
        .map(|z| (z, f64::from(data.depth_sigmas[feature])));
    Measurement::new(
        data.position(feature),
        f64::from(data.sigma_px[feature]),
        depth,
    )
}

/// What a feature would have measured with another camera at the same place, for problems in which several keyframes take part:
/// those of a map that was loaded may have been calibrated in another way.
pub(crate) fn measurement_in(data: &KeyframeData, feature: usize, camera: &Camera) -> Measurement {
    let own = &data.camera;
    let m = measurement(data, feature);
    // Almost always. What goes there and back would not come back to the same bits.
    if own == camera {
        return m;
    }
    // Both of one size on the sensor, in pixels of each.
    let scale = camera.fx / own.fx;
    Measurement {
        pixel: camera.project(&own.ray(m.pixel)),
        pixel_weight: m.pixel_weight / (scale * scale),
        ..m
    }
}
