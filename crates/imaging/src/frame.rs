//! RGB-D frames and where they come from.

use crate::{ColourImage, DepthImage, GrayImage, ImuSample, OdometrySample};
use std::sync::Arc;

/// Number of a frame in its stream: 0, 1, 2, ... Also the id of the keyframe made from it.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct FrameId(pub u32);

impl std::fmt::Display for FrameId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

/// One colour image with its depth image, registered to it.
#[derive(Clone, Debug)]
pub struct RgbdFrame {
    /// Number in the stream.
    pub id: FrameId,
    /// Stamp of the colour image, s. Poses are stated for this time.
    pub stamp: f64,
    /// Stamp of the depth image, s; often some milliseconds off.
    pub depth_stamp: f64,
    /// Grey image, as recorded (distorted).
    pub gray: GrayImage,
    /// Colour image, when somebody downstream wants it.
    pub colour: Option<Arc<ColourImage>>,
    /// Depth, m, of the same size as `gray`.
    pub depth: DepthImage,
}

impl RgbdFrame {
    /// The same frame as of a camera that measured no depth.
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

/// A stream of frames failed.
#[derive(Debug)]
pub struct SourceError {
    /// What was expected, what was found, where, and what to do.
    pub message: String,
    /// True when the frames after this one can still be read: this one was skipped.
    pub recoverable: bool,
}

impl std::fmt::Display for SourceError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.message)
    }
}

impl std::error::Error for SourceError {}

/// Something that yields frames in the order of time: a data set, a simulator, a camera.
pub trait FrameSource: Send {
    /// The next frame; `None` at the end of the stream. After a recoverable error the next call continues with the next
    /// frame; after any other error the stream has ended.
    fn next_frame(&mut self) -> Option<Result<RgbdFrame, SourceError>>;

    /// Samples of an inertial sensor since the last call, in order of time: up to the newest frame that was returned, and the first sample after
    /// it if there is one. Call this after each frame. A source that wraps another source forwards the call.
    fn take_inertial(&mut self) -> Vec<ImuSample> {
        Vec::new()
    }

    /// The same of odometry.
    fn take_odometry(&mut self) -> Vec<OdometrySample> {
        Vec::new()
    }

    /// How many frames are left, when that is known.
    fn remaining(&self) -> Option<usize> {
        None
    }

    /// Whether frames come when a camera takes them: nobody has to hold them back to the pace of their stamps.
    fn is_live(&self) -> bool {
        false
    }
}
