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
            calibration_error: 0.016,
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
    /// Range of depths that are used, m: the least and the largest single that is within the configured one.
    range: [f32; 2],
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
            range: [at_least(config.min_depth), -at_least(-config.max_depth)],
            depth_from_colour: motion.map(|m| Se3::exp(&m)),
            // A constant velocity misses about a third of the motion.
            motion_sigma: motion.map_or(0.0, |m| m.fixed_rows::<3>(0).norm() / 3.0),
        }
    }

    /// The depth at a keypoint: `raw` in the image as recorded, `undistorted` the same point without distortion.
    pub(crate) fn read(&self, raw: Vec2, undistorted: Vec2) -> Option<DepthReading> {
        let pixel = self.pixel(raw);
        let [here] = self.medians([pixel]);
        let place = self.place(pixel, undistorted, here)?;
        let there = match place.pixel {
            same if same == pixel => here,
            other => self.medians([other])[0],
        };
        self.reading(&place, there)
    }

    /// Robust depths around raw pixels, m; 0 where there is none.
    pub(crate) fn depths_at(&self, raw: impl Iterator<Item = Vec2>) -> Vec<f32> {
        let pixels: Vec<Option<Pixel>> = raw.map(|raw| self.pixel(raw)).collect();
        self.medians_of(&pixels)
    }

    /// The depths at keypoints, in one go: `raw` in the image as recorded, `undistorted` the same points without distortion, `here` what
    /// [`Self::depths_at`] tells of the raw ones.
    pub(crate) fn read_all(
        &self,
        raw: &[Vec2],
        undistorted: &[Vec2],
        here: &[f32],
    ) -> Vec<Option<DepthReading>> {
        let place = |((raw, undistorted), here): ((&Vec2, &Vec2), &f32)| {
            self.place(self.pixel(*raw), *undistorted, *here)
        };
        let points = raw.iter().zip(undistorted).zip(here);
        let places: Vec<Option<Place>> = points.map(place).collect();
        if self.depth_from_colour.is_none() {
            let same = places.iter().zip(here);
            return same.map(|(p, z)| self.reading(p.as_ref()?, *z)).collect();
        }
        let pixel = |p: &Option<Place>| p.as_ref().and_then(|p| p.pixel);
        let pixels: Vec<Option<Pixel>> = places.iter().map(pixel).collect();
        let there = places.iter().zip(self.medians_of(&pixels));
        there.map(|(p, z)| self.reading(p.as_ref()?, z)).collect()
    }

    /// Where in the depth image the point at a pixel is looked for, when its depth there is `here`.
    ///
    /// The depth image was taken from another pose: the point appears elsewhere in it, and the motion along the axis is taken back.
    /// One step from the depth at the keypoint itself is enough for motions of a few millimetres.
    #[inline]
    fn place(&self, pixel: Option<Pixel>, undistorted: Vec2, here: f32) -> Option<Place> {
        if here <= 0.0 {
            return None;
        }
        let Some(motion) = &self.depth_from_colour else {
            return Some(Place { pixel, nearer: 0.0 });
        };
        let guess = f64::from(here);
        let seen = motion.transform(&self.camera.backproject(undistorted, guess));
        (seen.z > 0.0).then(|| Place {
            pixel: self.pixel(self.camera.project_distorted(&seen)),
            nearer: seen.z - guess,
        })
    }

    /// What is read at a place where the depth image has the depth `there`, 0 for none.
    #[inline]
    fn reading(&self, place: &Place, there: f32) -> Option<DepthReading> {
        let z = f64::from(there) - place.nearer;
        if there <= 0.0 || z <= 0.0 {
            return None;
        }
        let sensor = self.config.noise().sigma(z);
        let calibration = self.config.calibration_error * z;
        let sigma =
            (sensor * sensor + calibration * calibration + self.motion_sigma * self.motion_sigma)
                .sqrt();
        Some(DepthReading { z, sigma })
    }

    /// The pixel at a raw position, when its neighbours are in the image.
    #[inline]
    fn pixel(&self, raw: Vec2) -> Option<Pixel> {
        let (x, y) = (libm::round(raw.x), libm::round(raw.y));
        let (w, h) = (self.image.width() as f64, self.image.height() as f64);
        let inside = x >= 1.0 && y >= 1.0 && x < w - 1.0 && y < h - 1.0;
        inside.then_some([x as usize, y as usize])
    }

    fn medians_of(&self, pixels: &[Option<Pixel>]) -> Vec<f32> {
        let mut found = Vec::with_capacity(pixels.len());
        for pixels in pixels.chunks(LANES) {
            let lanes = std::array::from_fn(|l| pixels.get(l).copied().flatten());
            let medians: [f32; LANES] = self.medians(lanes);
            found.extend_from_slice(&medians[..pixels.len()]);
        }
        found
    }

    /// A robust depth around each pixel: the median of the valid depths in 3x3, when they are of one surface; else 0.
    #[inline(always)]
    fn medians<const L: usize>(&self, pixels: [Option<Pixel>; L]) -> [f32; L] {
        // Side by side, so that they are sorted in vectors.
        let mut depths = [[f32::INFINITY; L]; 9];
        for (l, pixel) in pixels.iter().enumerate() {
            let Some([x, y]) = pixel else { continue };
            for (k, row) in (y - 1..=y + 1).enumerate() {
                let start = row * self.image.width() + x - 1;
                let three = &self.image.data()[start..start + 3];
                for (i, z) in three.iter().enumerate() {
                    depths[3 * k + i][l] = *z;
                }
            }
        }
        let [min, max] = self.range;
        let mut count = [0.0_f32; L];
        for depth in &mut depths {
            let z = *depth;
            let is_valid: [bool; L] = std::array::from_fn(|l| (z[l] >= min) & (z[l] <= max));
            *depth = std::array::from_fn(|l| if is_valid[l] { z[l] } else { f32::INFINITY });
            count = std::array::from_fn(|l| count[l] + if is_valid[l] { 1.0 } else { 0.0 });
        }
        sort_nine(&mut depths);
        std::array::from_fn(|l| {
            let n = count[l] as usize;
            if n < 5 {
                return 0.0;
            }
            let (near, far, median) = (depths[0][l], depths[n - 1][l], depths[n / 2][l]);
            // Neighbours on one surface differ by its slope and the noise; more than that is an edge, where the depth of the
            // corner itself is a coin toss.
            if far - near <= 0.02 + 0.03 * median {
                median
            } else {
                0.0
            }
        })
    }
}

