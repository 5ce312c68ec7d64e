//! Visibility of a point from the depth image: present, occluded, or gone.

use crate::sensor::DepthNoise;
use stillpoint_geometry::{Camera, Vec3};
use stillpoint_imaging::DepthImage;

/// Observation at a point's expected position.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Sight {
    /// No evidence against the point: a surface at its depth, an edge, or no depth.
    Open,
    /// Occluded.
    Hidden,
    /// The camera sees through its place: the point is gone.
    Through,
}

/// Spacing of the 3x3 sampled pixels, px: the expected position may be off by as much. Chosen: three standard
/// deviations of a keypoint of the finest level (equation 1 of docs/algorithm.md).
const STEP: i32 = 3;
/// Minimum number of the nine with depth: chosen, more than three quarters, so that two holes do not hinder it.
const MIN_VALID: u32 = 7;

/// Visibility test against one depth image.
pub(super) struct DepthSight<'a> {
    pub(super) camera: &'a Camera,
    pub(super) image: &'a DepthImage,
    pub(super) noise: DepthNoise,
}

impl DepthSight<'_> {
    /// Observation at a point in camera coordinates (m).
    pub(super) fn of(&self, p: &Vec3) -> Sight {
        let raw = self.camera.project_distorted(p);
        let (u, v) = (libm::round(raw.x) as i32, libm::round(raw.y) as i32);
        let (width, height) = (self.image.width() as i32, self.image.height() as i32);
        // No statement unless all nine pixels are in the image.
        if u < STEP || v < STEP || u + STEP >= width || v + STEP >= height {
            return Sight::Open;
        }
        let z = p.z as f32;
        let tolerance = 0.05 + 0.02 * z + 4.0 * self.noise.sigma_f32(z);
        let (mut valid, mut farther, mut nearer) = (0, 0, 0);
        for y in [v - STEP, v, v + STEP] {
            for x in [u - STEP, u, u + STEP] {
                let there = self.image.at(x as usize, y as usize);
                valid += u32::from(there > 0.0);
                farther += u32::from(there > z + tolerance);
                nearer += u32::from(there > 0.0 && there < z - tolerance);
            }
        }
        // All must agree, since near an edge some pixels see the background or foreground.
        if valid < MIN_VALID {
            Sight::Open
        } else if farther == valid {
            Sight::Through
        } else if nearer == valid {
            Sight::Hidden
        } else {
            Sight::Open
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::SensorConfig;

    fn sight(z_there: impl Fn(usize, usize) -> f32) -> Sight {
        sight_with(DepthNoise::default(), z_there)
    }

    fn sight_with(noise: DepthNoise, z_there: impl Fn(usize, usize) -> f32) -> Sight {
        let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
        let data = (0..48).flat_map(|y| (0..64).map(move |x| (x, y)));
        let data = data.map(|(x, y)| z_there(x, y)).collect();
        let image = DepthImage::from_vec(64, 48, data).unwrap();
        DepthSight {
            camera: &camera,
            image: &image,
            noise,
        }
        .of(&Vec3::new(0.0, 0.0, 2.0))
    }

    #[test]
    fn present_occluded_and_gone_are_distinguished() {
        assert_eq!(sight(|_, _| 2.05), Sight::Open);
        assert_eq!(sight(|_, _| 1.0), Sight::Hidden);
        assert_eq!(sight(|_, _| 3.0), Sight::Through);
    }

    #[test]
    fn noise_scale_widens_the_tolerance() {
        let noisy = SensorConfig {
            noise_scale: 10.0,
            ..SensorConfig::default()
        };
        assert_eq!(sight(|_, _| 2.2), Sight::Through);
        assert_eq!(sight_with(noisy.noise(), |_, _| 2.2), Sight::Open);
    }

    #[test]
    fn depth_edges_and_holes_are_not_judged() {
        assert_eq!(sight(|x, _| if x < 32 { 1.0 } else { 3.0 }), Sight::Open);
        assert_eq!(sight(|x, _| if x < 32 { 2.0 } else { 3.0 }), Sight::Open);
        assert_eq!(sight(|_, y| if y < 23 { 0.0 } else { 3.0 }), Sight::Open);
    }
}
