//! `live realsense`: runs on a camera, and records it.

pub(crate) mod seconds;

use crate::args::live::{LiveRealsenseArgs, Switch};
use crate::console;
use crate::failure::{Failure, Status};
use crate::input;
use crate::run;
use crate::sinks::record::SharedRecorder;
use crate::timing::Timing;
use stillpoint::datasets::CameraModel;
use stillpoint::geometry::ImuModel;
use stillpoint::imaging::{FrameSource, ImuSample, RgbdFrame, SourceError};
use stillpoint::realsense::{Options, RealSense};
use stillpoint::recordings::{self, Device, Input, McapRecorder};

pub(crate) fn live(args: &LiveRealsenseArgs, timing: &'static Timing) -> Result<Status, Failure> {
    if let Some(path) = args.output.record.record.as_deref().filter(|p| p.exists()) {
        return Err(Failure::input(format!(
            "--record: expected a new file, found {}, which exists; choose another name, or remove it",
            path.display()
        )));
    }
    let options = Options {
        serial: args.serial.clone(),
        playback: args.playback.clone(),
        size: args.size,
        rate: args.rate,
        emitter: args.emitter.map(|s| s == Switch::On),
        exposure: args.exposure_ms,
        inertial: !args.no_imu,
    };
    let camera = RealSense::open(&options).map_err(Failure::input)?;
    let mut device: Box<dyn Device> = Box::new(camera);
    let Some(path) = &args.output.record.record else {
        return on(device, args, None, timing);
    };
    let recorder = McapRecorder::create(path, &device.camera().camera).map_err(Failure::input)?;
    let recorder = SharedRecorder::new(recorder);
    device = Box::new(Recorded {
        device,
        recorder: recorder.clone(),
    });
    let status = on(device, args, Some(recorder.clone()), timing);
    // Whatever the outcome of the run, keep the recorded frames.
    let finished = recorder.finish();
    if status.is_ok() {
        finished?;
    }
    status
}

fn on(
    device: Box<dyn Device>,
    args: &LiveRealsenseArgs,
    recorder: Option<SharedRecorder>,
    timing: &'static Timing,
) -> Result<Status, Failure> {
    let opened = Input::Device(device);
    input::say(&opened);
    run::run_on(opened, &args.as_run(), recorder, timing)
}

/// A camera that is recorded during the run.
#[derive(Debug)]
struct Recorded {
    device: Box<dyn Device>,
    recorder: SharedRecorder,
}

impl Device for Recorded {
    fn kind(&self) -> String {
        self.device.kind()
    }

    fn camera(&self) -> &CameraModel {
        self.device.camera()
    }

    fn guesses(&self) -> &[String] {
        self.device.guesses()
    }

    fn frames(&self, _: bool) -> recordings::Result<Box<dyn FrameSource>> {
        Ok(Box::new(Recording {
            mount: self.camera().imu,
            recorder: Some(self.recorder.clone()),
            // Colour is always recorded, even if the run does not need it.
            frames: self.device.frames(true)?,
        }))
    }
}

/// Writes each frame before passing it on.
struct Recording {
    /// Mounting of the inertial sensor, written before the first frame.
    mount: Option<ImuModel>,
    frames: Box<dyn FrameSource>,
    /// `None` after a write error.
    recorder: Option<SharedRecorder>,
}

impl Recording {
    fn write(&mut self, write: impl FnOnce(&mut McapRecorder) -> recordings::Result<()>) {
        if let Some(recorder) = &self.recorder
            && let Err(e) = recorder.write(write)
        {
            console::warn(&format!(
                "the camera's frames are not recorded from here on, the run goes on: {e}"
            ));
            self.recorder = None;
        }
    }
}

impl FrameSource for Recording {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        let next = self.frames.next_frame();
        if let Some(Ok(frame)) = &next {
            if let Some(mount) = self.mount.take() {
                self.write(|r| r.add_imu(&mount, frame.stamp));
            }
            self.write(|r| r.add(frame));
        }
        next
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        let samples = self.frames.take_inertial();
        self.write(|r| r.add_inertial(&samples));
        samples
    }

    fn remaining(&self) -> Option<usize> {
        self.frames.remaining()
    }

    fn is_live(&self) -> bool {
        self.frames.is_live()
    }
}
