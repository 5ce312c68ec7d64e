//! Simulated frames cached for several runs, since rendering is slower than tracking.

use stillpoint::geometry::{Camera, Se3};
use stillpoint::imaging::{
    FrameSource, ImuSample, ImuTrack, OdometrySample, OdometryTrack, RgbdFrame, SourceError,
};
use stillpoint::simulator::{SimulatedImu, SimulatedOdometry, Simulator, SimulatorConfig};

pub(crate) struct Rendered {
    simulator: Simulator,
    frames: Vec<RgbdFrame>,
}

impl Rendered {
    /// Frames of a scene with 320x240 px.
    pub(crate) fn new(scene: &str, frames: usize, rate: f64) -> Self {
        Self::with_seed(scene, frames, rate, SimulatorConfig::default().seed)
    }

    /// Likewise with another seed of the scene.
    pub(crate) fn with_seed(scene: &str, frames: usize, rate: f64, seed: u64) -> Self {
        let config = SimulatorConfig {
            scene: scene.into(),
            seed,
            frames: Some(frames),
            rate,
            camera: Camera::pinhole(320, 240, [267.5, 267.5, 159.5, 119.5]),
            ..SimulatorConfig::default()
        };
        let simulator = Simulator::new(&config).unwrap();
        Self {
            frames: (0..simulator.len()).map(|i| simulator.frame(i)).collect(),
            simulator,
        }
    }

    pub(crate) fn camera(&self) -> Camera {
        *self.simulator.camera()
    }

    pub(crate) fn truth(&self) -> Vec<(f64, Se3)> {
        self.simulator.ground_truth()
    }

    pub(crate) fn source(&self) -> RenderedSource<'_> {
        RenderedSource {
            frames: self.frames.iter(),
            imu: ImuTrack::default(),
            odometry: OdometryTrack::default(),
            newest: None,
        }
    }

    pub(crate) fn with_imu(&self, imu: &SimulatedImu) -> RenderedSource<'_> {
        RenderedSource {
            imu: ImuTrack::new(self.simulator.inertial(imu).into()),
            ..self.source()
        }
    }

    pub(crate) fn with_odometry(&self, wheels: &SimulatedOdometry) -> RenderedSource<'_> {
        RenderedSource {
            odometry: OdometryTrack::new(self.simulator.odometry(wheels).into()),
            ..self.source()
        }
    }
}

pub(crate) struct RenderedSource<'a> {
    frames: std::slice::Iter<'a, RgbdFrame>,
    imu: ImuTrack,
    odometry: OdometryTrack,
    newest: Option<f64>,
}

impl FrameSource for RenderedSource<'_> {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        let frame = self.frames.next()?;
        self.newest = Some(frame.stamp);
        Some(Ok(frame.clone()))
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
}
