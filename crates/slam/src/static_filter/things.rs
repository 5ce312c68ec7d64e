//! Which regions are things. Walls, floors and tables are seen to move where they come out behind something, slide along themselves, or mirror.
//!
//! What a detector sees is a thing. Beyond the border of others the scene goes on farther away; what is flat may be a patch of a wall, unless it goes on farther away nearly all around.

use super::Segments;
use super::segments::joined;
use stillpoint_geometry::nalgebra::{Matrix3, Vector3};
use stillpoint_imaging::CoarseDepth;

/// A hole of so many cells is what is too far to be measured; beyond a narrower one is what the surface beside it is compared with, as it is a
/// shadow. Chosen: 48 px, which are 18 cm at 2 m.
const HOLE: usize = 6;
/// Share of a region's border beyond which the scene goes on farther away, at least, and that of a flat one. It is two thirds of that of somebody who sits or
/// stands behind something, and half of that of somebody of whom only a part is seen to move; two sides of a screen are half of its patch's.
const SET_APART: [f64; 2] = [0.35, 0.7];
/// Depths deviate from a plane by this share of them (standard deviation) where a region is flat: 2 cm in 2 m. Bodies deviate by twice that.
const FLAT: f64 = 0.01;
/// Inverse depths of a plane change evenly to within this, 1/m, and this share of their change: four standard deviations of a Kinect's, and the middle of
/// a cell that is not where its depth was measured.
const EVEN: [f32; 2] = [0.006, 0.3];

/// What is known of a region.
#[derive(Clone, Copy, Debug, Default)]
struct Region {
    /// Sides of cells along its border beyond which the scene is farther away, or so far that it has no depth.
    farther: usize,
    /// Those beyond which there is the same surface, or one before it.
    others: usize,
    /// Sums over its cells for the plane through them: of (x, y, 1) with itself, and with the inverse depth.
    square: Matrix3<f64>,
    product: Vector3<f64>,
    /// Squared deviations from the plane, as shares of the depth.
    deviation: f64,
}

impl Region {
    /// Takes the depths of a cell at the border, of the one beside it, and of the one on its other side, m.
    fn meet(&mut self, here: f32, there: f32, before: f32) {
        let one = joined(here, there) || is_plane([before, here, there]);
        if !one && here > 0.0 && there > here {
            self.farther += 1;
        } else {
            self.others += 1;
        }
    }

    fn is_thing(&self) -> bool {
        let cells = self.square[(2, 2)];
        let flat = self.deviation < FLAT * FLAT * cells;
        let needed = SET_APART[usize::from(flat)] * (self.farther + self.others) as f64;
        self.farther > 0 && self.farther as f64 >= needed
    }
}

/// Whether the depths of three cells in a row, m, are those of a plane, however oblique: their inverses change evenly then.
fn is_plane(depths: [f32; 3]) -> bool {
    let [before, here, there] = depths.map(f32::recip);
    let slope = (here - before).abs();
    depths.iter().all(|z| *z > 0.0)
        && (here - before - (there - here)).abs() < EVEN[0] + EVEN[1] * slope
}

