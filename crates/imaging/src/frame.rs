//! RGB-D frames and their sources.

use crate::{ColourImage, DepthImage, GrayImage, ImuSample, OdometrySample};
use std::sync::Arc;

/// Number of a frame in its stream, from 0. Also the id of the keyframe made from it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FrameId(pub u32);

impl std::fmt::Display for FrameId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// A colour image and a depth image registered to it.
#[derive(Clone, Debug)]
pub struct RgbdFrame {
    /// Number in the stream.
    pub id: FrameId,
    /// Stamp of the colour image, s, to which poses refer.
    pub stamp: f64,
    /// Stamp of the depth image, s; often some milliseconds off.
    pub depth_stamp: f64,
    /// Grey image, as recorded (distorted).
    pub gray: GrayImage,
    /// Colour image, if needed downstream.
    pub colour: Option<Arc<ColourImage>>,
    /// Depth, m, of the same size as `gray`.
    pub depth: DepthImage,
}

impl RgbdFrame {
    /// The same frame without depth measurements.
    #[must_use]
    pub fn without_depth(&self) -> Self {
        let (width, height) = (self.depth.width(), self.depth.height());
        let nothing = DepthImage::from_vec(width, height, vec![0.0; width * height]);
        Self {
            id: self.id,
            stamp: self.stamp,
            depth_stamp: self.depth_stamp,
            gray: self.gray.clone(),
            colour: self.colour.clone(),
            depth: nothing.unwrap_or_default(),
        }
    }
}

/// Error of a stream of frames.
#[derive(Debug)]
pub struct SourceError {
    /// Message that states expectation, finding, place and remedy.
    pub message: String,
    /// True when only this frame was skipped and later ones can still be read.
    pub recoverable: bool,
}

impl std::fmt::Display for SourceError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for SourceError {}

/// A source of frames in temporal order: a data set, a simulator, a camera.
pub trait FrameSource: Send {
    /// The next frame; `None` at the end of the stream. After a recoverable error the next call continues with the next
    /// frame; after any other error the stream has ended.
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>>;

    /// Inertial samples since the last call, in temporal order: up to the newest returned frame, and the first sample
    /// after it if there is one. Call this after each frame. Sources that wrap another source must forward the call.
    fn take_inertial(&mut self) -> Vec<ImuSample> {
        Vec::new()
    }

    /// Odometry samples, likewise.
    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        Vec::new()
    }

    /// Number of remaining frames, if known.
    fn remaining(&self) -> Option<usize> {
        None
    }

    /// Whether frames arrive in real time, so that playback need not be paced by their stamps.
    fn is_live(&self) -> bool {
        false
    }
}
