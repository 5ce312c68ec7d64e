//! The front end: feature extraction, flow, exposure timing and the number of keypoints.

use super::TrackerSetup;
use super::clock::FrameClock;
use super::demand::Demand;
use super::frame::Observer;
use super::self_calibration::{Between, RowPair, SelfCalibration};
use crate::messages::Exposure;
use crate::shutter::Shutter;
use crate::timing::Timing;
use std::sync::Arc;
use stillpoint_geometry::{Camera, Se3, Vec6};
use stillpoint_imaging::{RgbdFrame, Simd};
use stillpoint_map::KeyframeData;

/// All image processing of tracking.
pub(super) struct FrontEnd {
    pub(super) observer: Observer,
    pub(super) clock: FrameClock,
    demand: Demand,
    calibration: SelfCalibration,
    /// Whether the readout is estimated.
    learns: bool,
    /// Minimum number of inliers of a pose.
    min_inliers: usize,
    pub(super) simd: Simd,
}

impl FrontEnd {
    pub(super) fn new(setup: &TrackerSetup, camera: Camera, simd: Simd) -> Self {
        Self {
            observer: Observer::new(camera, setup.sensor.clone(), &setup.features, simd),
            clock: FrameClock::default(),
            demand: Demand::new(setup.features.features),
            calibration: SelfCalibration::new(setup.sensor.timing()),
            learns: setup.sensor.self_calibrate,
            min_inliers: setup.tracking.min_inliers,
            simd,
        }
    }

    /// A front end for frames with reversed stamps, with the same shutter but no learning.
    pub(super) fn mirrored(&self, setup: &TrackerSetup, pivot: f64, simd: Simd) -> Self {
        Self {
            clock: self.clock.mirrored(pivot),
            calibration: self.calibration.mirrored(),
            learns: false,
            ..Self::new(setup, self.observer.camera, simd)
        }
    }

    /// Extracts and measures the features of a frame, without correction for camera motion.
    pub(super) fn observe(&mut self, frame: &RgbdFrame) -> Arc<KeyframeData> {
        let wanted = self.demand.next(self.min_inliers);
        self.observer.extractor.set_wanted(wanted);
        self.observer.extract(frame);
        self.measure(frame, None)
    }

    /// Measures the features of the last observed frame at its stamp, with a camera velocity (twist per second).
    pub(super) fn measure(
        &mut self,
        frame: &RgbdFrame,
        velocity: Option<&Vec6>,
    ) -> Arc<KeyframeData> {
        let (timing, lag) = (self.calibration.timing(), self.depth_lag(frame));
        self.observer.measure(frame, velocity, (timing, lag))
    }

    /// Measures the features of `data` again with another camera velocity.
    pub(super) fn measure_again(
        &self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        velocity: &Vec6,
    ) -> KeyframeData {
        let (timing, lag) = (self.calibration.timing(), self.depth_lag(frame));
        self.observer
            .measure_again(frame, data, velocity, (timing, lag))
    }

    /// Updates the readout estimate with the two newest frames; `None` if the last frame has no pose. Returns a used
    /// list for recycling.
    pub(super) fn learn(&mut self, newest: Option<Between>) -> Option<Vec<RowPair>> {
        if self.learns {
            self.calibration.learn(&self.observer.camera, newest)
        } else {
            newest.map(|n| n.pairs)
        }
    }

    /// Records the inliers of a frame, which determine the number of keypoints of the next.
    pub(super) fn note_inliers(&mut self, inliers: Option<u32>) {
        self.demand.note_inliers(inliers);
    }

    pub(super) fn timing(&self) -> Timing {
        *self.calibration.timing()
    }

    /// Exposure record for measurements with camera velocity `velocity`.
    pub(super) fn exposure(&self, velocity: Option<Vec6>) -> Exposure {
        let readout = self.calibration.timing().readout;
        Exposure { velocity, readout }
    }

    pub(super) fn shutter(&self) -> Shutter<'_> {
        Shutter::new(&self.observer.camera, self.calibration.timing())
    }

    /// Number of keypoints requested from the last image.
    pub(super) fn asked(&self) -> usize {
        self.observer.extractor.wanted()
    }

    /// Sets the usual number of keypoints.
    pub(super) fn want(&mut self, features: usize) {
        self.demand.set(features);
    }

    /// Time from the exposure of a frame's colour image to that of its depth image, s.
    pub(super) fn depth_lag(&self, frame: &RgbdFrame) -> f64 {
        let times = self.clock.times(frame);
        times.depth - times.colour - self.calibration.timing().depth_delay
    }

    /// Camera motion from the exposure of the depth image to that of the colour image.
    pub(super) fn camera_from_depth(&self, frame: &RgbdFrame, velocity: Option<&Vec6>) -> Se3 {
        let dt = self.depth_lag(frame);
        velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * dt)).inverse())
    }
}
