//! From an RGB-D frame to what it saw: keypoints, undistorted positions, depths and their noise.

use crate::sensor::{DepthReader, SensorConfig};
use std::sync::Arc;
use stillpoint_features::{FeatureGrid, Features, OrbConfig, OrbExtractor};
use stillpoint_geometry::{Camera, Vec2, Vec6};
use stillpoint_imaging::{RgbdFrame, Simd};
use stillpoint_map::KeyframeData;

/// Extracts features and reads their depths; keeps its buffers between frames.
pub(super) struct Observer {
    camera: Camera,
    sensor: SensorConfig,
    extractor: OrbExtractor,
    features: Features,
    /// Standard deviation of a keypoint on each level, px.
    level_sigmas: Vec<f32>,
    bounds: [f32; 4],
}

impl Observer {
    pub(super) fn new(camera: Camera, sensor: SensorConfig, orb: &OrbConfig, simd: Simd) -> Self {
        let mut level_sigmas = Vec::with_capacity(orb.levels);
        let mut sigma = 1.0;
        for _ in 0..orb.levels {
            level_sigmas.push(sigma);
            sigma *= orb.scale_factor;
        }
        Self {
            camera,
            sensor,
            extractor: OrbExtractor::new(orb, simd),
            features: Features::default(),
            level_sigmas,
            bounds: camera.undistorted_bounds().map(|b| b as f32),
        }
    }

    /// Standard deviation of a keypoint on each level, px.
    pub(super) fn level_sigmas(&self) -> &[f32] {
        &self.level_sigmas
    }

    /// Bounds of undistorted pixels, `[min_x, min_y, max_x, max_y]`.
    pub(super) fn bounds(&self) -> [f32; 4] {
        self.bounds
    }

    /// What `frame` saw, with depths brought to the time of the colour image by `velocity` (twist per second).
    pub(super) fn observe(
        &mut self,
        frame: &RgbdFrame,
        velocity: Option<&Vec6>,
    ) -> Arc<KeyframeData> {
        {
            let _span = tracing::info_span!("extract").entered();
            self.extractor.extract(&frame.gray, &mut self.features);
        }
        let _span = tracing::info_span!("depth").entered();
        let keypoints = self.features.keypoints.clone();
        let n = keypoints.len();
        let mut positions = Vec::with_capacity(n);
        let mut sigma_px = Vec::with_capacity(n);
        let mut depths = Vec::with_capacity(n);
        let mut depth_sigmas = Vec::with_capacity(n);
        let mut levels = Vec::with_capacity(n);
        let reader = DepthReader::new(
            &self.sensor,
            &self.camera,
            &frame.depth,
            velocity,
            frame.depth_stamp - frame.stamp,
        );
        for k in &keypoints {
            let raw = Vec2::new(f64::from(k.x), f64::from(k.y));
            let undistorted = self.camera.undistort(raw);
            let reading = reader.read(raw, undistorted);
            positions.push([undistorted.x as f32, undistorted.y as f32]);
            sigma_px.push(self.level_sigmas[usize::from(k.level)]);
            depths.push(reading.map_or(0.0, |r| r.z));
            depth_sigmas.push(reading.map_or(0.0, |r| r.sigma));
            levels.push(k.level);
        }
        let grid = FeatureGrid::build(&positions, &levels, self.bounds);
        Arc::new(KeyframeData {
            stamp: frame.stamp,
            camera: self.camera,
            keypoints,
            positions,
            sigma_px,
            depths,
            depth_sigmas,
            descriptors: self.features.descriptors.clone(),
            grid,
        })
    }
}
