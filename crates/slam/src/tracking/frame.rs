//! Measures an RGB-D frame: keypoints, undistorted positions, depths and their noise.

use super::flow_search::{FlowImages, FlowSearch};
use crate::recycle::{self, refill_or};
use crate::sensor::{DepthPoint, DepthReader, DepthReading, LANES, SensorConfig};
use crate::shutter::{Shutter, TYPICAL_DEPTH};
use crate::static_filter::FeatureVerdict;
use crate::timing::Timing;
use std::sync::Arc;
use stillpoint_features::{Descriptor, FeatureGrid, Features, Keypoint, OrbConfig, OrbExtractor};
use stillpoint_geometry::{Camera, Vec2, Vec6};
use stillpoint_imaging::{RgbdFrame, Simd, workers};
use stillpoint_map::KeyframeData;

/// Standard deviation of a keypoint's position on the finest level, across its edge, px. Measured by the distance of
/// matches from their landmarks: 0.1 to 0.5 px. With it and edges errors are 0.8 times as large as with the 1 px of
/// ORB-SLAM2 (Mur-Artal, Tardos 2017; decision 56).
const SIGMA_PX: f32 = 0.5;

/// Extracts features and reads their depths, reusing buffers.
pub(super) struct Observer {
    pub(super) camera: Camera,
    sensor: SensorConfig,
    pub(super) extractor: OrbExtractor,
    pub(super) features: Features,
    flow: FlowSearch,
    /// Undistorted pixels of `features`, as exposed.
    pub(super) undistorted: Vec<Vec2>,
    /// Depths around their raw pixels in the depth image, m; 0 if none.
    depths: Vec<f32>,
    /// Pixels of the image per pixel of each level.
    level_scales: Vec<f32>,
    bounds: [f32; 4],
    /// Measurements of `features`.
    seen: Vec<Seen>,
    levels: Vec<u8>,
    /// Recently returned data, whose memory is reused once released.
    handed_over: Vec<Arc<KeyframeData>>,
}

impl Observer {
    pub(super) fn new(camera: Camera, sensor: SensorConfig, orb: &OrbConfig, simd: Simd) -> Self {
        let mut level_scales = Vec::with_capacity(orb.levels);
        let mut scale = 1.0;
        for _ in 0..orb.levels {
            level_scales.push(scale);
            scale *= orb.scale_factor;
        }
        Self {
            camera,
            sensor,
            extractor: OrbExtractor::new(orb, simd),
            features: Features::default(),
            flow: FlowSearch::new(simd),
            undistorted: Vec::new(),
            depths: Vec::new(),
            level_scales,
            bounds: camera.undistorted_bounds().map(|b| b as f32),
            seen: Vec::new(),
            levels: Vec::new(),
            handed_over: Vec::new(),
        }
    }

    /// Optical flow, and the last two images.
    pub(super) fn flow(&mut self) -> (&mut FlowSearch, FlowImages<'_>) {
        let images = FlowImages {
            camera: &self.camera,
            keypoints: &self.features.keypoints,
            undistorted: &self.undistorted,
            now: self.extractor.pyramid(),
            before: self.extractor.previous_pyramid(),
        };
        (&mut self.flow, images)
    }

    pub(super) fn level_scales(&self) -> &[f32] {
        &self.level_scales
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
        workers::fill(&mut self.undistorted, |i| self.camera.undistort(raw(i)));
        self.depths.resize(keypoints.len(), 0.0);
        workers::in_rows(&mut self.depths, 1, |first, depths| {
            reader.depths_at(|i| raw(first + i), depths);
        });
    }

    /// Measures the extracted features at the frame's stamp, corrected by the camera velocity (twist per second) for
    /// rolling shutter and for a depth image taken `depth_lag` s after the colour image.
    pub(super) fn measure(
        &mut self,
        frame: &RgbdFrame,
        velocity: Option<&Vec6>,
        (timing, depth_lag): (&Timing, f64),
    ) -> Arc<KeyframeData> {
        let _span = tracing::info_span!("depth").entered();
        let reader = DepthReader::new(
            &self.sensor,
            &self.camera,
            &frame.depth,
            velocity,
            depth_lag,
        );
        let shutter = Shutter::new(&self.camera, timing);
        let mut seen = std::mem::take(&mut self.seen);
        let count = self.features.keypoints.len();
        seen.resize(count, Seen::default());
        workers::in_rows(&mut seen, LANES, |row, seen| {
            let mut first = row * LANES;
            for seen in seen.chunks_mut(LANES) {
                self.measure_some(first, (&reader, &shutter, velocity), seen);
                first += LANES;
            }
        });
        self.seen = seen;
        self.hand_over(|observer, data| observer.write(frame, data))
    }

