//! Scripted recordings.

use proptest::prelude::*;
use std::sync::Arc;
use stillpoint_datasets::StampedPose;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_imaging::{ColourImage, DepthImage, FrameId, FrameSource, RgbdFrame, SourceError};

pub(crate) const PERIOD: f64 = 1.0 / 30.0;
pub(crate) const SIZE: [usize; 2] = [4, 3];

/// A recording by stamps, and whether each frame is readable.
#[derive(Clone, Debug)]
pub(crate) struct Script {
    pub(crate) name: u8,
    pub(crate) frames: Vec<(f64, bool)>,
    pub(crate) size: [usize; 2],
    pub(crate) colour: bool,
}

impl Script {
    pub(crate) fn frame(&self, k: usize) -> RgbdFrame {
        let ([w, h], level) = (self.size, self.name.wrapping_mul(16).wrapping_add(k as u8));
        let colour = ColourImage::from_vec(w, h, vec![level; 3 * w * h]).unwrap();
        RgbdFrame {
            id: FrameId(k as u32),
            stamp: self.frames[k].0,
            depth_stamp: self.frames[k].0 + 0.004,
            gray: colour.to_gray(),
            colour: self.colour.then(|| Arc::new(colour)),
            depth: DepthImage::from_vec(w, h, vec![1.0 + f32::from(level); w * h]).unwrap(),
        }
    }

    pub(crate) fn source(&self) -> Played {
        Played {
            script: self.clone(),
            next: 0,
        }
    }

    pub(crate) fn pose(&self, k: usize) -> Se3 {
        Se3::exp(&Vec6::new(
            f64::from(self.name),
            k as f64,
            0.5,
            0.01 * k as f64,
            0.0,
            0.1,
        ))
    }

    /// Poses at the stamps of all frames, readable or not.
    pub(crate) fn truth(&self) -> Vec<StampedPose> {
        let pose = |(k, (stamp, _)): (usize, &(f64, bool))| StampedPose {
            stamp: *stamp,
            world_from_camera: self.pose(k),
        };
        self.frames.iter().enumerate().map(pose).collect()
    }

    pub(crate) fn regular(name: u8, count: usize) -> Self {
        Self {
            name,
            frames: (0..count).map(|k| (k as f64 * PERIOD, true)).collect(),
            size: SIZE,
            colour: false,
        }
    }
}

pub(crate) struct Played {
    script: Script,
    next: usize,
}

impl FrameSource for Played {
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>> {
        let (_, readable) = *self.script.frames.get(self.next)?;
        self.next += 1;
        Some(if readable {
            Ok(self.script.frame(self.next - 1))
        } else {
            Err(SourceError {
                message: "unreadable".to_owned(),
                recoverable: true,
            })
        })
    }

    fn remaining(&self) -> Option<usize> {
        Some(self.script.frames.len() - self.next)
    }
}

/// Recordings of uneven steps with some unreadable frames; the first frame is readable.
pub(crate) fn script() -> impl Strategy<Value = Script> {
    let steps = prop::collection::vec((0.005..0.2_f64, prop::bool::weighted(0.85)), 1..14);
    (0..16_u8, -50.0..1.4e9_f64, steps, any::<bool>()).prop_map(|(name, start, steps, colour)| {
        let mut stamp = start;
        let frames = steps.into_iter().map(|(step, readable)| {
            stamp += step;
            (stamp, readable)
        });
        let mut frames: Vec<_> = frames.collect();
        // A black part may follow, which needs a size.
        frames[0].1 = true;
        Script {
            name,
            frames,
            size: SIZE,
            colour,
        }
    })
}
