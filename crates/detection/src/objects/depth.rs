//! Surfaces in a box, robust against background and foreground.

use super::common::PART;
use crate::BoundingBox;
use stillpoint_imaging::CoarseDepth;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct DepthMode {
    /// Median, m.
    pub(super) depth: f64,
    /// Nearest and farthest depth, m.
    pub(super) range: [f64; 2],
    /// Its share of the cells with depth.
    pub(super) share: f64,
}

/// Part of the width and height of a box, as shares, that certainly contains the object: the background shows at the
/// sides (section 14 of docs/algorithm.md).
const CENTRAL: [f64; 2] = [0.5, 0.7];
/// Depth extent of a surface, m: a body with its arms. Measured: with 0.5 real people have a fifth more ghosts, and
/// simulated people are exchanged as often.
const THICKNESS: f64 = 0.4;
/// Rows and columns of cells sampled in a box, fewer than twice as many: shares of a thousand cells have a standard
/// deviation of 2 %.
pub(super) const MOST_CELLS: usize = 32;

/// The surfaces that fill a relevant part of the centre of a box, nearest first; empty without depth.
pub(super) fn modes(depth: &CoarseDepth, bounds: &BoundingBox) -> Vec<DepthMode> {
    let mut found = central_depths(depth, bounds);
    found.sort_by(f64::total_cmp);
    let wanted = (PART * found.len() as f64).max(1.0);
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

/// Depths of the cells centred in the central part of the box.
pub(super) fn central_depths(depth: &CoarseDepth, bounds: &BoundingBox) -> Vec<f64> {
    let [u, v] = bounds.centre();
    let half_width = bounds.width() / 2.0 * CENTRAL[0];
    let half_height = bounds.height() / 2.0 * CENTRAL[1];
    let cell = depth.cell().max(1) as f64;
    let range = |from: f64, to: f64, end: usize| {
        let first = ((from / cell).floor() - 1.0).max(0.0) as usize;
        let last = ((to / cell).ceil() + 1.0).max(0.0) as usize;
        first.min(end)..last.min(end)
    };
    let columns = range(u - half_width, u + half_width, depth.width());
    let rows = range(v - half_height, v + half_height, depth.height());
    let step = (columns.len().max(rows.len()) / MOST_CELLS).max(1);
    let mut found = Vec::new();
    for y in rows.step_by(step) {
        for x in columns.clone().step_by(step) {
            let [cu, cv] = depth.centre(x, y);
            if (cu - u).abs() <= half_width && (cv - v).abs() <= half_height {
                found.extend(depth.get(x, y).map(f64::from));
            }
        }
    }
    found
}

/// Number of sorted depths within a surface's thickness of the first.
fn within(sorted: &[f64]) -> usize {
    let Some(first) = sorted.first() else {
        return 0;
    };
    sorted.partition_point(|z| *z <= first + THICKNESS)
}

/// Start of the nearest dominant surface: of the windows that overlap the first dominant one, the fullest.
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

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::DepthImage;

    const BOX: BoundingBox = BoundingBox {
        x0: 40.0,
        y0: 40.0,
        x1: 120.0,
        y1: 140.0,
    };

    fn depth_of(f: impl Fn(usize, usize) -> f32) -> CoarseDepth {
        let data = (0..20).flat_map(|y| (0..20).map(move |x| (x, y)));
        let cells: Vec<f32> = data.map(|(x, y)| f(x, y)).collect();
        let pixels = (0..160 * 160).map(|i| cells[i / 160 / 8 * 20 + i % 160 / 8]);
        CoarseDepth::new(
            &DepthImage::from_vec(160, 160, pixels.collect()).unwrap(),
            8,
        )
    }

    #[test]
    fn body_in_front_of_a_wall_is_the_nearer_surface() {
        // A slanted body 3 of 5 central cells wide, a wall 2 m behind it.
        let depth = depth_of(|x, y| {
            if (7..11).contains(&x) {
                2.0 + y as f32 * 0.01
            } else {
                4.0
            }
        });
        let found = modes(&depth, &BOX);
        assert_eq!(found.len(), 2, "{found:?}");
        assert!((found[0].depth - 2.1).abs() < 0.05, "{found:?}");
        assert!(found[0].range[0] >= 2.0 && found[0].range[1] < 2.25);
        assert!((found[1].depth - 4.0).abs() < 1e-6);
        assert!((found[0].share + found[1].share - 1.0).abs() < 1e-9);
    }

    #[test]
    fn few_near_cells_are_not_a_surface() {
        let near = depth_of(|x, y| if x == 9 && y < 10 { 0.8 } else { 3.0 });
        let found = modes(&near, &BOX);
        assert_eq!(found.len(), 1, "{found:?}");
        assert!((found[0].depth - 3.0).abs() < 1e-6);
    }

    #[test]
    fn fullest_depth_window_wins() {
        // Stray cells in front of the body are not a surface and do not bias it.
        let found = modes(
            &depth_of(|x, y| if (x + y) % 5 == 0 { 1.7 } else { 2.2 }),
            &BOX,
        );
        assert!((found[0].depth - 2.2).abs() < 1e-6, "{found:?}");
    }

    #[test]
    fn missing_depth_has_no_surface() {
        assert!(modes(&depth_of(|_, _| 0.0), &BOX).is_empty());
        assert!(modes(&CoarseDepth::default(), &BOX).is_empty());
        assert!(modes(&depth_of(|_, _| 2.0), &BoundingBox::default()).is_empty());
    }
}
