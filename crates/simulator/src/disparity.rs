//! Depth errors of a structured-light camera: in disparity, displaced sideways, and correlated between neighbours.
//!
//! Unlike `sensor`, which draws independent errors per pixel, this models a matching window that finds one disparity per patch of pixels,
//! so that neighbours share errors; borders are displaced sideways by a pixel (Nguyen, Izadi and Lovell, 3DIMPVT 2012, equation 1), so that
//! depth there is that of the other surface; disparities are noisy and quantised (Khoshelham and Elberink, Sensors 2012: 4 cm at 5 m); the
//! lens leaves a fixed pattern (Herrera, Kannala and Heikkila, PAMI 2012); and surfaces at grazing angles give no depth.

use crate::pixels::Pixels;
use crate::random::{self, Purpose};
use crate::sensor::{BASELINE, BORDER, DISPARITY_STEP, Patches, RANGE, SIGNAL, Sensor, find_lit};

/// Error model of depth images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum DepthModel {
    /// Independent noise of `0.0012 + 0.0019 (z - 0.4)^2` m per pixel, disparity steps, holes about edges.
    #[default]
    Independent,
    /// Correlated disparity errors, sideways displaced borders, a fixed pattern, holes at grazing angles.
    StructuredLight,
}

/// Standard deviation of the independent disparity error of each pixel, px.
const OWN: f32 = 0.04;
/// Standard deviation of the disparity error that neighbouring pixels share, px: with `OWN` it makes 4 cm at 5 m for 40 px m.
const SHARED: f32 = 0.05;
/// Standard deviation of the fixed pattern of disparities, px.
const PATTERN: f32 = 0.04;
/// Side of a cell of the fixed pattern of disparities, in cells of [`Patches`].
const PATTERN_CELL: usize = 12;
/// Maximum angle between a surface's normal and the line of sight, rad (78 degrees); beyond it there is no depth.
const ASLANT: f32 = 1.36;
/// Variation of that angle between patches, rad.
const ASLANT_SPREAD: f32 = 0.07;

struct Luck {
    holes: Patches,
    sideways: [Patches; 2],
    matching: Patches,
    /// Equal in all images.
    pattern: Patches,
}

impl Luck {
    fn new(seed: u64, index: u64, [w, h]: [usize; 2]) -> Self {
        let patches = |purpose, index| Patches::new(random::key(seed, purpose, index), w, h);
        Self {
            holes: patches(Purpose::Holes, index),
            sideways: [
                patches(Purpose::Lateral, 2 * index),
                patches(Purpose::Lateral, 2 * index + 1),
            ],
            matching: patches(Purpose::Matching, index),
            pattern: patches(Purpose::Distortion, 0),
        }
    }
}

impl Sensor {
    /// Depth in metres by [`DepthModel::StructuredLight`].
    pub(crate) fn match_pattern(&self, view: &Pixels, focal: f32, index: u64) -> Vec<f32> {
        let (w, h) = (view.width, view.height);
        let luck = Luck::new(self.seed, index, [w, h]);
        let key = random::key(self.seed, Purpose::Depth, index);
        let mut depth = vec![0.0_f32; w * h];
        let mut lit = vec![false; w * h];
        for (row, lit) in view.inverse_depth.chunks(w).zip(lit.chunks_mut(w)) {
            find_lit(row, focal, lit);
        }
        let scale = [w as f32 / 640.0, h as f32 / 480.0];
        let border = [0, 1, 2, 3].map(|k| (BORDER[k] as f32 * scale[k % 2]) as usize);
        for y in border[1]..h - border[3] {
            for x in border[0]..w - border[2] {
                let i = y * w + x;
                let Some(source) = self.source(view, &luck, [x, y]).filter(|s| lit[*s]) else {
                    continue;
                };
                if !self.answers(view, source, luck.holes.at(x, y)) {
                    continue;
                }
                let error = OWN * self.normal.at(random::bits(key, i as u64))
                    + SHARED * PATCH * luck.matching.at(x, y)
                    + PATTERN * PATCH * luck.pattern.at(x / PATTERN_CELL, y / PATTERN_CELL);
                depth[i] = quantised(view.inverse_depth[source], focal, error);
            }
        }
        depth
    }

    /// The source pixel of a pixel's disparity, displaced sideways depending on the surface angle.
    fn source(&self, view: &Pixels, luck: &Luck, [x, y]: [usize; 2]) -> Option<usize> {
        let i = y * view.width + x;
        let angle = self.angle(view, i)?.min(1.4);
        let sigma = 0.8 + 0.035 * angle / (std::f32::consts::FRAC_PI_2 - angle);
        let off = |k: usize| sigma * PATCH * luck.sideways[k].at(x, y);
        let moved = |p: usize, by: f32, size: usize| {
            // Positions are positive, so that truncation rounds to the nearest.
            ((p as i32 as f32 + by + 0.5).max(0.0) as usize).min(size - 1)
        };
        Some(moved(y, off(1), view.height) * view.width + moved(x, off(0), view.width))
    }

    /// Angle between the surface normal and the line of sight, rad.
    fn angle(&self, view: &Pixels, pixel: usize) -> Option<f32> {
        let z = 1.0 / view.inverse_depth[pixel];
        let cosine = view.face(pixel)?.cosine(z, self.ray[pixel]);
        Some(libm::acosf(cosine.clamp(0.0, 1.0)))
    }

    /// Whether enough of the pattern is reflected.
    fn answers(&self, view: &Pixels, pixel: usize, luck: f32) -> bool {
        let (Some(angle), Some(face)) = (self.angle(view, pixel), view.face(pixel)) else {
            return false;
        };
        let inverse = view.inverse_depth[pixel];
        let signal = face.infrared_back(1.0 / inverse, self.ray[pixel]) * inverse * inverse;
        angle < ASLANT - ASLANT_SPREAD * luck && signal >= SIGNAL * (1.0 + 0.6 * luck)
    }
}

/// Scale that makes the mean variance of interpolated patches one: they are 1.7 times uniform numbers, of whose variance bilinear
/// interpolation leaves 4/9.
const PATCH: f32 = 1.53;

/// The depth of a disparity with an error of `error` px, m; 0 out of range.
fn quantised(inverse: f32, focal: f32, error: f32) -> f32 {
    let z = 1.0 / inverse;
    if !(RANGE[0]..=RANGE[1]).contains(&z) {
        return 0.0;
    }
    let unit = focal * BASELINE / DISPARITY_STEP;
    let steps = (unit * inverse + error / DISPARITY_STEP + 0.5) as i32;
    if steps > 0 { unit / steps as f32 } else { 0.0 }
}

#[cfg(test)]
mod tests;
