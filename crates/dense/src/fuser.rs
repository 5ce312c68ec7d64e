//! Fuses frames with known poses, without SLAM.

use crate::config::{DenseConfig, DenseConfigError};
use crate::observation::{Observation, Rectifier};
use crate::world::DenseMap;
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::{RgbdFrame, Simd};

/// Fuses frames whose poses are known from elsewhere.
///
/// ```
/// use stillpoint_dense::{DenseConfig, Fuser, MeshOptions};
/// use stillpoint_geometry::{Camera, Se3};
/// use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame, Simd};
///
/// let camera = Camera::pinhole(64, 48, [60.0, 60.0, 31.5, 23.5]);
/// let mut fuser = Fuser::new(&DenseConfig::default(), &camera, Simd::detect())?;
/// let frame = RgbdFrame {
///     id: FrameId(0),
///     stamp: 0.0,
///     depth_stamp: 0.0,
///     gray: GrayImage::new(64, 48),
///     colour: None,
///     depth: DepthImage::from_vec(64, 48, vec![1.0; 64 * 48])?,
/// };
/// // Twice: what is seen once only makes no surface.
/// for _ in 0..2 {
///     fuser.add(&frame, &[], &Se3::identity());
/// }
/// let mesh = fuser.map().mesh(&MeshOptions::default());
/// assert!((mesh.area() - 1.0 * 0.8).abs() < 0.15);
/// # Ok::<(), Box<dyn std::error::Error>>(())
/// ```
pub struct Fuser {
    rectifier: Rectifier,
    map: DenseMap,
    seen: Observation,
}

impl Fuser {
    /// For a camera, before the first frame.
    ///
    /// # Errors
    /// A setting out of range.
    pub fn new(
        config: &DenseConfig,
        camera: &Camera,
        simd: Simd,
    ) -> Result<Self, DenseConfigError> {
        config.validate()?;
        Ok(Self {
            rectifier: Rectifier::new(camera, config),
            map: DenseMap::new(config, simd),
            seen: Observation::default(),
        })
    }

    /// Adds a frame with the camera pose of its depth image. `moving` has one entry per pixel, true where something moves, or is empty.
    pub fn add(&mut self, frame: &RgbdFrame, moving: &[bool], world_from_camera: &Se3) {
        self.rectifier.take(frame, moving, 1, &mut self.seen);
        let camera = &self.rectifier.camera;
        self.map.integrate(&self.seen, camera, world_from_camera);
    }

    /// The fused map.
    #[must_use]
    pub fn map(&self) -> &DenseMap {
        &self.map
    }
}
