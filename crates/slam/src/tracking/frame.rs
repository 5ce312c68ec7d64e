//! Measures an RGB-D frame: keypoints, undistorted positions, depths and their noise.

use super::flow::FlowMemory;
use crate::recycle::refill_or;
use crate::sensor::{DepthPoint, DepthReader, DepthReading, LANES, SensorConfig};
use crate::shutter::{Shutter, TYPICAL_DEPTH};
use crate::static_filter::FeatureVerdict;
use crate::timing::Timing;
use std::sync::Arc;
use stillpoint_features::{
    FeatureGrid, Features, Flow, FlowConfig, Keypoint, OrbConfig, OrbExtractor,
};
use stillpoint_geometry::{Camera, Vec2, Vec6};
use stillpoint_imaging::{RgbdFrame, Simd, workers};
use stillpoint_map::KeyframeData;

/// Minimum number of features per thread: chosen, so that the work outweighs the cost of sharing it (decision 38).
const MEASURED_TOGETHER: usize = 250;

/// Extracts features and reads their depths, reusing buffers.
pub(super) struct Observer {
    pub(super) camera: Camera,
    sensor: SensorConfig,
    pub(super) extractor: OrbExtractor,
    pub(super) features: Features,
    pub(super) flow: Flow,
    /// Undistorted pixels of `features`, as exposed.
    pub(super) undistorted: Vec<Vec2>,
    /// Depths around their raw pixels in the depth image, m; 0 if none.
    depths: Vec<f32>,
    /// Standard deviation of a keypoint on each level, px.
    level_sigmas: Vec<f32>,
    bounds: [f32; 4],
    /// Indices of kept features, and their measurements.
    kept: Vec<usize>,
    levels: Vec<u8>,
    seen: Vec<Seen>,
    pub(super) flow_memory: FlowMemory,
    /// Recently returned data, whose memory is reused once released.
    handed_over: Vec<Arc<KeyframeData>>,
}

