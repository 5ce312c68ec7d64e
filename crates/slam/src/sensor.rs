//! The depth sensor: its range, its noise, and the depth of a keypoint.

use crate::timing::Timing;
use crate::validation::Checker;
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
    /// Points nearer than this hold the camera's translation best, m: how many of them are tracked and shared decides about keyframes. Range: 0.1 to 100. 40 baselines of 7.5 cm. Landmarks are made at any depth.
    pub close_depth: f64,
    /// Factor on the sensor's own noise `0.0012 + 0.0019 (z - 0.4)^2` m (Nguyen, Izadi, Lovell, 3DIMPVT 2012). Range:
    /// 0.1 to 100.
    pub noise_scale: f64,
    /// Share of the depth that calibration may be wrong by, added to the noise in quadrature. Range: 0 to 0.2. It stands for all that errs alike in neighbouring pixels, too, which many of them do not average out.
    pub calibration_error: f64,
    /// Time from the exposure of the colour image's first row to its last, s; 0 for a global shutter. Range: 0 to 0.1.
    /// With `self_calibrate` this is where the estimate starts.
    pub readout: f64,
    /// Standard deviation of `readout`, s, where `self_calibrate` starts from it. Range: 0.00001 to 0.1. Of a camera that nothing is known of 0.02: rolling
    /// shutters take up to a frame's 33 ms.
    pub readout_sigma: f64,
    /// Age of a depth image at its stamp, s, beyond that of a colour image. Range: -0.1 to 0.1.
    pub depth_delay: f64,
    /// Estimates `readout` while tracking. Range: true or false. Few cameras state it, and on a rolling shutter it costs
    /// more accuracy than everything else.
    pub self_calibrate: bool,
}

impl Default for SensorConfig {
    fn default() -> Self {
        // What is close is so after ORB-SLAM2 (Mur-Artal, Tardos 2017), whose settings for the TUM cameras say 40 baselines.
        Self {
            min_depth: 0.3,
            max_depth: 8.0,
            close_depth: 3.0,
            noise_scale: 1.0,
            calibration_error: 0.014,
            readout: 0.0,
            readout_sigma: 0.02,
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
        c.range("readout_sigma", self.readout_sigma, 1e-5, 0.1);
        c.range("depth_delay", self.depth_delay, -0.1, 0.1);
    }
}

impl SensorConfig {
    /// The timing that the configuration states.
    pub(crate) fn timing(&self) -> Timing {
        Timing {
            readout: self.readout,
            readout_sigma: if self.self_calibrate {
                self.readout_sigma
            } else {
                0.0
            },
            depth_delay: self.depth_delay,
        }
    }
}

/// The depth sensor's own noise, without calibration: `scale (0.0012 + 0.0019 (z - 0.4)^2)` m (Nguyen, Izadi, Lovell, 3DIMPVT 2012).
/// All that asks whether two depths can be of one surface asks this one.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct DepthNoise {
    scale: f64,
}

/// Noise of a Kinect at the distance where it is least, m ...
const LEAST_SIGMA: f64 = 0.0012;
/// ... which is this, m ...
const LEAST_AT: f64 = 0.4;
/// ... and its growth beyond, 1/m.
const SIGMA_GROWTH: f64 = 0.0019;

impl Default for DepthNoise {
    /// That of a Kinect.
    fn default() -> Self {
        Self { scale: 1.0 }
    }
}

impl DepthNoise {
    /// Standard deviation at a depth `z`, m.
    #[must_use]
    pub fn sigma(self, z: f64) -> f64 {
        self.scale * (LEAST_SIGMA + SIGMA_GROWTH * (z - LEAST_AT) * (z - LEAST_AT))
    }

    /// The same in single precision, for what is asked of every cell of the image.
    #[must_use]
    #[inline]
    pub fn sigma_f32(self, z: f32) -> f32 {
        let beyond = z - LEAST_AT as f32;
        self.scale as f32 * (LEAST_SIGMA as f32 + SIGMA_GROWTH as f32 * beyond * beyond)
    }
}

impl SensorConfig {
    /// The sensor's own noise.
    #[must_use]
    pub fn noise(&self) -> DepthNoise {
        DepthNoise {
            scale: self.noise_scale,
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
            None => self.local(self.pixel(raw)?)?,
            Some(motion) => self.compensated(raw, undistorted, motion)?,
        };
        let sensor = self.config.noise().sigma(z);
        let calibration = self.config.calibration_error * z;
        let sigma =
            (sensor * sensor + calibration * calibration + self.motion_sigma * self.motion_sigma)
                .sqrt();
        Some(DepthReading { z, sigma })
    }

