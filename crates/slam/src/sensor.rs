//! The depth sensor: its range, its noise, and the depth of a keypoint.

use crate::config::Checker;
use serde::{Deserialize, Serialize};
use stillpoint_geometry::{Camera, Se3, Vec2, Vec6};
use stillpoint_imaging::DepthImage;

/// Range and noise of the depth sensor.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct SensorConfig {
    /// Nearest depth that is used, m. Range: 0.01 to 10. Structured-light cameras begin at 0.4 m; nearer values are noise.
    pub min_depth: f64,
    /// Farthest depth that is used, m. Range: 0.1 to 100. Beyond 8 m a Kinect's error exceeds 10 cm.
    pub max_depth: f64,
    /// Points nearer than this make landmarks from their depth alone, m. Range: 0.1 to 100. 40 baselines of 7.5 cm.
    pub close_depth: f64,
    /// Factor on the sensor's own noise `0.0012 + 0.0019 (z - 0.4)^2` m (Nguyen, Izadi, Lovell, 3DIMPVT 2012). Range:
    /// 0.1 to 100.
    pub noise_scale: f64,
    /// Share of the depth that calibration may be wrong by, added to the noise in quadrature. Range: 0 to 0.2.
    pub calibration_error: f64,
    /// Time from the exposure of the colour image's first row to its last, s; 0 for a global shutter. Range: 0 to 0.1.
    /// With `self_calibrate` this is where the estimate starts.
    pub readout: f64,
    /// Age of a depth image at its stamp, s, beyond that of a colour image. Range: -0.1 to 0.1.
    pub depth_delay: f64,
    /// Estimates `readout` while tracking. Range: true or false. Few cameras state it, and on a rolling shutter it costs
    /// more accuracy than everything else.
    pub self_calibrate: bool,
}

impl Default for SensorConfig {
    fn default() -> Self {
        Self {
            min_depth: 0.3,
            max_depth: 8.0,
            close_depth: 3.0,
            noise_scale: 1.0,
            calibration_error: 0.01,
            readout: 0.0,
            depth_delay: 0.0,
            self_calibrate: true,
        }
    }
}

impl SensorConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_depth", self.min_depth, 0.01, 10.0);
        c.range("max_depth", self.max_depth, 0.1, 100.0);
        c.range("close_depth", self.close_depth, 0.1, 100.0);
        c.range("noise_scale", self.noise_scale, 0.1, 100.0);
        c.range("calibration_error", self.calibration_error, 0.0, 0.2);
        c.range("readout", self.readout, 0.0, 0.1);
        c.range("depth_delay", self.depth_delay, -0.1, 0.1);
    }
}

/// When the parts of a frame were exposed, relative to its stamp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Timing {
    /// Time from the exposure of the first row to that of the last, s; the stamp is that of the middle row.
    pub readout: f64,
    /// Age of the depth image at its stamp, s.
    pub depth_delay: f64,
}

impl SensorConfig {
    /// The timing that the configuration states.
    pub(crate) fn timing(&self) -> Timing {
        Timing {
            readout: self.readout,
            depth_delay: self.depth_delay,
        }
    }
}

/// A depth measurement of one keypoint.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DepthReading {
    /// Depth along the optical axis, m.
    pub(crate) z: f64,
    /// Its standard deviation, m.
    pub(crate) sigma: f64,
}

/// Reads depths of keypoints in one depth image.
pub(crate) struct DepthReader<'a> {
    config: &'a SensorConfig,
    camera: &'a Camera,
    image: &'a DepthImage,
    /// Motion from the camera at the colour stamp to the camera at the exposure of the depth image; none when unknown.
    depth_from_colour: Option<Se3>,
    /// Standard deviation of the camera's motion along the ray between the two that is not compensated, m.
    motion_sigma: f64,
}

impl<'a> DepthReader<'a> {
    /// A reader for a depth image exposed `dt` seconds after the colour image, with the camera moving by `velocity`
    /// (twist per second of `camera_later_from_camera_earlier`).
    pub(crate) fn new(
        config: &'a SensorConfig,
        camera: &'a Camera,
        image: &'a DepthImage,
        velocity: Option<&Vec6>,
        dt: f64,
    ) -> Self {
        let motion = velocity.filter(|_| dt != 0.0).map(|v| v * dt);
        Self {
            config,
            camera,
            image,
            depth_from_colour: motion.map(|m| Se3::exp(&m)),
            // A constant velocity misses about a third of the motion.
            motion_sigma: motion.map_or(0.0, |m| m.fixed_rows::<3>(0).norm() / 3.0),
        }
    }