/// Column and row of a pixel whose neighbours are in the image.
type Pixel = [usize; 2];

/// Pixels whose depths are read together.
const LANES: usize = 4;

/// Where in the depth image a point is looked for.
struct Place {
    /// None outside the image.
    pixel: Option<Pixel>,
    /// How much nearer the point is from where the colour image was taken, m, with a minus sign.
    nearer: f64,
}

/// The least single that is not below a number.
fn at_least(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x {
        near.next_up()
    } else {
        near
    }
}

/// Sorts nine numbers of every lane by a network of 25 comparisons, whose outcomes no branch has to be predicted for.
#[inline(always)]
fn sort_nine<const L: usize>(v: &mut [[f32; L]; 9]) {
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
    for (i, j) in NETWORK {
        let (a, b) = (v[i], v[j]);
        v[i] = std::array::from_fn(|l| if b[l] < a[l] { b[l] } else { a[l] });
        v[j] = std::array::from_fn(|l| if a[l] < b[l] { b[l] } else { a[l] });
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
            let bit = |i: usize| f32::from(bits >> i & 1);
            let mut v: [[f32; 2]; 9] = std::array::from_fn(|i| [bit(i), 1.0 - bit(i)]);
            sort_nine(&mut v);
            for (lane, ones) in [bits.count_ones(), 9 - bits.count_ones()]
                .iter()
                .enumerate()
            {
                let v = v.map(|v| v[lane]);
                assert!(v.is_sorted(), "{bits}: {v:?}");
                assert_eq!(v.iter().sum::<f32>() as u32, *ones);
            }
        }
    }

    #[test]
    fn many_depths_are_those_read_one_by_one() {
        let config = SensorConfig {
            min_depth: 1.1,
            max_depth: 3.3,
            ..SensorConfig::default()
        };
        // A floor that falls away, with holes, and steps every 37 columns.
        let depth = |i: usize| match (i % 640, i / 640) {
            (x, y) if (x * y) % 11 == 0 => 0.0,
            (x, y) => 1.0 + 0.005 * y as f32 + (x / 37 % 2) as f32 * 0.4,
        };
        let image = DepthImage::from_vec(640, 480, (0..640 * 480).map(depth).collect()).unwrap();
        let camera = camera();
        let velocity = Vec6::new(0.1, 0.0, -1.0, 0.0, 0.9, 0.0);
        let points: Vec<Vec2> = (0..2003_u32)
            .map(|i| {
                Vec2::new(
                    f64::from(i * 37 % 6400) * 0.1,
                    f64::from(i * 53 % 4800) * 0.1,
                )
            })
            .collect();
        for dt in [0.0, 0.012] {
            let reader = DepthReader::new(&config, &camera, &image, Some(&velocity), dt);
            let here = reader.depths_at(points.iter().copied());
            let all = reader.read_all(&points, &points, &here);
            let one = |p: &Vec2| reader.read(*p, *p);
            assert_eq!(all, points.iter().map(one).collect::<Vec<_>>());
            let count = all.iter().flatten().count();
            assert!((500..1900).contains(&count), "{count}");
            assert!(here.iter().all(|z| *z == 0.0 || (1.1..=3.3).contains(z)));
        }
    }

    #[test]
    fn the_range_is_that_of_the_configuration_exactly() {
        for x in [0.3, 0.1, 8.0, -8.0, 0.7, 3.3] {
            let single = at_least(x);
            assert!(f64::from(single) >= x && f64::from(single.next_down()) < x);
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
