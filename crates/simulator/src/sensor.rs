//! Degrades ideal images to those of a Kinect-like camera.
//!
//! Blur, vignetting, exposure and noise of the colour image; noise, quantisation and holes of the depth image. The depth noise follows
//! Nguyen, Izadi and Lovell (3DIMPVT 2012), the quantisation Khoshelham and Elberink (Sensors 2012).

use crate::lens::Lens;
use crate::pixels::Pixels;
use crate::random::{self, Normal, Purpose};
use stillpoint_geometry::Vec2;

pub(crate) struct Sensor {
    pub(crate) normal: Normal,
    pub(crate) seed: u64,
    /// Vignetting factor of each pixel.
    vignette: Vec<f32>,
    /// Length of the ray (x, y, 1) through each pixel.
    pub(crate) ray: Vec<f32>,
}

/// Weight of each of the two neighbours in the point spread function, along rows and along columns.
const SPREAD: f32 = 0.08;
/// Read noise, grey levels.
const READ_NOISE: f32 = 1.5;
/// Variance per grey level of signal: photon noise.
const PHOTON_NOISE: f32 = 0.022;

/// Baseline between the infrared projector and its camera, m.
pub(crate) const BASELINE: f32 = 0.075;
/// Measurable depth range, m.
pub(crate) const RANGE: [f32; 2] = [0.4, 7.0];
/// Disparities are multiples of this, px.
pub(crate) const DISPARITY_STEP: f32 = 0.125;
/// Approximate minimum infrared signal (reflectivity x cosine / depth^2) of a measurement.
pub(crate) const SIGNAL: f32 = 0.009;
/// Borders without depth after registration to the colour camera: left, top, right, bottom, px of 640 x 480.
pub(crate) const BORDER: [usize; 4] = [10, 28, 34, 4];

impl Sensor {
    pub(crate) fn new(lens: &Lens, seed: u64) -> Self {
        let camera = &lens.rendered;
        let mut ray = Vec::with_capacity(lens.width * lens.height);
        for y in 0..lens.height {
            for x in 0..lens.width {
                let [u, v] = lens.place(x, y);
                ray.push(camera.ray(Vec2::new(u, v)).norm() as f32);
            }
        }
        // Half of the natural cos^4 law, as lenses compensate it.
        let vignette = ray.iter().map(|l| 1.0 / (l * l)).collect();
        Self {
            normal: Normal::new(),
            seed,
            vignette,
            ray,
        }
    }

    /// Exposure factor at a stamp: automatic exposure drifts by some percent.
    fn exposure(stamp: f64) -> f32 {
        let slow = libm::sin(0.9 * stamp + 0.5) + 0.5 * libm::sin(2.3 * stamp);
        (1.0 + 0.045 * slow) as f32
    }

    /// Colour bytes from ideal RGB rows in grey levels: vignetting, exposure, blur, noise, clipping.
    pub(crate) fn record_colour(
        &self,
        ideal: &mut [f32],
        width: usize,
        stamp: f64,
        index: u64,
    ) -> Vec<u8> {
        let exposure = Self::exposure(stamp);
        for (pixel, v) in ideal.chunks_exact_mut(3).zip(&self.vignette) {
            pixel.iter_mut().for_each(|p| *p *= v * exposure);
        }
        let stride = 3 * width;
        let height = ideal.len() / stride;
        let key = random::key(self.seed, Purpose::Colour, index);
        let mut bytes = vec![0_u8; ideal.len()];
        let mut column = vec![0.0_f32; stride];
        let mut row = vec![0.0_f32; stride];
        for y in 0..height {
            let line = |y: usize| &ideal[y * stride..(y + 1) * stride];
            let (above, here, below) = (
                line(y.saturating_sub(1)),
                line(y),
                line((y + 1).min(height - 1)),
            );
            for i in 0..stride {
                column[i] = SPREAD * (above[i] + below[i]) + (1.0 - 2.0 * SPREAD) * here[i];
            }
            row.copy_from_slice(&column);
            for i in 3..stride - 3 {
                row[i] =
                    SPREAD * (column[i - 3] + column[i + 3]) + (1.0 - 2.0 * SPREAD) * column[i];
            }
            let out = &mut bytes[y * stride..(y + 1) * stride];
            for (x, (out, value)) in out.chunks_exact_mut(3).zip(row.chunks_exact(3)).enumerate() {
                let bits = random::bits(key, (y * width + x) as u64);
                for c in 0..3 {
                    let sigma = (READ_NOISE * READ_NOISE + PHOTON_NOISE * value[c]).sqrt();
                    let noisy = value[c] + sigma * self.normal.at(bits >> (12 * c));
                    out[c] = (noisy + 0.5) as u8;
                }
            }
        }
        bytes
    }