    /// The depth at a keypoint: `raw` in the image as recorded, `undistorted` the same point without distortion.
    pub(crate) fn read(&self, raw: Vec2, undistorted: Vec2) -> Option<DepthReading> {
        let z = match &self.depth_from_colour {
            None => self.local(raw)?,
            Some(motion) => self.compensated(raw, undistorted, motion)?,
        };
        let sensor = self.config.noise_scale * (0.0012 + 0.0019 * (z - 0.4) * (z - 0.4));
        let calibration = self.config.calibration_error * z;
        let sigma =
            (sensor * sensor + calibration * calibration + self.motion_sigma * self.motion_sigma)
                .sqrt();
        Some(DepthReading { z, sigma })
    }

    /// The depth image was taken from another pose: looks where the point appears in it, and takes back the motion along
    /// the axis. One step from the depth at the keypoint itself is enough for motions of a few millimetres.
    fn compensated(&self, raw: Vec2, undistorted: Vec2, motion: &Se3) -> Option<f64> {
        let guess = self.local(raw)?;
        let seen = motion.transform(&self.camera.backproject(undistorted, guess));
        if seen.z <= 0.0 {
            return None;
        }
        let there = self.local(self.camera.project_distorted(&seen))?;
        let z = there - (seen.z - guess);
        (z > 0.0).then_some(z)
    }

    /// A robust depth around a raw pixel: the median of the valid depths in 3x3, when they are of one surface.
    fn local(&self, raw: Vec2) -> Option<f64> {
        let (x, y) = (libm::round(raw.x), libm::round(raw.y));
        let (w, h) = (self.image.width() as f64, self.image.height() as f64);
        if !(x >= 1.0 && y >= 1.0 && x < w - 1.0 && y < h - 1.0) {
            return None;
        }
        let (x, y) = (x as usize, y as usize);
        let mut valid = [0.0f32; 9];
        let mut n = 0;
        for row in y - 1..=y + 1 {
            for column in x - 1..=x + 1 {
                let z = self.image.at(column, row);
                if f64::from(z) >= self.config.min_depth && f64::from(z) <= self.config.max_depth {
                    valid[n] = z;
                    n += 1;
                }
            }
        }
        if n < 5 {
            return None;
        }
        let valid = &mut valid[..n];
        valid.sort_unstable_by(f32::total_cmp);
        let (near, far, median) = (valid[0], valid[n - 1], valid[n / 2]);
        // Neighbours on one surface differ by its slope and the noise; more than that is an edge, where the depth of the
        // corner itself is a coin toss.
        (far - near <= 0.02 + 0.03 * median).then_some(f64::from(median))
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn flat(z: f32) -> DepthImage {
        DepthImage::from_vec(640, 480, vec![z; 640 * 480]).unwrap()
    }

    fn camera() -> Camera {
        Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5])
    }

    #[test]
    fn takes_back_motion_along_the_axis() {
        let (config, camera, image) = (SensorConfig::default(), camera(), flat(2.0));
        // The camera moves forward at 1 m/s: points come nearer by 10 mm in the 10 ms until the depth image.
        let velocity = Vec6::new(0.0, 0.0, -1.0, 0.0, 0.0, 0.0);
        let reader = DepthReader::new(&config, &camera, &image, Some(&velocity), 0.01);
        let px = Vec2::new(300.0, 200.0);
        let z = reader.read(px, px).unwrap().z;
        assert!((z - 2.01).abs() < 1e-4, "{z}");
    }

    #[test]
    fn refuses_edges_and_holes() {
        let (config, camera) = (SensorConfig::default(), camera());
        let mut data = vec![1.0f32; 640 * 480];
        for row in data.chunks_mut(640) {
            row[320..].fill(2.0);
            row[100..200].fill(0.0);
        }
        let image = DepthImage::from_vec(640, 480, data).unwrap();
        let reader = DepthReader::new(&config, &camera, &image, None, 0.0);
        let read = |x: f64| reader.read(Vec2::new(x, 100.0), Vec2::new(x, 100.0));
        assert_eq!(read(319.0), None);
        assert_eq!(read(150.0), None);
        assert_eq!(read(317.0).map(|d| d.z), Some(1.0));
        assert_eq!(read(0.0), None);
    }
}