/// Maximum number of frames kept for reuse: no frame uses more at once. Measured: a steady frame allocates only memory
/// that leaves with its report (docs/scale.md).
const MOST_HANDED_OVER: usize = 6;

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
            kept: Vec::new(),
            levels: Vec::new(),
            seen: Vec::new(),
            flow_memory: FlowMemory::default(),
            handed_over: Vec::new(),
        }
    }

    pub(super) fn level_sigmas(&self) -> &[f32] {
        &self.level_sigmas
    }

    /// Bounds of undistorted pixels, `[min_x, min_y, max_x, max_y]`.
    pub(super) fn bounds(&self) -> [f32; 4] {
        self.bounds
    }

    /// Extracts the features of a frame, to which [`Self::measure`] refers until the next call.
    pub(super) fn extract(&mut self, frame: &RgbdFrame) {
        let _span = tracing::info_span!("extract").entered();
        self.extractor.extract(&frame.gray, &mut self.features);
        let keypoints = &self.features.keypoints;
        let reader = DepthReader::new(&self.sensor, &self.camera, &frame.depth, None, 0.0);
        let raw = |i: usize| raw_pixel(&keypoints[i]);
        self.undistorted.resize(keypoints.len(), Vec2::zeros());
        workers::fill(&mut self.undistorted, MEASURED_TOGETHER, |i| {
            self.camera.undistort(raw(i))
        });
        self.depths.resize(keypoints.len(), 0.0);
        workers::in_rows(&mut self.depths, 1, MEASURED_TOGETHER, |first, depths| {
            reader.depths_at(|i| raw(first + i), depths);
        });
    }

    /// Measures the extracted features at the frame's stamp, corrected by the camera velocity (twist per second) for
    /// rolling shutter and for a depth image taken `depth_lag` s after the colour image. With verdicts, dynamic
    /// features are omitted.
    pub(super) fn measure(
        &mut self,
        frame: &RgbdFrame,
        velocity: Option<&Vec6>,
        (timing, depth_lag): (&Timing, f64),
        verdicts: Option<&[FeatureVerdict]>,
    ) -> Arc<KeyframeData> {
        let _span = tracing::info_span!("depth").entered();
        self.kept.clear();
        let all = 0..self.features.keypoints.len();
        let is_kept = |i: &usize| verdicts.is_none_or(|v| !v[*i].dynamic);
        self.kept.reserve(all.len());
        self.kept.extend(all.filter(is_kept));
        let reader = DepthReader::new(
            &self.sensor,
            &self.camera,
            &frame.depth,
            velocity,
            depth_lag,
        );
        let shutter = Shutter::new(&self.camera, timing);
        let mut seen = std::mem::take(&mut self.seen);
        seen.resize(self.kept.len(), Seen::default());
        workers::in_rows(&mut seen, LANES, MEASURED_TOGETHER / LANES, |row, seen| {
            let features = &self.kept[row * LANES..][..seen.len()];
            for (features, seen) in features.chunks(LANES).zip(seen.chunks_mut(LANES)) {
                self.measure_some(features, (&reader, &shutter, velocity), seen);
            }
        });
        self.seen = seen;
        let level = |i: &usize| self.features.keypoints[*i].level;
        self.levels.clear();
        self.levels.extend(self.kept.iter().map(level));
        let free = |data: &Arc<KeyframeData>| Arc::strong_count(data) == 1;
        let spent = self.handed_over.iter().position(free);
        let spent = spent.map(|i| self.handed_over.remove(i));
        let data = refill_or(
            spent,
            || self.nothing(),
            |data| self.write(frame, verdicts, data),
        );
        if self.handed_over.len() >= MOST_HANDED_OVER {
            self.handed_over.remove(0);
        }
        self.handed_over.push(Arc::clone(&data));
        data
    }

    fn nothing(&self) -> KeyframeData {
        KeyframeData {
            stamp: 0.0,
            camera: self.camera,
            keypoints: Vec::new(),
            positions: Vec::new(),
            sigma_px: Vec::new(),
            depths: Vec::new(),
            depth_sigmas: Vec::new(),
            descriptors: Arc::default(),
            mappable: Vec::new(),
            grid: FeatureGrid::default(),
        }
    }

    fn write(
        &self,
        frame: &RgbdFrame,
        verdicts: Option<&[FeatureVerdict]>,
        data: &mut KeyframeData,
    ) {
        fn write<T>(values: impl Iterator<Item = T>, out: &mut Vec<T>) {
            out.clear();
            out.extend(values);
        }
        let (kept, seen, features) = (&self.kept, &self.seen, &self.features);
        data.stamp = frame.stamp;
        write(seen.iter().map(|s| s.position), &mut data.positions);
        write(seen.iter().map(|s| s.depth), &mut data.depths);
        write(seen.iter().map(|s| s.depth_sigma), &mut data.depth_sigmas);
        let keypoints = kept.iter().map(|i| features.keypoints[*i]);
        write(keypoints, &mut data.keypoints);
        let sigma = |k: &Keypoint| self.level_sigmas[usize::from(k.level)];
        write(data.keypoints.iter().map(sigma), &mut data.sigma_px);
        let descriptors = kept.iter().map(|i| features.descriptors[*i]);
        if Arc::get_mut(&mut data.descriptors).is_none() {
            // The place index still holds the descriptors.
            data.descriptors = Arc::default();
        }
        write(descriptors, Arc::make_mut(&mut data.descriptors));
        let may_map = |i: &usize| verdicts.is_none_or(|v| v[*i].may_map());
        write(kept.iter().map(may_map), &mut data.mappable);
        data.grid
            .rebuild(&data.positions, &self.levels, self.bounds);
    }

    /// Measures up to [`LANES`] features, whose depths are read together.
    fn measure_some(
        &self,
        features: &[usize],
        (reader, shutter, velocity): (&DepthReader<'_>, &Shutter<'_>, Option<&Vec6>),
        seen: &mut [Seen],
    ) {
        let of = |l: usize| features.get(l).copied();
        let points = std::array::from_fn(|l| {
            of(l).map(|i| DepthPoint {
                raw: raw_pixel(&self.features.keypoints[i]),
                undistorted: self.undistorted[i],
                here: self.depths[i],
            })
        });
        let readings = reader.read_all(&points);
        for ((point, reading), seen) in points.iter().flatten().zip(readings).zip(seen) {
            let exposed = (point.undistorted, point.raw.y);
            *seen = Seen::at_stamp(&self.camera, exposed, reading, shutter, velocity);
        }
    }

    /// Measures the features of `data` again with another velocity; all else is unchanged.
    pub(super) fn measure_again(
        &self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        velocity: &Vec6,
        (timing, depth_lag): (&Timing, f64),
    ) -> KeyframeData {
        let (camera, velocity) = (&self.camera, Some(velocity));
        let reader = DepthReader::new(&self.sensor, camera, &frame.depth, velocity, depth_lag);
        let shutter = Shutter::new(camera, timing);
        let mut again = data.copied();
        for (i, keypoint) in data.keypoints.iter().enumerate() {
            let raw = raw_pixel(keypoint);
            let exposed = camera.undistort(raw);
            let reading = reader.read(raw, exposed);
            let seen = Seen::at_stamp(camera, (exposed, raw.y), reading, &shutter, velocity);
            again.positions[i] = seen.position;
            again.depths[i] = seen.depth;
            again.depth_sigmas[i] = seen.depth_sigma;
        }
        let levels: Vec<u8> = data.keypoints.iter().map(|k| k.level).collect();
        again.grid.rebuild(&again.positions, &levels, self.bounds);
        again
    }
}

/// Measurement of a feature at the stamp of its frame.
#[derive(Clone, Default)]
struct Seen {
    /// Undistorted px.
    position: [f32; 2],
    /// m; 0 if none.
    depth: f32,
    /// Standard deviation, m.
    depth_sigma: f32,
}

impl Seen {
    /// Corrects an undistorted pixel of a raw row, with its depth reading, to the stamp.
    #[inline]
    fn at_stamp(
        camera: &Camera,
        (mut position, raw_y): (Vec2, f64),
        reading: Option<DepthReading>,
        shutter: &Shutter<'_>,
        velocity: Option<&Vec6>,
    ) -> Self {
        let mut z = reading.map_or(0.0, |r| r.z);
        if shutter.rolls() {
            let depth = reading.map_or(TYPICAL_DEPTH, |r| r.z);
            let there = shutter.at_stamp(position, raw_y, depth, velocity);
            position = camera.project(&there);
            z = reading.map_or(0.0, |_| there.z);
        }
        Self {
            position: [position.x as f32, position.y as f32],
            depth: z as f32,
            depth_sigma: reading.map_or(0.0, |r| r.sigma as f32),
        }
    }
}

fn raw_pixel(k: &Keypoint) -> Vec2 {
    Vec2::new(f64::from(k.x), f64::from(k.y))
}