    /// Depth in metres from a view with one sample per pixel: holes, noise, quantisation.
    pub(crate) fn record_depth(&self, view: &Pixels, focal: f32, index: u64) -> Vec<f32> {
        let (w, h) = (view.width, view.height);
        let key = random::key(self.seed, Purpose::Depth, index);
        let patches = Patches::new(random::key(self.seed, Purpose::Holes, index), w, h);
        let mut depth = vec![0.0_f32; w * h];
        let mut lit = vec![false; w];
        let mut luck = vec![0.0_f32; w];
        let scale = [w as f32 / 640.0, h as f32 / 480.0];
        let border = [0, 1, 2, 3].map(|k| (BORDER[k] as f32 * scale[k % 2]) as usize);
        for y in border[1]..h - border[3] {
            let disparities = &view.inverse_depth[y * w..(y + 1) * w];
            find_lit(disparities, focal, &mut lit);
            patches.row(y, &mut luck);
            let measured = lit.iter().enumerate().take(w - border[2]).skip(border[0]);
            for (x, lit) in measured {
                let i = y * w + x;
                let inverse = view.inverse_depth[i];
                let Some(face) = view.face(i).filter(|_| *lit) else {
                    continue;
                };
                let z = 1.0 / inverse;
                let signal = face.infrared_back(z, self.ray[i]) * inverse * inverse;
                let patch = luck[x];
                // An unlucky patch needs three times the signal of a lucky one.
                if signal < SIGNAL * (1.0 + 0.6 * patch) || ragged(view, x, y, focal, patch) {
                    continue;
                }
                let bits = random::bits(key, i as u64);
                depth[i] = measure(z, focal, self.normal.at(bits));
            }
        }
        depth
    }
}

/// One measurement of a depth `z` (m), with a standard normal number; 0 out of range.
fn measure(z: f32, focal: f32, normal: f32) -> f32 {
    if !(RANGE[0]..=RANGE[1]).contains(&z) {
        return 0.0;
    }
    let d = z - 0.4;
    let noisy = z + normal * (0.0012 + 0.0019 * d * d);
    let unit = focal * BASELINE / DISPARITY_STEP;
    // Disparities are positive, so that truncation rounds down.
    let steps = (unit / noisy + 0.5) as i32 as f32;
    unit / steps
}

/// Marks the pixels of a row that the projector lights. It sits a baseline to the right of the infrared camera and sees a pixel at column
/// x - focal * baseline / z; from right to left these columns decrease, except in the shadow of something nearer.
pub(crate) fn find_lit(inverse_depth: &[f32], focal: f32, lit: &mut [bool]) {
    let shift = focal * BASELINE;
    let mut lowest = f32::MAX;
    for x in (0..inverse_depth.len()).rev() {
        let column = x as i32 as f32 - shift * inverse_depth[x];
        lit[x] = column < lowest;
        lowest = lowest.min(column);
    }
}

/// True where the matching window straddles a depth edge and finds no match; the distance from the edge varies in patches.
fn ragged(view: &Pixels, x: usize, y: usize, focal: f32, patch: f32) -> bool {
    let reach = (2.2 + 1.9 * patch) as usize;
    if reach == 0 || x < reach || y < reach || x + reach >= view.width || y + reach >= view.height {
        return false;
    }
    let i = y * view.width + x;
    let w = &view.inverse_depth;
    // Second differences of the disparity are zero on any plane, so that slanted faces are no edges.
    let limit = EDGE / (focal * BASELINE);
    let bend = |step: usize| (w[i - step] + w[i + step] - 2.0 * w[i]).abs() > limit;
    bend(reach) || bend(reach * view.width)
}

