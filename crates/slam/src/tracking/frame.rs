//! From an RGB-D frame to what it saw: keypoints, undistorted positions, depths and their noise.

use super::shutter::{Shutter, TYPICAL_DEPTH};
use crate::sensor::{DepthReader, DepthReading, SensorConfig};
use crate::static_filter::FeatureVerdict;
use crate::timing::Timing;
use std::sync::Arc;
use stillpoint_features::{
    FeatureGrid, Features, Flow, FlowConfig, Keypoint, OrbConfig, OrbExtractor,
};
use stillpoint_geometry::{Camera, Vec2, Vec6};
use stillpoint_imaging::{RgbdFrame, Simd, workers};
use stillpoint_map::KeyframeData;

/// Features that are measured together, at least.
const MEASURED_TOGETHER: usize = 250;

/// Extracts features and reads their depths; keeps its buffers between frames.
pub(super) struct Observer {
    pub(super) camera: Camera,
    sensor: SensorConfig,
    pub(super) extractor: OrbExtractor,
    pub(super) features: Features,
    pub(super) flow: Flow,
    /// Undistorted pixels of `features`, as exposed row by row.
    pub(super) undistorted: Vec<Vec2>,
    /// Depths around their raw pixels in the depth image, m; 0 where there is none.
    depths: Vec<f32>,
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
            flow: Flow::new(FlowConfig::default(), simd),
            undistorted: Vec::new(),
            depths: Vec::new(),
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

    /// Extracts the features of a frame; [`Self::measure`] speaks of these until the next call.
    pub(super) fn extract(&mut self, frame: &RgbdFrame) {
        let _span = tracing::info_span!("extract").entered();
        self.extractor.extract(&frame.gray, &mut self.features);
        let keypoints = &self.features.keypoints;
        let reader = DepthReader::new(&self.sensor, &self.camera, &frame.depth, None, 0.0);
        let parts = workers::in_parts(0..keypoints.len(), MEASURED_TOGETHER, |part| {
            let raw = || keypoints[part.clone()].iter().map(raw_pixel);
            let undistorted = raw().map(|raw| self.camera.undistort(raw));
            (undistorted.collect::<Vec<_>>(), reader.depths_at(raw()))
        });
        self.undistorted.clear();
        self.depths.clear();
        for (undistorted, depths) in parts {
            self.undistorted.extend(undistorted);
            self.depths.extend(depths);
        }
    }

    /// What the frame saw, whose depth image was taken `depth_lag` s after its colour image, brought to the time of its stamp by the camera's
    /// velocity (twist per second): all of it, or without the features whose verdict is dynamic.
    pub(super) fn measure(
        &self,
        frame: &RgbdFrame,
        velocity: Option<&Vec6>,
        timing: &Timing,
        depth_lag: f64,
        verdicts: Option<&[FeatureVerdict]>,
    ) -> Arc<KeyframeData> {
        let _span = tracing::info_span!("depth").entered();
        let all = self.features.keypoints.len();
        let is_kept = |i: &usize| verdicts.is_none_or(|v| !v[*i].dynamic);
        let kept: Vec<usize> = (0..all).filter(is_kept).collect();
        let n = kept.len();
        let reader = DepthReader::new(
            &self.sensor,
            &self.camera,
            &frame.depth,
            velocity,
            depth_lag,
        );
        let shutter = Shutter::new(&self.camera, timing);
        let parts = workers::in_parts(0..kept.len(), MEASURED_TOGETHER, |part| {
            self.measure_some(&kept[part], &reader, &shutter, velocity)
        });
        let mut positions = Vec::with_capacity(n);
        let (mut depths, mut depth_sigmas) = (Vec::with_capacity(n), Vec::with_capacity(n));
        for seen in parts.into_iter().flatten() {
            positions.push(seen.position);
            depths.push(seen.depth);
            depth_sigmas.push(seen.depth_sigma);
        }
        let features = &self.features;
        let keypoints: Vec<Keypoint> = kept.iter().map(|i| features.keypoints[*i]).collect();
        let levels: Vec<u8> = keypoints.iter().map(|k| k.level).collect();
        let sigma = |level: &u8| self.level_sigmas[usize::from(*level)];
        let sigma_px = levels.iter().map(sigma).collect();
        let descriptors = kept.iter().map(|i| features.descriptors[*i]).collect();
        let may_map = |i: &usize| verdicts.is_none_or(|v| v[*i].may_map());
        let mappable = kept.iter().map(may_map).collect();
        let grid = FeatureGrid::build(&positions, &levels, self.bounds);
        Arc::new(KeyframeData {
            stamp: frame.stamp,
            camera: self.camera,
            keypoints,
            positions,
            sigma_px,
            depths,
            depth_sigmas,
            descriptors,
            mappable,
            grid,
        })
    }
}

impl Observer {
    /// What was seen of some of the features.
    fn measure_some(
        &self,
        features: &[usize],
        reader: &DepthReader<'_>,
        shutter: &Shutter<'_>,
        velocity: Option<&Vec6>,
    ) -> Vec<Seen> {
        let raw_pixel = |i: &usize| raw_pixel(&self.features.keypoints[*i]);
        let raw: Vec<Vec2> = features.iter().map(raw_pixel).collect();
        let undistorted: Vec<Vec2> = features.iter().map(|i| self.undistorted[*i]).collect();
        let here: Vec<f32> = features.iter().map(|i| self.depths[*i]).collect();
        let readings = reader.read_all(&raw, &undistorted, &here);
        let seen = |((raw, undistorted), reading): ((&Vec2, &Vec2), Option<DepthReading>)| {
            let (mut position, mut z) = (*undistorted, reading.map_or(0.0, |r| r.z));
            if shutter.rolls() {
                let depth = reading.map_or(TYPICAL_DEPTH, |r| r.z);
                let there = shutter.at_stamp(position, raw.y, depth, velocity);
                position = self.camera.project(&there);
                z = reading.map_or(0.0, |_| there.z);
            }
            Seen {
                position: [position.x as f32, position.y as f32],
                depth: z as f32,
                depth_sigma: reading.map_or(0.0, |r| r.sigma as f32),
            }
        };
        raw.iter()
            .zip(&undistorted)
            .zip(readings)
            .map(seen)
            .collect()
    }
}

/// What was seen of a feature, brought to the stamp of its frame.
struct Seen {
    /// Undistorted px.
    position: [f32; 2],
    /// m; 0 where there is none.
    depth: f32,
    /// Its standard deviation, m.
    depth_sigma: f32,
}

/// Where a keypoint is in the image as recorded, px.
fn raw_pixel(k: &Keypoint) -> Vec2 {
    Vec2::new(f64::from(k.x), f64::from(k.y))
}
