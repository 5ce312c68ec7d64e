//! The static filter on its own: detects moving pixels in a stream of frames without SLAM.
//!
//! Gives a mask, verdicts for arbitrary pixels and the moving objects of each frame. Optionally takes poses and
//! detections of the caller. Keeps the last three seconds; builds no map.

use crate::config::Config;
use crate::gate::{FrameGate, RefusedFrame};
use crate::static_filter::{FeatureVerdict, Preset, Segments};
use crate::tracking::Tracker;
use crate::validation::{ConfigError, check_camera};
use std::sync::Arc;
use stillpoint_detection::{Detections, Object};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{FrameId, GrayImage, RgbdFrame, Simd, Workers};

/// Why a [`DynamicMask`] cannot be created from a configuration.
#[derive(Clone, Debug, PartialEq)]
#[non_exhaustive]
pub enum MaskError {
    /// Values out of range.
    Config(ConfigError),
    /// The given preset does not segment the image.
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

/// Detects moving regions in a stream of frames.
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
    last: Option<MovingThings>,
}

/// Moving regions and objects of one frame.
#[derive(Clone, Debug)]
pub struct MovingThings {
    /// The frame.
    pub frame: Arc<RgbdFrame>,
    /// Camera pose underlying the verdicts: the caller's if given, else from the static part of the image, relative to
    /// the first frame and with the drift of frame-to-frame odometry. `None` if unknown; then nothing is marked as
    /// moving. After ten lost frames it restarts at the origin.
    pub world_from_camera: Option<Se3>,
    /// Verdicts of the filter's own keypoints.
    pub verdicts: Arc<[FeatureVerdict]>,
    /// Tracked objects of the detections, in the world frame of the camera pose.
    pub objects: Arc<[Object]>,
    /// Moving regions, by image cell.
    pub segments: Segments,
}

impl MovingThings {
    /// Mask with 255 where the scene moves and 0 where it is static or unknown; see [`Segments::mask`].
    #[must_use]
    pub fn mask(&self) -> GrayImage {
        self.segments.mask(&self.frame)
    }
}

impl DynamicMask {
    /// Creates a filter for one camera. Uses the settings of features, sensor, tracking, static filter, objects and
    /// motion weights.
    ///
    /// # Errors
    /// [`MaskError`] for values out of range, for cameras that [`crate::Stages::new`] refuses, and for presets other
    /// than `default`.
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

    /// Shares the work on a frame among threads. Results stay bit-identical.
    #[must_use]
    pub fn with_workers(mut self, workers: Workers) -> Self {
        self.tracker = self.tracker.with_workers(workers);
        self
    }

    /// Adds detections of the caller: before [`Self::step`] for the next frame, or for a frame of the last three
    /// seconds.
    pub fn detections(&mut self, detections: Detections) {
        self.tracker.take_detections(detections, self.next);
    }

    /// Processes a frame. If `world_from_camera` (at the colour stamp) is given, it replaces the estimated camera
    /// motion; give it for every frame or for none. A non-finite pose counts as none.
    ///
    /// # Errors
    /// [`RefusedFrame`] for a frame that is out of order or does not fit the camera; it changes nothing.
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

    /// Verdicts for arbitrary raw pixels of the last frame, such as keypoints of another system; empty before the first
    /// frame. They agree with the mask. Without depth within a pixel, the verdict is static.
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
