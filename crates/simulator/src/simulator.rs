//! The simulator: combines a scene, a path and a sensor.

mod annotations;
mod inertial;
mod odometry;
mod source;

pub use inertial::SimulatedImu;
pub use odometry::{SimulatedOdometry, WheelSlip};
pub use source::SimulatorSource;

use crate::catalogue::{self, build, nearest_name};
use crate::disparity::DepthModel;
use crate::error::SimulatorError;
use crate::kept::Kept;
use crate::lens::Lens;
use crate::path::Path;
use crate::pixels::Pixels;
use crate::scene::Scene;
use crate::sensor::Sensor;
use crate::shutter::{Shutter, Sight};
use std::sync::Arc;
use stillpoint_geometry::{Camera, Se3, Vec2, Vec3};
use stillpoint_imaging::{ColourImage, DepthImage, FrameId, RgbdFrame};

/// Configuration of the simulator.
#[derive(Clone, Debug, PartialEq)]
pub struct SimulatorConfig {
    /// One of [`scene_names`](crate::scene_names).
    pub scene: String,
    /// Determines layout, textures, hand tremor and noise.
    pub seed: u64,
    /// Number of frames; `None` for the scene's own length.
    pub frames: Option<usize>,
    /// Frames per second, 1 to 1000. The duration of the scene does not change.
    pub rate: f64,
    /// Scale of all lengths including the camera's path, 0.01 to 100: ideal images stay the same, and the sensor model is applied to the
    /// scaled depths.
    pub scale: f64,
    /// Without noise the images are ideal: no blur, vignetting, exposure change, noise, quantisation or holes.
    pub noise: bool,
    /// Mean delay of the depth image after the colour image, s; it drifts by 70 % to both sides, as the two cameras of a Kinect are
    /// unsynchronised.
    pub depth_delay: f64,
    /// Exposure timing, with noise or without; `None` for the scene's own shutter, which is global and instantaneous in most scenes.
    pub shutter: Option<Shutter>,
    /// Depth error model; `None` for the scene's own.
    pub depth_model: Option<DepthModel>,
    /// The camera of colour and depth: any size from 32 to 4096 px, with or without distortion.
    pub camera: Camera,
}

impl Default for SimulatorConfig {
    fn default() -> Self {
        Self {
            scene: "xyz".to_owned(),
            seed: 0,
            frames: None,
            rate: 30.0,
            scale: 1.0,
            noise: true,
            depth_delay: 0.01,
            shutter: None,
            depth_model: None,
            camera: Camera::pinhole(640, 480, [535.0, 535.0, 319.5, 239.5]),
        }
    }
}

/// A simulated RGB-D recording with exact poses. Every frame is a pure function of configuration and index.
pub struct Simulator {
    camera: Camera,
    lens: Lens,
    scene: Scene,
    path: Path,
    sensor: Sensor,
    length: usize,
    seed: u64,
    rate: f64,
    scale: f64,
    noise: bool,
    depth_delay: f64,
    shutter: Shutter,
    depth_model: DepthModel,
    kept: Kept,
}

impl Simulator {
    /// Builds the scene and paints its textures.
    ///
    /// # Errors
    /// [`SimulatorError`] for an unknown scene, a rate or scale out of range, a delay or shutter time longer than a frame, or a camera out
    /// of range.
    pub fn new(config: &SimulatorConfig) -> Result<Self, SimulatorError> {
        if !(1.0..=1000.0).contains(&config.rate) {
            return Err(SimulatorError::Rate(config.rate));
        }
        if !(0.0..=1.0 / config.rate).contains(&config.depth_delay) {
            return Err(SimulatorError::DepthDelay(config.depth_delay));
        }
        if !(0.01..=100.0).contains(&config.scale) {
            return Err(SimulatorError::Scale(config.scale));
        }
        if !can_render(&config.camera) {
            return Err(SimulatorError::Camera(Box::new(config.camera)));
        }
        let seed = config.seed;
        let Some((scene, path)) = build(&config.scene, seed) else {
            return Err(SimulatorError::UnknownScene {
                found: config.scene.clone(),
                nearest: nearest_name(&config.scene),
            });
        };
        let (own_shutter, own_model) = catalogue::camera(&config.scene);
        let shutter = match config.shutter {
            Some(shutter) if !shutter.fits(config.rate) => {
                return Err(SimulatorError::Shutter(shutter));
            }
            Some(shutter) => shutter,
            None => own_shutter.at_rate(config.rate),
        };
        let lens = Lens::new(&config.camera);
        // A folding or diverging lens model would need an unbounded view.
        if lens.rendered.width.max(lens.rendered.height) > 8192 || lens.rendered.width == 0 {
            return Err(SimulatorError::Camera(Box::new(config.camera)));
        }
        let default_length = (path.duration() * config.rate).round() as usize;
        Ok(Self {
            sensor: Sensor::new(&lens, seed),
            camera: config.camera,
            lens,
            scene,
            length: config.frames.unwrap_or(default_length),
            path,
            seed,
            rate: config.rate,
            scale: config.scale,
            noise: config.noise,
            depth_delay: config.depth_delay,
            shutter,
            depth_model: config.depth_model.unwrap_or(own_model),
            kept: Kept::new(config),
        })
    }

    /// The camera of the configuration.
    #[must_use]
    pub fn camera(&self) -> &Camera {
        &self.camera
    }

    /// Exposure timing of the images.
    #[must_use]
    pub fn shutter(&self) -> &Shutter {
        &self.shutter
    }

    /// Number of frames.
    #[must_use]
    pub fn len(&self) -> usize {
        self.length
    }

    /// True when there are no frames.
    #[must_use]
    pub fn is_empty(&self) -> bool {
        self.length == 0
    }

