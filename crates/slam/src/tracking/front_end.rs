//! The front end: from a frame to its features, where they were in the frame before, and what both are asked for.

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

/// All that looks at images: extraction, flow, undistortion, the readout of the shutter, and how many keypoints are wanted.
pub(super) struct FrontEnd {
    pub(super) observer: Observer,
    pub(super) clock: FrameClock,
    demand: Demand,
    calibration: SelfCalibration,
    /// Whether the estimate of the readout improves while tracking.
    learns: bool,
    /// Inliers that make a pose.
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

    /// A front end for frames whose stamps run backwards: it knows of the shutter what this one does, and learns nothing.
    pub(super) fn mirrored(&self, setup: &TrackerSetup, pivot: f64, simd: Simd) -> Self {
        Self {
            clock: self.clock.mirrored(pivot),
            calibration: self.calibration.mirrored(),
            learns: false,
            ..Self::new(setup, self.observer.camera, simd)
        }
    }

    /// Extracts the features of a frame and reads their depths, as of a camera that does not move.
    pub(super) fn observe(&mut self, frame: &RgbdFrame) -> Arc<KeyframeData> {
        let wanted = self.demand.next(self.min_inliers);
        self.observer.extractor.set_wanted(wanted);
        self.observer.extract(frame);
        self.measure(frame, None)
    }

    /// Measures the features of the frame that was observed last, for a camera that moves by `velocity` (twist per second).
    pub(super) fn measure(
        &mut self,
        frame: &RgbdFrame,
        velocity: Option<&Vec6>,
    ) -> Arc<KeyframeData> {
        let (timing, lag) = (self.calibration.timing(), self.depth_lag(frame));
        self.observer.measure(frame, velocity, (timing, lag))
    }

    /// What `data` has of a frame, brought to its stamp by another velocity of the camera.
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

    /// Learns the readout: takes the two newest frames; none where the frame before has no pose. Gives back a list that it is done with.
    pub(super) fn learn(&mut self, newest: Option<Between>) -> Option<Vec<RowPair>> {
        if self.learns {
            self.calibration.learn(&self.observer.camera, newest)
        } else {
            newest.map(|n| n.pairs)
        }
    }

    /// Takes note of how many keypoints of the frame agreed with its pose, on which the demand for the next one depends.
    pub(super) fn note_inliers(&mut self, inliers: Option<u32>) {
        self.demand.note_inliers(inliers);
    }

    /// When the parts of a frame are exposed, as estimated so far.
    pub(super) fn timing(&self) -> Timing {
        *self.calibration.timing()
    }

    /// What frames are measured with while the camera moves by `velocity`.
    pub(super) fn exposure(&self, velocity: Option<Vec6>) -> Exposure {
        let readout = self.calibration.timing().readout;
        Exposure { velocity, readout }
    }

    /// The shutter, as estimated so far.
    pub(super) fn shutter(&self) -> Shutter<'_> {
        Shutter::new(&self.observer.camera, self.calibration.timing())
    }

    /// Keypoints that the last image was asked for.
    pub(super) fn asked(&self) -> usize {
        self.observer.extractor.wanted()
    }

    /// From now on so many keypoints are wanted where enough of them hold.
    pub(super) fn want(&mut self, features: usize) {
        self.demand.set(features);
    }

    /// How long after a frame's colour image its depth image was taken, s.
    pub(super) fn depth_lag(&self, frame: &RgbdFrame) -> f64 {
        let times = self.clock.times(frame);
        times.depth - times.colour - self.calibration.timing().depth_delay
    }

    /// The camera's motion from the depth image's exposure to the colour image's.
    pub(super) fn camera_from_depth(&self, frame: &RgbdFrame, velocity: Option<&Vec6>) -> Se3 {
        let dt = self.depth_lag(frame);
        velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * dt)).inverse())
    }
}
