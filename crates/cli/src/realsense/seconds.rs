//! Records some seconds of a camera in memory, for `doctor`.

use crate::failure::Failure;
use crate::input;
use std::path::PathBuf;
use std::sync::Arc;
use stillpoint::datasets::CameraModel;
use stillpoint::imaging::{FrameSource, ImuSample, RgbdFrame, SourceError};
use stillpoint::realsense::{Options, RealSense};
use stillpoint::recordings::{self, Device, Input};

/// Keeps some seconds of a camera, so that they can be examined repeatedly; the first frames are skipped.
///
/// # Errors
/// No camera, or one that delivers nothing.
pub(crate) fn some_seconds(
    playback: Option<PathBuf>,
    start: usize,
    seconds: f64,
) -> Result<Input, Failure> {
    let options = Options {
        playback,
        ..Options::default()
    };
    let device = RealSense::open(&options).map_err(Failure::input)?;
    let mut source = device.frames(true)?;
    let mut kept: Vec<RgbdFrame> = Vec::new();
    let (mut number, mut samples) = (0, Vec::new());
    while let Some(next) = source.next_frame() {
        samples.extend(source.take_inertial());
        match next {
            Ok(_) if number < start => number += 1,
            Ok(frame) => {
                let since = kept.first().map_or(0.0, |first| frame.stamp - first.stamp);
                kept.push(frame);
                if since > seconds {
                    break;
                }
            }
            Err(e) if kept.is_empty() => return Err(Failure::input(e)),
            // Frames from before the camera was unplugged are still used.
            Err(_) => break,
        }
    }
    let device = Kept {
        device,
        frames: kept.into(),
        samples: samples.into(),
    };
    let opened = Input::Device(Box::new(device));
    input::say(&opened);
    Ok(opened)
}

#[derive(Debug)]
struct Kept {
    device: RealSense,
    frames: Arc<[RgbdFrame]>,
    samples: Arc<[ImuSample]>,
}

impl Device for Kept {
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
        let frames = Arc::clone(&self.frames);
        Ok(Box::new(Again {
            frames,
            next: 0,
            samples: Arc::clone(&self.samples),
            taken: 0,
        }))
    }
}

struct Again {
    frames: Arc<[RgbdFrame]>,
    next: usize,
    samples: Arc<[ImuSample]>,
    /// Number of inertial samples already returned.
    taken: usize,
}

impl FrameSource for Again {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        let frame = self.frames.get(self.next)?.clone();
        self.next += 1;
        Some(Ok(frame))
    }

    fn take_inertial(&mut self) -> Vec<ImuSample> {
        let newest = self.next.checked_sub(1).and_then(|i| self.frames.get(i));
        let Some(newest) = newest.map(|f| f.stamp) else {
            return Vec::new();
        };
        let after = self.samples.partition_point(|s| s.stamp < newest);
        let end = (after + 1).min(self.samples.len()).max(self.taken);
        let given = self.samples[self.taken..end].to_vec();
        self.taken = end;
        given
    }

    fn remaining(&self) -> Option<usize> {
        Some(self.frames.len() - self.next)
    }
}
