//! Conversion of features into measurements for the estimators.

use stillpoint_estimation::Measurement;
use stillpoint_geometry::Camera;
use stillpoint_map::KeyframeData;

/// A feature's undistorted pixel and its depth (m, if any), with standard deviations and its edge. The edge is that of
/// the recorded image, since a lens hardly turns it.
pub(crate) fn measurement(data: &KeyframeData, feature: usize) -> Measurement {
    let depth = data
        .depth(feature)
        .map(|z| (z, f64::from(data.depth_sigmas[feature])));
    Measurement::new(
        data.position(feature),
        f64::from(data.sigma_px[feature]),
        depth,
    )
    .on_edge(data.keypoints[feature].edge.vector().into())
}

/// The measurement converted to another camera model at the same pose. Needed where keyframes of one problem differ in
/// calibration, for example in a loaded map.
pub(crate) fn measurement_in(data: &KeyframeData, feature: usize, camera: &Camera) -> Measurement {
    let own = &data.camera;
    let m = measurement(data, feature);
    // The usual case; projecting back and forth would change the last bits.
    if own == camera {
        return m;
    }
    // The variance stays the same on the sensor, so it scales with the focal length in pixels.
    let scale = camera.fx / own.fx;
    Measurement {
        pixel: camera.project(&own.ray(m.pixel)),
        pixel_weight: m.pixel_weight / (scale * scale),
        ..m
    }
}
