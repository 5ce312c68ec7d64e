//! Silhouettes: edges of surfaces in the depth image, and the image gradient around them.
//!
//! Answers: at which pixels a nearer surface ends before a farther one, along rows and columns, and the gradient profile on both sides of
//! each. Depth edges mostly are image edges too, so with registered and synchronous images the profiles peak in the middle. Pixels of the
//! nearer surface are used, since the shadow of a projector and the occlusion of a stereo pair are on the farther one.

use crate::gradient::{Axis, Gradient, PROFILE};
use stillpoint_imaging::DepthImage;

/// Search range for the next surface, px: the shadow of a projector 75 mm beside the camera is as wide for an object at 1 m before a wall
/// at 2 m.
const GAP: usize = 24;
/// Minimum depth step to the next surface, as a fraction of the depth: noise and slanted surfaces have less.
const STEP: f32 = 0.1;
/// The nearer surface is flat to within this fraction over [`INSIDE`] px.
const FLAT: f32 = 0.04;
const INSIDE: usize = 3;
/// Maximum number of silhouette pixels per frame, axis and side; spread evenly over the image, since the others are redundant.
const QUOTA: usize = 250;

/// A pixel at which a surface ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    /// The axis along which it ends, and whether it ends towards the beginning of the axis.
    pub(crate) axis: Axis,
    pub(crate) backwards: bool,
    pub(crate) x: u16,
    pub(crate) y: u16,
    pub(crate) z: f32,
}

pub(crate) struct FrameEdges {
    pub(crate) edges: Vec<Edge>,
    pub(crate) profiles: Vec<f32>,
    /// Sums of the profiles at the silhouettes of a mirrored depth image: mirrored left to right, top to bottom, both; by axis, with their
    /// number.
    pub(crate) mirrored: [[MeanProfile; 2]; 3],
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct MeanProfile {
    pub(crate) sum: [f64; PROFILE],
    pub(crate) count: usize,
}

impl Default for MeanProfile {
    fn default() -> Self {
        Self {
            sum: [0.0; PROFILE],
            count: 0,
        }
    }
}

impl MeanProfile {
    pub(crate) fn add(&mut self, profile: &[f32]) {
        self.count += 1;
        for (sum, value) in self.sum.iter_mut().zip(profile) {
            *sum += f64::from(*value);
        }
    }

    pub(crate) fn merge(&mut self, other: &Self) {
        self.count += other.count;
        for (sum, value) in self.sum.iter_mut().zip(&other.sum) {
            *sum += value;
        }
    }
}

impl FrameEdges {
    pub(crate) fn new(gradient: &Gradient, depth: &DepthImage) -> Self {
        let mut found = Self {
            edges: Vec::new(),
            profiles: Vec::new(),
            mirrored: [[MeanProfile::default(); 2]; 3],
        };
        let (w, h) = (gradient.width, gradient.height);
        if depth.width() != w || depth.height() != h {
            return found;
        }
        let columns = transposed(depth);
        for axis in Axis::BOTH {
            let (lines, length) = match axis {
                Axis::X => (depth.data(), w),
                Axis::Y => (&columns[..], h),
            };
            for backwards in [false, true] {
                let mut at = silhouettes(lines, length, backwards);
                if axis == Axis::Y {
                    at.iter_mut().for_each(|place| *place = (place.1, place.0));
                }
                at.retain(|&(x, y)| gradient.has_room(x, y));
                let stride = at.len().div_ceil(QUOTA).max(1);
                for &(x, y) in at.iter().step_by(stride) {
                    found.add(gradient, (axis, backwards), [x, y], depth.at(x, y));
                }
            }
        }
        found
    }

    fn add(
        &mut self,
        gradient: &Gradient,
        (axis, backwards): (Axis, bool),
        [x, y]: [usize; 2],
        z: f32,
    ) {
        let mut profile = [0.0_f32; PROFILE];
        gradient.profile(axis, x, y, &mut profile);
        self.profiles.extend_from_slice(&profile);
        self.edges.push(Edge {
            axis,
            backwards,
            x: x as u16,
            y: y as u16,
            z,
        });
        let (u, v) = (gradient.width - 1 - x, gradient.height - 1 - y);
        for (k, (x, y)) in [(u, y), (x, v), (u, v)].into_iter().enumerate() {
            if gradient.has_room(x, y) {
                gradient.profile(axis, x, y, &mut profile);
                self.mirrored[k][axis.index()].add(&profile);
            }
        }
    }
}

fn transposed(depth: &DepthImage) -> Vec<f32> {
    // Columns written at once: the floats of one cache line.
    const AT_ONCE: usize = 16;
    let (w, h) = (depth.width(), depth.height());
    let mut columns = vec![0.0; w * h];
    for first in (0..w).step_by(AT_ONCE) {
        let last = (first + AT_ONCE).min(w);
        for y in 0..h {
            for (x, z) in (first..last).zip(&depth.data()[y * w + first..y * w + last]) {
                columns[x * h + y] = *z;
            }
        }
    }
    columns
}

/// Positions (along the line, line) at which, along lines of this length and in one direction, the next measurement within [`GAP`] px is
/// farther.
fn silhouettes(depths: &[f32], length: usize, backwards: bool) -> Vec<(usize, usize)> {
    let mut found = Vec::new();
    let mut turned = vec![0.0_f32; length];
    for (number, line) in depths.chunks_exact(length.max(1)).enumerate() {
        let line = if backwards {
            turned.copy_from_slice(line);
            turned.reverse();
            &turned[..]
        } else {
            line
        };
        let near = line.iter().zip(line.iter().skip(INSIDE));
        let near = near.zip(line.iter().skip(INSIDE + 1)).enumerate();
        for (k, ((&before, &z), &next)) in near {
            let behind = z * (1.0 + STEP);
            // The usual case: the next pixel is measured and not farther.
            if next > 0.0 && next <= behind {
                continue;
            }
            if z <= 0.0 || before <= 0.0 || (before - z).abs() > FLAT * z {
                continue;
            }
            let k = k + INSIDE;
            let end = (k + 1 + GAP).min(length);
            let next = line[k + 1..end].iter().find(|z| **z > 0.0);
            if next.is_some_and(|next| *next > behind) {
                found.push((if backwards { length - 1 - k } else { k }, number));
            }
        }
    }
    found
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_edges_are_found_despite_its_depth_shadow() {
        let (w, h) = (60, 50);
        let mut data = vec![2.0_f32; w * h];
        for y in 10..30 {
            for x in 20..40 {
                data[y * w + x] = 1.0;
            }
            // The shadow at its left.
            for x in 12..20 {
                data[y * w + x] = 0.0;
            }
        }
        let depth = DepthImage::from_vec(w, h, data).unwrap();
        let right = silhouettes(depth.data(), w, false);
        let left = silhouettes(depth.data(), w, true);
        assert!(
            right.len() == 20 && right.iter().all(|p| p.0 == 39),
            "{right:?}"
        );
        assert!(
            left.len() == 20 && left.iter().all(|p| p.0 == 20),
            "{left:?}"
        );
        let bottom = silhouettes(&transposed(&depth), h, false);
        assert!(
            bottom.len() == 20 && bottom.iter().all(|p| p.0 == 29),
            "{bottom:?}"
        );
    }
}