    /// The features of `data` without those whose verdict is dynamic.
    pub(super) fn select(
        &mut self,
        data: &KeyframeData,
        verdicts: &[FeatureVerdict],
    ) -> Arc<KeyframeData> {
        fn select<T: Copy>(from: &[T], verdicts: &[FeatureVerdict], to: &mut Vec<T>) {
            let kept = from.iter().zip(verdicts).filter(|(_, v)| !v.dynamic);
            refill(kept.map(|(value, _)| *value), to);
        }
        self.hand_over(|observer, selected| {
            selected.stamp = data.stamp;
            select(&data.keypoints, verdicts, &mut selected.keypoints);
            select(&data.positions, verdicts, &mut selected.positions);
            select(&data.sigma_px, verdicts, &mut selected.sigma_px);
            select(&data.depths, verdicts, &mut selected.depths);
            select(&data.depth_sigmas, verdicts, &mut selected.depth_sigmas);
            let descriptors = unshared(&mut selected.descriptors);
            select(&data.descriptors, verdicts, descriptors);
            let kept = verdicts.iter().filter(|v| !v.dynamic);
            refill(kept.map(FeatureVerdict::may_map), &mut selected.mappable);
            observer.index(selected);
        })
    }

    /// Fills the data of a frame, in recycled memory if possible.
    fn hand_over(&mut self, fill: impl FnOnce(&mut Self, &mut KeyframeData)) -> Arc<KeyframeData> {
        let free = |data: &Arc<KeyframeData>| Arc::strong_count(data) == 1;
        let spent = self.handed_over.iter().position(free);
        let spent = spent.map(|i| self.handed_over.remove(i));
        let camera = self.camera;
        let data = refill_or(spent, || nothing(camera), |data| fill(self, data));
        if self.handed_over.len() >= recycle::MOST {
            self.handed_over.remove(0);
        }
        self.handed_over.push(Arc::clone(&data));
        data
    }

    /// Writes down the measurements of all features.
    fn write(&mut self, frame: &RgbdFrame, data: &mut KeyframeData) {
        let (seen, features) = (&self.seen, &self.features);
        data.stamp = frame.stamp;
        refill(seen.iter().map(|s| s.position), &mut data.positions);
        refill(seen.iter().map(|s| s.depth), &mut data.depths);
        refill(seen.iter().map(|s| s.depth_sigma), &mut data.depth_sigmas);
        refill(features.keypoints.iter().copied(), &mut data.keypoints);
        let sigma = |k: &Keypoint| SIGMA_PX * self.level_scales[usize::from(k.level)];
        refill(data.keypoints.iter().map(sigma), &mut data.sigma_px);
        let descriptors = features.descriptors.iter().copied();
        refill(descriptors, unshared(&mut data.descriptors));
        data.mappable.clear();
        data.mappable.resize(features.keypoints.len(), true);
        self.index(data);
    }

    /// Rebuilds the grid of `data`.
    fn index(&mut self, data: &mut KeyframeData) {
        refill(data.keypoints.iter().map(|k| k.level), &mut self.levels);
        data.grid
            .rebuild(&data.positions, &self.levels, self.bounds);
    }

    /// Measures up to [`LANES`] features from `first` on, whose depths are read together.
    fn measure_some(
        &self,
        first: usize,
        (reader, shutter, velocity): (&DepthReader<'_>, &Shutter<'_>, Option<&Vec6>),
        seen: &mut [Seen],
    ) {
        let points = std::array::from_fn(|lane| {
            (lane < seen.len()).then(|| DepthPoint {
                raw: raw_pixel(&self.features.keypoints[first + lane]),
                undistorted: self.undistorted[first + lane],
                here: self.depths[first + lane],
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

/// Data of a frame without features.
fn nothing(camera: Camera) -> KeyframeData {
    KeyframeData {
        stamp: 0.0,
        camera,
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

fn refill<T>(values: impl Iterator<Item = T>, list: &mut Vec<T>) {
    list.clear();
    list.extend(values);
}

/// The descriptors for writing: a new list if the place index still holds the old one.
fn unshared(descriptors: &mut Arc<Vec<Descriptor>>) -> &mut Vec<Descriptor> {
    if Arc::get_mut(descriptors).is_none() {
        *descriptors = Arc::default();
    }
    Arc::make_mut(descriptors)
}

fn raw_pixel(k: &Keypoint) -> Vec2 {
    Vec2::new(f64::from(k.x), f64::from(k.y))
}
