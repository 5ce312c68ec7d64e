//! The depth of what is in a box: robust against the background beside it and things in front of it.

use crate::BoundingBox;
use stillpoint_imaging::CoarseDepth;

/// Cells of one surface in a box.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DepthMode {
    /// Median, m.
    pub(super) depth: f64,
    /// Nearest and farthest depth that belong to it, m.
    pub(super) range: [f64; 2],
    /// Its share of the cells with depth.
    pub(super) share: f64,
}

/// Share of the box's width and height in which the object surely is: the background shows at the sides.
const CENTRAL: [f64; 2] = [0.5, 0.7];
/// A surface is what lies within this depth, m: a body with its arms.
const THICKNESS: f64 = 0.4;
/// A surface with less than this share of the cells is a stray one.
const DOMINANT: f64 = 0.25;

/// The surfaces that hold much of the central part of a box, nearest first; empty without depth.
pub(super) fn modes(depth: &CoarseDepth, bounds: &BoundingBox) -> Vec<DepthMode> {
    let mut found = central_depths(depth, bounds);
    found.sort_by(f64::total_cmp);
    let wanted = (DOMINANT * found.len() as f64).max(1.0);
    let mut modes = Vec::new();
    let mut rest = found.as_slice();
    while let Some(start) = dominant_start(rest, wanted) {
        let end = start + within(&rest[start..]);
        let surface = &rest[start..end];
        modes.push(DepthMode {
            depth: surface[surface.len() / 2],
            range: [surface[0], surface[surface.len() - 1]],
            share: surface.len() as f64 / found.len() as f64,
        });
        rest = &rest[end..];
    }
    modes
}

/// Depths of the cells whose middle is in the central part of the box.
fn central_depths(depth: &CoarseDepth, bounds: &BoundingBox) -> Vec<f64> {
    let [u, v] = bounds.centre();
    let half_width = bounds.width() / 2.0 * CENTRAL[0];
    let half_height = bounds.height() / 2.0 * CENTRAL[1];
    let mut found = Vec::new();
    for y in 0..depth.height() {
        for x in 0..depth.width() {
            let [cu, cv] = depth.centre(x, y);
            if (cu - u).abs() <= half_width && (cv - v).abs() <= half_height {
                found.extend(depth.get(x, y).map(f64::from));
            }
        }
    }
    found
}

/// How many of the sorted depths lie within a surface's thickness of the first.
fn within(sorted: &[f64]) -> usize {
    let Some(first) = sorted.first() else {
        return 0;
    };
    sorted.partition_point(|z| *z <= first + THICKNESS)
}

/// Where the nearest dominant surface starts: of the windows that overlap the first dominant one, the fullest.
fn dominant_start(sorted: &[f64], wanted: f64) -> Option<usize> {
    let full = |i: usize| within(&sorted[i..]);
    let first = (0..sorted.len()).find(|&i| full(i) as f64 >= wanted)?;
    let mut best = first;
    for i in first + 1..first + full(first) {
        if full(i) > full(best) {
            best = i;
        }
    }
    Some(best)
}