/// Disparity bend above which matching fails, px.
const EDGE: f32 = 1.2;

/// Smooth noise of about unit variance, in patches of some pixels.
pub(crate) struct Patches {
    values: Vec<f32>,
    columns: usize,
}

/// Side of a cell of [`Patches`], px.
const CELL: usize = 5;

impl Patches {
    pub(crate) fn new(key: u64, width: usize, height: usize) -> Self {
        let (columns, rows) = (width / CELL + 2, height / CELL + 2);
        let values = (0..columns * rows)
            .map(|i| (random::bits(key, i as u64) >> 40) as f32 / (1 << 23) as f32 - 1.0)
            .map(|uniform| 1.7 * uniform)
            .collect();
        Self { values, columns }
    }

    #[inline]
    pub(crate) fn at(&self, x: usize, y: usize) -> f32 {
        let (i, j) = (x / CELL, y / CELL);
        let (fx, fy) = (
            (x % CELL) as f32 / CELL as f32,
            (y % CELL) as f32 / CELL as f32,
        );
        let v = |i: usize, j: usize| self.values[j * self.columns + i];
        let top = v(i, j) + (v(i + 1, j) - v(i, j)) * fx;
        let bottom = v(i, j + 1) + (v(i + 1, j + 1) - v(i, j + 1)) * fx;
        top + (bottom - top) * fy
    }

    fn row(&self, y: usize, out: &mut [f32]) {
        let fy = (y % CELL) as f32 / CELL as f32;
        let upper = &self.values[y / CELL * self.columns..][..2 * self.columns];
        for (i, out) in out.chunks_mut(CELL).enumerate() {
            let [a, b] = [upper[i], upper[i + 1]];
            let [c, d] = [upper[self.columns + i], upper[self.columns + i + 1]];
            for (k, out) in out.iter_mut().enumerate() {
                let fx = k as f32 / CELL as f32;
                let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
                *out = top + (bottom - top) * fy;
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn patch_rows_equal_single_pixels() {
        let patches = Patches::new(5, 43, 31);
        for y in 0..31 {
            let mut row = vec![0.0; 43];
            patches.row(y, &mut row);
            let single: Vec<f32> = (0..43).map(|x| patches.at(x, y)).collect();
            assert_eq!(row, single);
        }
    }

    #[test]
    fn depth_noise_and_quantisation_follow_the_model() {
        let normal = Normal::new();
        for z in [0.8_f32, 1.5, 3.0, 5.0] {
            let n = 20_000;
            let (mut sum, mut squares) = (0.0_f64, 0.0_f64);
            for i in 0..n {
                let e = f64::from(measure(z, 535.0, normal.at(random::bits(3, i))) - z);
                sum += e;
                squares += e * e;
            }
            let sigma = 0.0012 + 0.0019 * f64::from(z - 0.4) * f64::from(z - 0.4);
            let step = f64::from(z * z) * 0.125 / (535.0 * 0.075);
            let expected = sigma * sigma + step * step / 12.0;
            let found = squares / n as f64;
            assert!(
                (found / expected - 1.0).abs() < 0.15,
                "{z} m: variance {found} for {expected}"
            );
            assert!((sum / n as f64).abs() < 0.25 * expected.sqrt());
        }
        assert_eq!(measure(0.39, 535.0, 0.0), 0.0);
        assert_eq!(measure(7.5, 535.0, 0.0), 0.0);
    }

    #[test]
    fn depth_shadow_falls_to_the_left() {
        // An object at 1 m before a wall at 2 m: disparities 40.1 and 20.1 px, so the shadow is 20 px wide.
        let inverse: Vec<f32> = (0..200)
            .map(|x| if (100..120).contains(&x) { 1.0 } else { 0.5 })
            .collect();
        let mut lit = vec![false; 200];
        find_lit(&inverse, 535.0, &mut lit);
        let dark: Vec<usize> = (0..200).filter(|&x| !lit[x]).collect();
        assert_eq!((dark[0], dark[dark.len() - 1]), (80, 99));
    }
}