/// Which cells belong to a thing.
pub(super) fn things(segments: &Segments, grid: &CoarseDepth) -> Vec<bool> {
    let (labels, depth) = (&segments.labels, grid.data());
    let count = labels.iter().max().map_or(0, |l| usize::from(*l));
    let mut regions = vec![Region::default(); count + 1];
    let cells = || (0..labels.len()).filter(|i| labels[*i] > 0 && depth[*i] > 0.0);
    let place = |cell: usize| {
        let [x, y] = [cell % segments.width, cell / segments.width];
        Vector3::new(x as f64, y as f64, 1.0)
    };
    for here in cells() {
        let region = &mut regions[usize::from(labels[here])];
        let place = place(here);
        region.square += place * place.transpose();
        region.product += place / f64::from(depth[here]);
        for way in [[1, 0], [-1, 0], [0, 1], [0, -1]] {
            let along = |way| along(segments, here, way);
            let holes = along(way).take_while(|c| depth[*c] <= 0.0);
            let holes = holes.take(HOLE).count();
            match along(way).nth(holes) {
                _ if holes == HOLE => region.farther += 1,
                Some(there) if labels[there] == 0 => {
                    let before = along(way.map(|d| -d)).next();
                    let before = before.map_or(0.0, |before| depth[before]);
                    region.meet(depth[here], depth[there], before);
                }
                _ => {}
            }
        }
    }
    // Where cells lie on a line, there is no plane through them, and they are as flat as can be.
    let plane = |r: &Region| Some(r.square.try_inverse()? * r.product);
    let planes: Vec<_> = regions.iter().map(plane).collect();
    for here in cells() {
        let region = usize::from(labels[here]);
        if let Some(plane) = planes[region] {
            let ratio = plane.dot(&place(here)) * f64::from(depth[here]);
            regions[region].deviation += (ratio - 1.0) * (ratio - 1.0);
        }
    }
    let is_thing: Vec<bool> = regions.iter().map(Region::is_thing).collect();
    let seen = |region: usize| segments.seen.get(region).copied().unwrap_or(false);
    let of = |label: &u16| {
        let region = usize::from(*label);
        region > 0 && (is_thing[region] || seen(region))
    };
    labels.iter().map(of).collect()
}

/// The cells that follow one in a direction, to the border of the image.
fn along(segments: &Segments, cell: usize, [dx, dy]: [isize; 2]) -> impl Iterator<Item = usize> {
    let (width, height) = (segments.width, segments.height);
    let next = move |(x, y): &(usize, usize)| {
        let (x, y) = (x.checked_add_signed(dx)?, y.checked_add_signed(dy)?);
        (x < width && y < height).then_some((x, y))
    };
    std::iter::successors(next(&(cell % width, cell / width)), next)
        .map(move |(x, y)| y * width + x)
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use stillpoint_imaging::DepthImage;

    const CELLS: [usize; 2] = [20, 15];

    /// Whether any cell of a region is one of a thing, given the depths of cells and whether they belong to the region.
    fn kept(depth: impl Fn(usize, usize) -> f32, region: impl Fn(usize, usize) -> bool) -> bool {
        let [w, h] = CELLS;
        let pixels = (0..64 * w * h).map(|i| depth(i % (8 * w) / 8, i / (8 * w) / 8));
        let depth = DepthImage::from_vec(8 * w, 8 * h, pixels.collect()).unwrap();
        let segments = Segments {
            cell_px: 8,
            width: w,
            height: h,
            labels: (0..w * h)
                .map(|i| u16::from(region(i % w, i / w)))
                .collect(),
            seen: Arc::default(),
        };
        let grid = super::super::cells::coarse(&depth);
        let found = things(&segments, &grid);
        assert!((0..w * h).all(|i| !found[i] || segments.labels[i] > 0));
        // What a detector sees is one, whatever it looks like.
        let seen = Segments {
            seen: Arc::from([false, true]),
            ..segments
        };
        assert!(things(&seen, &grid).contains(&true));
        found.contains(&true)
    }

    #[test]
    fn bodies_are_things_and_patches_of_what_is_flat_are_none() {
        let inside = |x: usize, y: usize| (5..15).contains(&x) && (3..13).contains(&y);
        let screen = |x, y| if inside(x, y) { 1.2 } else { 3.0 };
        let round = |x: usize, y: usize| {
            let off = (x as f32 - 9.5) / 5.0;
            if inside(x, y) {
                1.2 + 0.15 * off * off
            } else {
                3.0
            }
        };
        // A corner of a screen that stands, and a screen that is carried.
        let corner = |x: usize, y: usize| inside(x, y) && x < 12 && y < 8;
        assert!(!kept(screen, corner));
        assert!(kept(screen, inside));
        // Of a body half may be seen to move.
        assert!(kept(round, corner));
        assert!(kept(round, inside));
        // A floor, however oblique, and a wall behind a body.
        assert!(!kept(|_, y| 8.0 / (1 + y) as f32, corner));
        assert!(!kept(round, |x, y| !inside(x, y) && x < 9));
    }
}
