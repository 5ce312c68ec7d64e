//! A frame as it is integrated: undistorted depth without moving regions, and reduced images of colour and movers.

use crate::config::DenseConfig;
use stillpoint_geometry::{Camera, Vec2};
use stillpoint_imaging::RgbdFrame;

/// Depth units per metre: those of the TUM data sets, and a multiple of cameras that measure in millimetres.
pub(crate) const PER_METRE: f32 = 5000.0;
/// Image pixels along a side of a colour pixel: at 2 m some 15 mm, a voxel.
pub(crate) const COLOUR_PX: usize = 4;
/// Image pixels along a side of a mover pixel.
pub(crate) const MOVER_PX: usize = 8;

#[derive(Clone, Debug, Default, PartialEq)]
pub(crate) struct Observation {
    pub(crate) depth_stamp: f64,
    /// px.
    pub(crate) width: usize,
    /// px.
    pub(crate) height: usize,
    /// Depths of the pinhole image in units of `1 / PER_METRE`, row by row; 0 where missing or moving.
    pub(crate) depth: Vec<u16>,
    /// Depths of moving regions, one for every `MOVER_PX` pixels; 0 elsewhere.
    pub(crate) movers: Vec<u16>,
    /// Red, green, blue (lowest byte first), one for every `COLOUR_PX` pixels.
    pub(crate) colour: Vec<u32>,
    /// Divisor of the integration weights.
    pub(crate) doubt: u8,
}

impl Observation {
    pub(crate) fn colour_width(&self) -> usize {
        self.width.div_ceil(COLOUR_PX)
    }

    pub(crate) fn colour_height(&self) -> usize {
        self.height.div_ceil(COLOUR_PX)
    }

    pub(crate) fn mover_width(&self) -> usize {
        self.width.div_ceil(MOVER_PX)
    }

    pub(crate) fn mover_height(&self) -> usize {
        self.height.div_ceil(MOVER_PX)
    }
}

const NOWHERE: u32 = u32::MAX;

pub(crate) struct Rectifier {
    pub(crate) camera: Camera,
    /// Per pixel of the pinhole image, the nearest raw pixel; `None` if both images are equal.
    source: Option<Vec<u32>>,
    least: u16,
}

impl Rectifier {
    pub(crate) fn new(camera: &Camera, config: &DenseConfig) -> Self {
        let (w, h) = (camera.width as usize, camera.height as usize);
        let of = |i: usize| {
            let raw = camera.distort(Vec2::new((i % w) as f64, (i / w) as f64));
            let (x, y) = (raw.x + 0.5, raw.y + 0.5);
            let inside = x >= 0.0 && y >= 0.0 && x < w as f64 && y < h as f64;
            if inside {
                (y as usize * w + x as usize) as u32
            } else {
                NOWHERE
            }
        };
        let bent = !camera.distortion.is_zero();
        Self {
            camera: camera.rectified(),
            source: bent.then(|| (0..w * h).map(of).collect()),
            least: units(config.min_depth as f32),
        }
    }

    /// Converts a frame; `moving` has one entry per raw pixel, true where something moves, or is empty.
    pub(crate) fn take(&self, frame: &RgbdFrame, moving: &[bool], doubt: u8, to: &mut Observation) {
        let (w, h) = (frame.depth.width(), frame.depth.height());
        (to.width, to.height, to.doubt) = (w, h, doubt);
        to.depth_stamp = frame.depth_stamp;
        to.depth.clear();
        to.movers.clear();
        to.movers.resize(to.mover_width() * to.mover_height(), 0);
        let raw = frame.depth.data();
        let value = |i: usize| match units(raw[i]) {
            z if z < self.least => 0,
            z => z,
        };
        match &self.source {
            None => to.depth.extend((0..w * h).map(value)),
            Some(source) => to.depth.extend(source.iter().map(|s| match *s {
                NOWHERE => 0,
                s => value(s as usize),
            })),
        }
        if !moving.is_empty() {
            self.take_out(moving, to);
        }
        self.colours(frame, to);
    }

    /// Removes moving pixels from the depth, and records them as movers.
    fn take_out(&self, moving: &[bool], to: &mut Observation) {
        let (w, coarse) = (to.width, to.mover_width());
        for (i, z) in to.depth.iter_mut().enumerate() {
            let raw = self.source.as_ref().map_or(i, |s| s[i] as usize);
            if *z == 0 || !moving.get(raw).is_some_and(|m| *m) {
                continue;
            }
            let at = i / w / MOVER_PX * coarse + i % w / MOVER_PX;
            to.movers[at] = *z;
            *z = 0;
        }
    }

    fn colours(&self, frame: &RgbdFrame, to: &mut Observation) {
        let (w, h) = (to.width, to.height);
        to.colour.clear();
        for y in 0..to.colour_height() {
            for x in 0..to.colour_width() {
                // The mean of the four central pixels.
                let (x0, y0) = (
                    (COLOUR_PX * x + 1).min(w - 1),
                    (COLOUR_PX * y + 1).min(h - 1),
                );
                let (x1, y1) = ((x0 + 1).min(w - 1), (y0 + 1).min(h - 1));
                let mut sum = [2_u32; 3];
                for i in [y0 * w + x0, y0 * w + x1, y1 * w + x0, y1 * w + x1] {
                    let i = self.source.as_ref().map_or(i, |s| s[i] as usize);
                    let rgb = colour_at(frame, i);
                    (0..3).for_each(|k| sum[k] += u32::from(rgb[k]));
                }
                to.colour
                    .push((sum[0] / 4) | ((sum[1] / 4) << 8) | ((sum[2] / 4) << 16));
            }
        }
    }
}

fn colour_at(frame: &RgbdFrame, i: usize) -> [u8; 3] {
    match &frame.colour {
        Some(c) => {
            let rgb = c.data().get(3 * i..3 * i + 3);
            rgb.map_or([0; 3], |p| [p[0], p[1], p[2]])
        }
        None => [frame.gray.data().get(i).copied().unwrap_or(0); 3],
    }
}

/// A depth in stored units: 0 for none, and beyond 13.1 m.
pub(crate) fn units(z: f32) -> u16 {
    let v = z * PER_METRE + 0.5;
    if v < 65535.0 { v as u16 } else { 0 }
}