    /// The depth image was taken from another pose: looks where the point appears in it, and takes back the motion along
    /// the axis. One step from the depth at the keypoint itself is enough for motions of a few millimetres.
    fn compensated(&self, raw: Vec2, undistorted: Vec2, motion: &Se3) -> Option<f64> {
        let pixel = self.pixel(raw)?;
        let guess = self.local(pixel)?;
        let seen = motion.transform(&self.camera.backproject(undistorted, guess));
        if seen.z <= 0.0 {
            return None;
        }
        // Often the same pixel, whose depth is known.
        let there = match self.pixel(self.camera.project_distorted(&seen))? {
            same if same == pixel => guess,
            other => self.local(other)?,
        };
        let z = there - (seen.z - guess);
        (z > 0.0).then_some(z)
    }

    /// The pixel at a raw position, when its neighbours are in the image.
    fn pixel(&self, raw: Vec2) -> Option<(usize, usize)> {
        let (x, y) = (libm::round(raw.x), libm::round(raw.y));
        let (w, h) = (self.image.width() as f64, self.image.height() as f64);
        let inside = x >= 1.0 && y >= 1.0 && x < w - 1.0 && y < h - 1.0;
        inside.then_some((x as usize, y as usize))
    }

    /// A robust depth around a pixel: the median of the valid depths in 3x3, when they are of one surface.
    fn local(&self, (x, y): (usize, usize)) -> Option<f64> {
        let (min, max) = (self.config.min_depth, self.config.max_depth);
        let mut depths = [f32::INFINITY; 9];
        let mut n = 0;
        for (k, row) in (y - 1..=y + 1).enumerate() {
            let start = row * self.image.width() + x - 1;
            let three = &self.image.data()[start..start + 3];
            for (i, z) in three.iter().enumerate() {
                let valid = (f64::from(*z) >= min) & (f64::from(*z) <= max);
                depths[3 * k + i] = if valid { *z } else { f32::INFINITY };
                n += usize::from(valid);
            }
        }
        if n < 5 {
            return None;
        }
        sort_nine(&mut depths);
        let (near, far, median) = (depths[0], depths[n - 1], depths[n / 2]);
        // Neighbours on one surface differ by its slope and the noise; more than that is an edge, where the depth of the
        // corner itself is a coin toss.
        (far - near <= 0.02 + 0.03 * median).then_some(f64::from(median))
    }
}

/// Sorts nine numbers by a network of 25 comparisons, whose outcomes no branch has to be predicted for.
#[inline]
fn sort_nine(v: &mut [f32; 9]) {
    const NETWORK: [(usize, usize); 25] = [
        (0, 3),
        (1, 7),
        (2, 5),
        (4, 8),
        (0, 7),
        (2, 4),
        (3, 8),
        (5, 6),
        (0, 2),
        (1, 3),
        (4, 5),
        (7, 8),
        (1, 4),
        (3, 6),
        (5, 7),
        (0, 1),
        (2, 4),
        (3, 5),
        (6, 8),
        (2, 3),
        (4, 5),
        (6, 7),
        (1, 2),
        (3, 4),
        (5, 6),
    ];
    for (a, b) in NETWORK {
        let (low, high) = (v[a], v[b]);
        (v[a], v[b]) = if high < low { (high, low) } else { (low, high) };
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
    fn both_precisions_are_one_noise() {
        let noise = SensorConfig {
            noise_scale: 3.0,
            ..SensorConfig::default()
        }
        .noise();
        for i in 3..80 {
            let z = 0.1 * f64::from(i);
            let kinect = 0.0012 + 0.0019 * (z - 0.4) * (z - 0.4);
            assert!((noise.sigma(z) - 3.0 * kinect).abs() < 1e-12);
            let single = f64::from(noise.sigma_f32(z as f32));
            assert!((single / noise.sigma(z) - 1.0).abs() < 1e-5);
        }
        assert!((DepthNoise::default().sigma(0.4) - 0.0012).abs() < 1e-12);
    }

    #[test]
    fn the_scale_reaches_the_reader() {
        let (camera, image) = (camera(), flat(2.0));
        let sigma = |noise_scale| {
            let config = SensorConfig {
                noise_scale,
                calibration_error: 0.0,
                ..SensorConfig::default()
            };
            let px = Vec2::new(300.0, 200.0);
            let reader = DepthReader::new(&config, &camera, &image, None, 0.0);
            reader.read(px, px).unwrap().sigma
        };
        assert!((sigma(5.0) / sigma(1.0) - 5.0).abs() < 1e-9);
    }

    /// A network that sorts all arrays of zeros and ones sorts everything (Knuth, The Art of Computer Programming 3, 5.3.4).
    #[test]
    fn nine_numbers_are_sorted() {
        for bits in 0_u16..512 {
            let mut v: [f32; 9] = std::array::from_fn(|i| f32::from(bits >> i & 1));
            sort_nine(&mut v);
            assert!(v.is_sorted(), "{bits}: {v:?}");
            assert_eq!(v.iter().sum::<f32>() as u32, bits.count_ones());
        }
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
