//! Silhouettes: where a surface ends in the depth image, and what the image shows around there.
//!
//! Answers: at which pixels a nearer surface ends before a farther one, along rows and columns, and how strongly the image changes on both
//! sides of each. What ends in depth mostly ends in the image too, so with registered and synchronous images the profiles have their peak in the
//! middle. Pixels of the nearer surface are taken, since the shadow of a projector and the blindness of a stereo pair lie on the farther
//! one.

use crate::gradient::{Axis, Gradient, PROFILE};
use stillpoint_imaging::DepthImage;

/// Where the next surface is looked for, px: the shadow of a projector 75 mm beside the camera is as wide for a thing at 1 m before a wall at 2 m.
const GAP: usize = 24;
/// How much farther the next surface is, as a share of the depth: noise and slanted surfaces have less.
const STEP: f32 = 0.1;
/// The nearer surface holds its depth to within this share over [`INSIDE`] px.
const FLAT: f32 = 0.04;
const INSIDE: usize = 3;
/// Silhouette pixels of one frame, axis and side at most; the others are spread evenly over the image and say the same.
const QUOTA: usize = 250;

/// A pixel at which a surface ends.
#[derive(Clone, Copy, Debug)]
pub(crate) struct Edge {
    /// The axis along which it ends, and whether that is towards the beginning of the axis.
    pub(crate) axis: Axis,
    pub(crate) backwards: bool,
    pub(crate) x: u16,
    pub(crate) y: u16,
    /// Depth of the surface, m.
    pub(crate) z: f32,
}

/// Silhouettes of one frame.
pub(crate) struct FrameEdges {
    pub(crate) edges: Vec<Edge>,
    /// A profile for each.
    pub(crate) profiles: Vec<f32>,
    /// Sums of the profiles that the image has where a mirrored depth image would have its silhouettes: mirrored left to right,
    /// top to bottom, both; by axis, with their number.
    pub(crate) mirrored: [[MeanProfile; 2]; 3],
}

/// Sum of some profiles.
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

/// The depths column by column.
fn transposed(depth: &DepthImage) -> Vec<f32> {
    // Columns that are written at once: as many floats as a line of the cache has.
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

/// Places (along the line, line) where, along lines of a length and in one direction, the next measurement within [`GAP`] px lies behind.
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
            // Nearly everywhere the next pixel is measured and not behind.
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
    fn a_box_before_a_wall_ends_on_four_sides_in_spite_of_its_shadow() {
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
