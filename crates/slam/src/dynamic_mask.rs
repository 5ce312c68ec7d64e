//! The static filter as a product of its own: which pixels of a stream move, without any SLAM on top.
//!
//! Answers, frame by frame: a mask, verdicts for any pixels, and the objects that move. Takes frames and, where there are some,
//! the user's own poses and boxes. Builds no map, closes no loops and remembers the last three seconds only.

use crate::config::Config;
use crate::gate::{FrameGate, RefusedFrame};
use crate::static_filter::{FeatureVerdict, Preset, Segments};
use crate::tracking::Tracker;
use crate::validation::{ConfigError, check_camera};
use std::sync::Arc;
use stillpoint_detection::{Detections, Object};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{FrameId, GrayImage, RgbdFrame, Simd, Workers};

/// Why a [`DynamicMask`] cannot be made of a configuration.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MaskError {
    /// Values out of range.
    Config(ConfigError),
    /// A preset that knows no regions of the image; it is given back.
    Preset(Preset),
}

impl std::fmt::Display for MaskError {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Config(e) => e.fmt(f),
            Self::Preset(found) => write!(
                f,
                "static_filter.preset: expected \"default\", found {found:?}, which judges features alone; a mask needs the preset that judges surfaces"
            ),
        }
    }
}

impl std::error::Error for MaskError {}

/// What moves in a stream of frames.
///
/// ```no_run
/// use stillpoint_geometry::Camera;
/// use stillpoint_imaging::{RgbdFrame, Simd};
/// use stillpoint_slam::{Config, DynamicMask};
///
/// let camera = Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5]);
/// let mut filter = DynamicMask::new(&Config::default(), camera, Simd::detect())?;
/// # let frames: Vec<std::sync::Arc<RgbdFrame>> = Vec::new();
/// for frame in frames {
///     let moving = filter.step(&frame, None)?;
///     let mask = moving.mask();
/// }
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct DynamicMask {
    gate: FrameGate,
    tracker: Tracker,
    next: FrameId,
    /// What was found in the last frame.
    last: Option<MovingThings>,
}

/// What moves in one frame.
#[derive(Clone, Debug)]
pub struct MovingThings {
    /// The frame.
    pub frame: Arc<RgbdFrame>,
    /// The camera's pose that the verdicts rest on: the user's where one was given, else by what stands still in the image, relative to
    /// the first frame, with the drift of a camera that is followed from frame to frame. `None` where it is not known; then nothing is said
    /// to move. After a loss of ten frames it starts over at the origin.
    pub world_from_camera: Option<Se3>,
    /// Verdicts of the filter's own keypoints.
    pub verdicts: Arc<[FeatureVerdict]>,
    /// The objects that the boxes are of, in the camera's world.
    pub objects: Arc<[Object]>,
    /// The regions that move, by cells of the image.
    pub segments: Segments,
}

impl MovingThings {
    /// The mask: 255 where the scene moves, 0 where it stands still or nothing is known: [`Segments::mask`].
    #[must_use]
    pub fn mask(&self) -> GrayImage {
        self.segments.mask(&self.frame)
    }
}

impl DynamicMask {
    /// A filter for the frames of one camera. Of the configuration, what is about features, sensor, tracking, static filter, objects and
    /// motion weights is used.
    ///
    /// # Errors
    /// [`MaskError`] for values out of range, for cameras as [`crate::Stages::new`] refuses them, and for presets other than `default`.
    pub fn new(config: &Config, camera: Camera, simd: Simd) -> Result<Self, MaskError> {
        config.validate().map_err(MaskError::Config)?;
        check_camera(&camera).map_err(MaskError::Config)?;
        if config.static_filter.preset != Preset::Default {
            return Err(MaskError::Preset(config.static_filter.preset));
        }
        Ok(Self {
            gate: FrameGate::new(&camera),
            tracker: Tracker::new(config, camera, simd),
            next: FrameId(0),
            last: None,
        })
    }

    /// The filter with threads that share the work on a frame. What it finds is the same, bit for bit.
    #[must_use]
    pub fn with_workers(mut self, workers: Workers) -> Self {
        self.tracker = self.tracker.with_workers(workers);
        self
    }

    /// Takes what a detector of the user's sees: before [`Self::step`] for the frame to come, or for a frame of the last three seconds.
    pub fn detections(&mut self, detections: Detections) {
        self.tracker.take_detections(detections, self.next);
    }

    /// Looks at a frame. With a pose of the user's (`world_from_camera`, at the frame's colour stamp) the camera's motion is taken from
    /// there; give one for every frame or for none. A pose that is not finite counts as none.
    ///
    /// # Errors
    /// [`RefusedFrame`] for a frame that does not follow the one before or does not fit the camera; it changes nothing.
    pub fn step(
        &mut self,
        frame: &Arc<RgbdFrame>,
        world_from_camera: Option<&Se3>,
    ) -> Result<MovingThings, RefusedFrame> {
        self.gate.admit(frame)?;
        let given = world_from_camera.filter(|pose| pose.is_finite());
        let look = self.tracker.look(frame, given);
        self.next = FrameId(frame.id.0.saturating_add(1));
        let found = MovingThings {
            frame: Arc::clone(frame),
            world_from_camera: look.world_from_camera,
            verdicts: look.judgement.verdicts,
            objects: look.judgement.objects,
            segments: look.judgement.segments,
        };
        self.last = Some(found.clone());
        Ok(found)
    }

    /// What the filter says of any raw pixels of the last frame, such as the keypoints of another system; empty before the first one. It agrees with the
    /// mask. Where there is no depth within a pixel, nothing is known and the verdict is static.
    #[must_use]
    pub fn verdicts(&self, pixels: &[[f32; 2]]) -> Vec<FeatureVerdict> {
        let Some(last) = &self.last else {
            return Vec::new();
        };
        let (mask, depth) = (last.mask(), &last.frame.depth);
        let mut verdicts = self
            .tracker
            .judge_pixels(&last.frame, &last.objects, pixels);
        for verdict in &mut verdicts {
            let [x, y] = verdict.pixel.map(|c| (c + 0.5).max(0.0) as usize);
            if x < mask.width() && y < mask.height() && depth.at(x, y) > 0.0 {
                verdict.follow(mask.at(x, y) > 0);
            }
        }
        verdicts
    }
}
