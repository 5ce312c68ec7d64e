//! Reads the depths of keypoints from a depth image.

use super::SensorConfig;
use stillpoint_geometry::{Camera, Se3, Vec2, Vec6};
use stillpoint_imaging::DepthImage;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct DepthReading {
    /// Depth along the optical axis, m.
    pub(crate) z: f64,
    /// Standard deviation, m.
    pub(crate) sigma: f64,
}

pub(crate) struct DepthReader<'a> {
    config: &'a SensorConfig,
    camera: &'a Camera,
    image: &'a DepthImage,
    /// Range of depths that are used, m: the smallest and largest `f32` within the configured range.
    range: [f32; 2],
    /// Motion from the camera at the colour stamp to the camera at the exposure of the depth image; `None` if unknown.
    depth_from_colour: Option<Se3>,
    /// Standard deviation along the ray of the uncompensated motion between the two, m.
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

    /// Depth at a keypoint with pixel `raw` in the recorded image and `undistorted` without distortion.
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

    /// Robust depths around raw pixels, m; 0 if invalid.
    pub(crate) fn depths_at(&self, raw: impl Fn(usize) -> Vec2, depths: &mut [f32]) {
        for (chunk, depths) in depths.chunks_mut(LANES).enumerate() {
            let pixel = |l: usize| self.pixel(raw(chunk * LANES + l));
            let lanes = std::array::from_fn(|l| (l < depths.len()).then(|| pixel(l)).flatten());
            let medians: [f32; LANES] = self.medians(lanes);
            depths.copy_from_slice(&medians[..depths.len()]);
        }
    }

    pub(crate) fn read_all(
        &self,
        points: &[Option<DepthPoint>; LANES],
    ) -> [Option<DepthReading>; LANES] {
        let place = |p: &DepthPoint| self.place(self.pixel(p.raw), p.undistorted, p.here);
        let places = points.each_ref().map(|p| p.as_ref().and_then(place));
        let there: [f32; LANES] = if self.depth_from_colour.is_none() {
            points
                .each_ref()
                .map(|p| p.as_ref().map_or(0.0, |p| p.here))
        } else {
            self.medians(places.each_ref().map(|p| p.as_ref()?.pixel))
        };
        std::array::from_fn(|l| self.reading(places[l].as_ref()?, there[l]))
    }

    /// Position in the depth image of the point at a pixel with depth `here`.
    ///
    /// The depth image was taken from another pose: the point is displaced in it, and its depth differs by the motion
    /// along the axis. One step from the depth at the keypoint suffices for motions of a few millimetres.
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

    /// The reading for depth `there` in the depth image, 0 if invalid.
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

    /// The pixel at a raw position, if its neighbours are in the image.
    #[inline]
    fn pixel(&self, raw: Vec2) -> Option<Pixel> {
        let (x, y) = (libm::round(raw.x), libm::round(raw.y));
        let (w, h) = (self.image.width() as f64, self.image.height() as f64);
        let inside = x >= 1.0 && y >= 1.0 && x < w - 1.0 && y < h - 1.0;
        inside.then_some([x as usize, y as usize])
    }

    /// Robust depth around each pixel: the median of the valid depths in 3x3 if they belong to one surface; else 0.
    #[inline(always)]
    fn medians<const L: usize>(&self, pixels: [Option<Pixel>; L]) -> [f32; L] {
        // In lanes, so that sorting is vectorised.
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
            // On one surface neighbours differ by slope and noise; a larger spread is an edge, where the corner's depth
            // is ambiguous.
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

/// Number of pixels whose depths are read together: four numbers of single precision fill a vector register of 128
/// bits.
pub(crate) const LANES: usize = 4;

#[derive(Clone, Copy)]
pub(crate) struct DepthPoint {
    /// In the recorded image, px.
    pub(crate) raw: Vec2,
    /// The same point without distortion.
    pub(crate) undistorted: Vec2,
    /// Depth at `raw` from [`DepthReader::depths_at`], m.
    pub(crate) here: f32,
}

struct Place {
    /// `None` outside the image.
    pixel: Option<Pixel>,
    /// Depth in the depth image less depth in the colour image, m.
    nearer: f64,
}

/// The smallest `f32` that is not below a number.
fn at_least(x: f64) -> f32 {
    let near = x as f32;
    if f64::from(near) < x {
        near.next_up()
    } else {
        near
    }
}

/// Sorts nine numbers per lane with a branchless network of 25 comparisons.
#[inline(always)]
fn sort_nine<const L: usize>(v: &mut [[f32; L]; 9]) {
    /// Pairs to compare and swap, in order. Nine numbers need at least 25 comparisons (Codish, Cruz-Filipe, Frank,
    /// Schneider-Kamp, ICTAI 2014).
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
    use crate::sensor::DepthNoise;

    fn flat(z: f32) -> DepthImage {
        DepthImage::from_vec(640, 480, vec![z; 640 * 480]).unwrap()
    }

    fn camera() -> Camera {
        Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5])
    }

    #[test]
    fn depth_is_corrected_for_motion_along_the_axis() {
        let (config, camera, image) = (SensorConfig::default(), camera(), flat(2.0));
        // The camera moves forward at 1 m/s: points come nearer by 10 mm in the 10 ms until the depth image.
        let velocity = Vec6::new(0.0, 0.0, -1.0, 0.0, 0.0, 0.0);
        let reader = DepthReader::new(&config, &camera, &image, Some(&velocity), 0.01);
        let px = Vec2::new(300.0, 200.0);
        let z = reader.read(px, px).unwrap().z;
        assert!((z - 2.01).abs() < 1e-4, "{z}");
    }

    #[test]
    fn single_and_double_precision_noise_agree() {
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
    fn noise_scale_applies_to_the_reader() {
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

    /// A network that sorts all arrays of zeros and ones sorts everything (Knuth, The Art of Computer Programming 3,
    /// 5.3.4).
    #[test]
    fn sorting_network_sorts_nine_values() {
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
    fn batch_reading_equals_single_reading() {
        let config = SensorConfig {
            min_depth: 1.1,
            max_depth: 3.3,
            ..SensorConfig::default()
        };
        // A receding floor with holes, and steps every 37 columns.
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
            let mut here = vec![0.0; points.len()];
            reader.depths_at(|i| points[i], &mut here);
            let point = |i: usize| DepthPoint {
                raw: points[i],
                undistorted: points[i],
                here: here[i],
            };
            let known = |i: usize| (i < points.len()).then(|| point(i));
            let all = (0..points.len()).step_by(LANES);
            let all = all.flat_map(|i| reader.read_all(&std::array::from_fn(|l| known(i + l))));
            let all: Vec<_> = all.take(points.len()).collect();
            let one = |p: &Vec2| reader.read(*p, *p);
            assert_eq!(all, points.iter().map(one).collect::<Vec<_>>());
            let count = all.iter().flatten().count();
            assert!((500..1900).contains(&count), "{count}");
            assert!(here.iter().all(|z| *z == 0.0 || (1.1..=3.3).contains(z)));
        }
    }

    #[test]
    fn depth_range_is_rounded_exactly_to_f32() {
        for x in [0.3, 0.1, 8.0, -8.0, 0.7, 3.3] {
            let single = at_least(x);
            assert!(f64::from(single) >= x && f64::from(single.next_down()) < x);
        }
    }

    #[test]
    fn depth_edges_and_holes_are_refused() {
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
