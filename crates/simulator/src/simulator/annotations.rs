//! Exact annotations of the frames: truth per pixel, things, and detections.

use super::Simulator;
use crate::raster::{NOTHING, View};
use crate::truth::{self, DetectionNoise, FrameTruth, ScriptedDetection, ThingBox};
use stillpoint_geometry::Camera;
use stillpoint_imaging::GrayImage;

impl Simulator {
    /// The exact movers in a frame, independent of noise: mask and boxes in the middle of the exposure of each row of its colour image.
    #[must_use]
    pub fn truth(&self, index: usize) -> FrameTruth {
        let stamp = self.stamp(index);
        let (w, h) = (self.camera.width as usize, self.camera.height as usize);
        let render = || truth::seen(&self.sight().pixels(stamp, self.shutter.readout));
        let seen = self.kept.bytes("seen", index, render);
        let mut movers = self.scene.movers(stamp);
        for motion in movers.iter_mut().filter_map(|m| m.motion.as_mut()) {
            motion.position = motion.position.map(|v| v * self.scale);
            motion.velocity = motion.velocity.map(|v| v * self.scale);
        }
        truth::truth(&seen, [w, h], &movers, self.scene.things())
    }

    /// Like [`Self::truth`] without static objects. Renders nothing in scenes without movers.
    #[must_use]
    pub fn moving(&self, index: usize) -> FrameTruth {
        if self.scene.is_still() {
            return FrameTruth {
                mask: GrayImage::new(self.lens.width, self.lens.height),
                boxes: Vec::new(),
                things: Vec::new(),
            };
        }
        FrameTruth {
            things: Vec::new(),
            ..self.truth(index)
        }
    }

    /// Number of pixels that object `thing` of [`FrameTruth::things`] would fill in frame `index` unoccluded and in an image twice as wide
    /// and high: gives the visible share of the object.
    #[must_use]
    pub fn whole_px(&self, index: usize, thing: u32) -> usize {
        let camera = Camera {
            width: 2 * self.camera.width,
            height: 2 * self.camera.height,
            cx: self.camera.cx + 0.5 * f64::from(self.camera.width),
            cy: self.camera.cy + 0.5 * f64::from(self.camera.height),
            ..self.camera.rectified()
        };
        let faces = self.scene.fixed().iter();
        let faces = faces.filter(|f| u32::from(f.thing) == thing);
        let pose = self.path.world_from_camera(self.stamp(index));
        let view = View::new(faces, &camera, &pose, 1);
        view.face.iter().filter(|f| **f != NOTHING).count()
    }

    /// The true boxes of all objects of known classes, with their numbers in [`FrameTruth::things`]; then those that a person carries away,
    /// with their numbers in [`FrameTruth::boxes`].
    #[must_use]
    pub fn things(&self) -> Vec<(u32, ThingBox)> {
        let still = self.scene.things().iter().zip(1..).map(|(t, n)| (n, *t));
        let scaled = |(number, thing): (u32, ThingBox)| {
            let centre = thing.centre.map(|v| v * self.scale);
            let size = thing.size.map(|v| v * self.scale);
            let thing = ThingBox {
                centre,
                size,
                ..thing
            };
            (number, thing)
        };
        still.chain(self.scene.taken()).map(scaled).collect()
    }

    /// Simulated detections in a frame with the errors `noise`: persons, and furniture if enabled.
    #[must_use]
    pub fn detections(&self, index: usize, noise: &DetectionNoise) -> Vec<ScriptedDetection> {
        let truth = if noise.things {
            self.truth(index)
        } else {
            self.moving(index)
        };
        self.detections_of(index, &truth, noise)
    }

    /// Like [`Self::detections`], with the frame's truth already known ([`Self::truth`], or [`Self::moving`] if the detector knows no
    /// furniture).
    #[must_use]
    pub fn detections_of(
        &self,
        index: usize,
        truth: &FrameTruth,
        noise: &DetectionNoise,
    ) -> Vec<ScriptedDetection> {
        truth::detections(truth, noise, &self.sensor.normal, index, self.stamp(index))
    }
}
