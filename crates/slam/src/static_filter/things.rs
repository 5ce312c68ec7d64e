//! Selects the regions that are separate objects. Walls, floors and tables seem to move where they are uncovered, slide
//! along themselves, or reflect.
//!
//! A region seen by a detector is an object. Others are if the scene beyond their border is farther away; flat ones,
//! which may be patches of a wall, only if that holds for nearly all of the border.

use super::Segments;
use super::segments::joined;
use stillpoint_geometry::nalgebra::{Matrix3, Vector3};
use stillpoint_imaging::CoarseDepth;

/// Width from which a hole in depth counts as far background, cells; a narrower one is a shadow, and the surface beyond
/// it is compared. Chosen: 48 px, which are 18 cm at 2 m.
const HOLE: usize = 6;
/// Minimum share of a region's border with farther background, and that of a flat region. Two thirds of the share of a
/// person who sits or stands behind something, and half of that of a person who is only partly seen to move; two sides
/// of a screen are half of its patch's border.
const SET_APART: [f64; 2] = [0.35, 0.7];
/// Standard deviation of depths from a plane, as a share, below which a region is flat: 2 cm in 2 m. Bodies deviate by
/// twice that.
const FLAT: f64 = 0.01;
/// Tolerance for inverse depths to change linearly, 1/m, plus this share of their change: four standard deviations of a
/// Kinect's, and depth measured off the centre of a cell.
const EVEN: [f32; 2] = [0.006, 0.3];

#[derive(Clone, Copy, Debug, Default)]
struct Region {
    /// Cell sides on the border beyond which the scene is farther away, or too far to have depth.
    farther: usize,
    /// Those beyond which there is the same surface, or a nearer one.
    others: usize,
    /// Sums for the plane fit: of (x, y, 1) with itself, and with the inverse depth.
    square: Matrix3<f64>,
    product: Vector3<f64>,
    /// Sum of squared deviations from the plane, as shares of depth.
    deviation: f64,
}

impl Region {
    /// Adds a border cell's depth, that of the cell beyond the border, and that of the cell on its other side, m.
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

/// Whether the depths of three cells in a row, m, fit a plane of any slope: inverse depth is then linear.
fn is_plane(depths: [f32; 3]) -> bool {
    let [before, here, there] = depths.map(f32::recip);
    let slope = (here - before).abs();
    depths.iter().all(|z| *z > 0.0)
        && (here - before - (there - here)).abs() < EVEN[0] + EVEN[1] * slope
}

/// Whether each cell belongs to an object.
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
    // Collinear cells determine no plane, and count as flat.
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

/// The cells that follow one in a direction, up to the border of the image.
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

    /// Whether a region is an object, given the depths of cells and the cells of the region.
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
        // Regions seen by a detector are objects regardless of shape.
        let seen = Segments {
            seen: Arc::from([false, true]),
            ..segments
        };
        assert!(things(&seen, &grid).contains(&true));
        found.contains(&true)
    }

    #[test]
    fn bodies_are_kept_and_patches_of_planes_are_not() {
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
        // A corner of a static screen, and a whole screen that is carried.
        let corner = |x: usize, y: usize| inside(x, y) && x < 12 && y < 8;
        assert!(!kept(screen, corner));
        assert!(kept(screen, inside));
        // Half of a body may be seen to move.
        assert!(kept(round, corner));
        assert!(kept(round, inside));
        // An oblique floor, and a wall behind a body.
        assert!(!kept(|_, y| 8.0 / (1 + y) as f32, corner));
        assert!(!kept(round, |x, y| !inside(x, y) && x < 9));
    }
}