    /// Stamp of a frame's colour image, s.
    #[must_use]
    pub fn stamp(&self, index: usize) -> f64 {
        index as f64 / self.rate
    }

    /// Stamp of a frame's depth image, s.
    #[must_use]
    pub fn depth_stamp(&self, index: usize) -> f64 {
        let stamp = self.stamp(index);
        stamp + self.depth_delay * (1.0 + 0.7 * libm::sin(0.8 * stamp))
    }

    /// The exact pose at any time, s.
    #[must_use]
    pub fn world_from_camera(&self, stamp: f64) -> Se3 {
        let mut pose = self.path.world_from_camera(stamp);
        pose.translation *= self.scale;
        pose
    }

    /// The exact pose at each colour stamp.
    #[must_use]
    pub fn ground_truth(&self) -> Vec<(f64, Se3)> {
        (0..self.length)
            .map(|i| (self.stamp(i), self.world_from_camera(self.stamp(i))))
            .collect()
    }

    /// A frame without its colour image; frames may be requested in any order.
    #[must_use]
    pub fn frame(&self, index: usize) -> RgbdFrame {
        let mut frame = self.frame_with_colour(index);
        frame.colour = None;
        frame
    }

    /// A frame with its colour image, of which the grey image is the luma.
    #[must_use]
    pub fn frame_with_colour(&self, index: usize) -> RgbdFrame {
        let colour = self.colour(index);
        RgbdFrame {
            id: FrameId(index as u32),
            stamp: self.stamp(index),
            depth_stamp: self.depth_stamp(index),
            gray: colour.to_gray(),
            depth: self.depth(index),
            colour: Some(Arc::new(colour)),
        }
    }

    /// A frame's colour image alone.
    #[must_use]
    pub fn colour(&self, index: usize) -> ColourImage {
        let (w, h) = (self.camera.width as usize, self.camera.height as usize);
        let render = || self.exposed(w, index);
        let bytes = self.kept.bytes("colour", index, render);
        ColourImage::from_vec(w, h, bytes).unwrap_or_default()
    }

    /// The bytes of a colour image of this width.
    fn exposed(&self, width: usize, index: usize) -> Vec<u8> {
        let stamp = self.stamp(index);
        let mut ideal = self.sight().colour(stamp, &self.shutter);
        if self.noise {
            let number = index as u64;
            return self.sensor.record_colour(&mut ideal, width, stamp, number);
        }
        ideal.iter().map(|v| (v + 0.5) as u8).collect()
    }

    /// A frame's depth image alone, m.
    #[must_use]
    pub fn depth(&self, index: usize) -> DepthImage {
        let (w, h) = (self.camera.width as usize, self.camera.height as usize);
        let render = || self.measured(index).1;
        let data = self.kept.floats("depth", index, render);
        DepthImage::from_vec(w, h, data).unwrap_or_default()
    }

    /// For each static object of [`Self::things`]: its pixels in a frame's depth image, and the number of them with depth. Depth cameras do
    /// not measure dark and distant surfaces.
    #[must_use]
    pub fn depth_px(&self, index: usize) -> Vec<[usize; 2]> {
        let (view, depth) = self.measured(index);
        let depth = DepthImage::from_vec(view.width, view.height, depth).unwrap_or_default();
        let mut counts = vec![[0; 2]; self.scene.things().len()];
        for (k, z) in depth.data().iter().enumerate() {
            let thing = view.face(k).map_or(0, |f| usize::from(f.thing));
            if let Some(count) = thing.checked_sub(1).and_then(|n| counts.get_mut(n)) {
                count[0] += 1;
                count[1] += usize::from(*z > 0.0);
            }
        }
        counts
    }

    /// The visible faces of a frame's depth image, and the measured depths.
    fn measured(&self, index: usize) -> (Pixels, Vec<f32>) {
        let stamp = self.depth_stamp(index);
        let mut view = self.sight().pixels(stamp, self.shutter.depth_readout);
        view.scale(self.scale);
        let (focal, number) = (self.camera.fx as f32, index as u64);
        let depth = match self.depth_model {
            _ if !self.noise => view.inverse_depth.iter().map(|w| 1.0 / w).collect(),
            DepthModel::Independent => self.sensor.record_depth(&view, focal, number),
            DepthModel::StructuredLight => self.sensor.match_pattern(&view, focal, number),
        };
        (view, depth)
    }

    /// The static surfaces as convex planar polygons in the world, m; corners counter-clockwise as seen from outside.
    #[must_use]
    pub fn static_surfaces(&self) -> Vec<Vec<Vec3>> {
        let scaled =
            |face: &crate::scene::Face| face.vertices.iter().map(|v| v * self.scale).collect();
        self.scene.fixed().iter().map(scaled).collect()
    }

    fn sight(&self) -> Sight<'_> {
        Sight {
            scene: &self.scene,
            path: &self.path,
            lens: &self.lens,
        }
    }

    /// The frames in order, with colour if `colour` is set.
    #[must_use]
    pub fn source(self) -> SimulatorSource {
        SimulatorSource::new(self)
    }
}

fn can_render(camera: &Camera) -> bool {
    let size = 32..=4096;
    let focal = 16.0..=8192.0;
    let centre = camera.contains(Vec2::new(camera.cx, camera.cy));
    let sizes = size.contains(&camera.width) && size.contains(&camera.height);
    let d = camera.distortion;
    let finite = [d.k1, d.k2, d.p1, d.p2, d.k3].iter().all(|k| k.is_finite());
    finite && sizes && focal.contains(&camera.fx) && focal.contains(&camera.fy) && centre
}

#[cfg(test)]
mod tests;
