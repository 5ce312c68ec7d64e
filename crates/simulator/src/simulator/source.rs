//! The frames of a simulator as a stream.

use super::Simulator;
use super::inertial::{BEFORE, SimulatedImu};
use super::odometry::{self, SimulatedOdometry};
use stillpoint_imaging::{
    FrameSource, ImuSample, ImuTrack, OdometrySample, OdometryTrack, RgbdFrame, SourceError,
};

/// The frames of a [`Simulator`], in order.
pub struct SimulatorSource {
    simulator: Simulator,
    next: usize,
    end: usize,
    colour: bool,
    imu: ImuTrack,
    odometry: OdometryTrack,
    /// Stamp of the newest returned frame, s.
    newest: Option<f64>,
}

impl SimulatorSource {
    pub(super) fn new(simulator: Simulator) -> Self {
        Self {
            end: simulator.len(),
            simulator,
            next: 0,
            colour: false,
            imu: ImuTrack::default(),
            odometry: OdometryTrack::default(),
            newest: None,
        }
    }

    /// Adds colour images.
    #[must_use]
    pub fn with_colour(self) -> Self {
        Self {
            colour: true,
            ..self
        }
    }

    /// Limits the stream to the frames from `start` up to and excluding `end`; ids and stamps stay those of the whole recording.
    #[must_use]
    pub fn between(mut self, start: usize, end: Option<usize>) -> Self {
        self.end = end.map_or(self.simulator.len(), |e| e.min(self.simulator.len()));
        self.next = start.min(self.end);
        self.leave_out_earlier()
    }

    /// Adds an inertial sensor.
    #[must_use]
    pub fn with_imu(mut self, imu: &SimulatedImu) -> Self {
        self.imu = ImuTrack::new(self.simulator.inertial(imu).into());
        self.leave_out_earlier()
    }

    /// Adds wheel odometry.
    #[must_use]
    pub fn with_odometry(mut self, wheels: &SimulatedOdometry) -> Self {
        self.odometry = OdometryTrack::new(self.simulator.odometry(wheels).into());
        self.leave_out_earlier()
    }

    /// Drops samples that precede the next frame.
    fn leave_out_earlier(mut self) -> Self {
        let next = self.simulator.stamp(self.next);
        self.imu.skip_before(next - BEFORE);
        self.odometry.skip_before(next - odometry::BEFORE);
        self
    }

    /// The simulator behind the stream.
    #[must_use]
    pub fn simulator(&self) -> &Simulator {
        &self.simulator
    }
}

impl FrameSource for SimulatorSource {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        if self.next >= self.end {
            return None;
        }
        let index = self.next;
        self.next += 1;
        self.newest = Some(self.simulator.stamp(index));
        Some(Ok(if self.colour {
            self.simulator.frame_with_colour(index)
        } else {
            self.simulator.frame(index)
        }))
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        let imu = &mut self.imu;
        self.newest.map_or_else(Vec::new, |t| imu.take_until(t))
    }

    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        let odometry = &mut self.odometry;
        self.newest
            .map_or_else(Vec::new, |t| odometry.take_until(t))
    }

    fn remaining(&self) -> Option<usize> {
        Some(self.end - self.next)
    }
}
