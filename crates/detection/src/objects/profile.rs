//! How much of a box lies at which depth: whose surface it shows, however small a part of it.

use super::depth::DepthMode;
use crate::BoundingBox;
use stillpoint_imaging::CoarseDepth;

/// Width of a bin, m.
const BIN: f64 = 0.05;
/// Bins: beyond 8 m a depth says little of who is who.
const BINS: usize = 160;
/// Rows and columns of cells that are looked at in a box, less than twice as many.
const MOST_CELLS: usize = 32;
/// Fewer cells have no middle ...
const LEAST_CELLS: usize = 8;
/// ... nor do those that are a lesser share of a box.
const FILLED: f64 = 0.4;
/// Of a box's width and height, how far around it is looked for what goes on there.
const AROUND: f64 = 0.25;

/// Numbers of cells by depth.
#[derive(Clone, Debug, PartialEq)]
struct Histogram {
    /// Cells nearer than the end of each bin.
    below: [u16; BINS],
    /// Cells with depth.
    all: f64,
}

impl Histogram {
    fn new(depths: &[f64]) -> Self {
        let mut below = [0_u16; BINS];
        for z in depths {
            if let Some(n) = below.get_mut((z / BIN) as usize) {
                *n += 1;
            }
        }
        for i in 1..BINS {
            below[i] += below[i - 1];
        }
        Self {
            below,
            all: depths.len() as f64,
        }
    }

    /// Cells nearer than a depth; a bin counts by the part of it that is.
    fn nearer(&self, z: f64) -> f64 {
        let at = (z / BIN).clamp(0.0, BINS as f64);
        let bin = (at as usize).min(BINS - 1);
        let before = bin.checked_sub(1).map_or(0, |b| self.below[b]);
        let of_bin = f64::from(self.below[bin] - before);
        f64::from(before) + of_bin * (at - bin as f64)
    }

    /// Cells between two depths.
    fn between(&self, [near, far]: [f64; 2]) -> f64 {
        (self.nearer(far) - self.nearer(near)).max(0.0)
    }
}

/// Depths in a box and beside it.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Profile {
    inside: Histogram,
    /// Left and right of it, and above.
    beside: Histogram,
}

impl Profile {
    pub(super) fn new(depth: &CoarseDepth, b: &BoundingBox) -> Self {
        let (w, h) = (b.width() * AROUND, b.height() * AROUND);
        let around = BoundingBox {
            x0: b.x0 - w,
            y0: b.y0 - h,
            x1: b.x1 + w,
            // What is at the feet stands on the same floor.
            y1: b.y1,
        };
        let (mut inside, mut beside) = (Vec::new(), Vec::new());
        for_cells(depth, &around, |[u, v], z| {
            if u >= b.x0 && u <= b.x1 && v >= b.y0 {
                inside.push(z);
            } else if v <= b.y1 - h {
                beside.push(z);
            }
        });
        Self {
            inside: Histogram::new(&inside),
            beside: Histogram::new(&beside),
        }
    }

    /// Share of the cells with depth that lie between two depths, 0 to 1.
    pub(super) fn share(&self, range: [f64; 2]) -> f64 {
        self.inside.between(range) / self.inside.all.max(1.0)
    }

    /// What lies between two depths: which share of it lies beside the box, 0 to 1.
    pub(super) fn goes_on(&self, range: [f64; 2]) -> f64 {
        let (inside, beside) = (self.inside.between(range), self.beside.between(range));
        beside / (inside + beside).max(1.0)
    }

    /// The surface between two depths; `None` where fewer cells lie than `least`, as a share of all.
    pub(super) fn surface(&self, range: [f64; 2], least: f64) -> Option<DepthMode> {
        let share = self.share(range);
        let half = self.inside.nearer(range[0]) + self.inside.between(range) / 2.0;
        let bin = self.inside.below.partition_point(|n| f64::from(*n) < half);
        let depth = ((bin as f64 + 0.5) * BIN).max(range[0]).min(range[1]);
        (share >= least && share > 0.0).then_some(DepthMode {
            depth,
            range,
            share,
        })
    }
}

/// Middle across the image of the cells of a box between two depths, raw px in a row: the median column of plumb lines through them that move right by `lean` for each
/// pixel down. `None` where there are too few of them, or where most of the box is something else: then what is at that depth may be another thing before or behind it.
pub(super) fn middle_column(
    depth: &CoarseDepth,
    bounds: &BoundingBox,
    [near, far]: [f64; 2],
    (row, lean): (f64, f64),
) -> Option<f64> {
    let mut found = Vec::new();
    let mut all = 0;
    for_cells(depth, bounds, |[u, v], z| {
        all += 1;
        if (near..=far).contains(&z) {
            found.push(u - lean * (v - row));
        }
    });
    found.sort_by(f64::total_cmp);
    let enough = found.len() >= LEAST_CELLS && found.len() as f64 >= FILLED * f64::from(all);
    enough.then(|| (found[found.len() / 2] + found[(found.len() - 1) / 2]) / 2.0)
}

/// Place (px) and depth of the cells whose middle is in a box.
fn for_cells(depth: &CoarseDepth, b: &BoundingBox, mut take: impl FnMut([f64; 2], f64)) {
    let cell = depth.cell().max(1) as f64;
    let range = |from: f64, to: f64, end: usize| {
        let first = ((from / cell - 0.5).ceil()).max(0.0) as usize;
        let last = ((to / cell - 0.5).floor() + 1.0).max(0.0) as usize;
        first.min(end)..last.min(end)
    };
    let columns = range(b.x0, b.x1, depth.width());
    let rows = range(b.y0, b.y1, depth.height());
    let step = (columns.len().max(rows.len()) / MOST_CELLS).max(1);
    for y in rows.step_by(step) {
        for x in columns.clone().step_by(step) {
            if let Some(z) = depth.get(x, y) {
                take(depth.centre(x, y), f64::from(z));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_imaging::DepthImage;

    const BOX: BoundingBox = BoundingBox {
        x0: 40.0,
        y0: 40.0,
        x1: 200.0,
        y1: 240.0,
    };

    /// Depths of a body at 2 m, 80 px wide, whose middle is at a column in row 140 and moves right by `lean` per pixel down; a wall at 4 m.
    fn body(column: f64, lean: f64) -> CoarseDepth {
        let pixel = |i: usize| {
            let (u, v) = ((i % 320) as f64, (i / 320) as f64);
            let off = u - column - lean * (v - 140.0);
            if off.abs() < 40.0 { 2.0 } else { 4.0 }
        };
        let data = (0..320 * 320).map(pixel).collect();
        CoarseDepth::new(&DepthImage::from_vec(320, 320, data).unwrap(), 8)
    }

    #[test]
    fn who_stands_askew_in_the_image_has_his_middle_where_his_axis_is() {
        let upper = BoundingBox { y1: 140.0, ..BOX };
        let range = [1.75, 2.25];
        let middle =
            |lean: f64, said: f64| middle_column(&body(120.0, lean), &upper, range, (140.0, said));
        for lean in [-0.4, 0.0, 0.4] {
            assert!(
                (middle(lean, lean).unwrap_or(f64::NAN) - 120.0).abs() < 5.0,
                "{lean}: {:?}",
                middle(lean, lean)
            );
        }
        assert!(
            (middle(0.4, 0.0).unwrap_or(f64::NAN) - 120.0).abs() > 15.0,
            "as if upright"
        );
    }

    #[test]
    fn what_fills_little_of_a_box_has_no_middle() {
        let wide = BoundingBox {
            x0: 0.0,
            x1: 260.0,
            ..BOX
        };
        let depth = body(120.0, 0.0);
        let middle = |b: &BoundingBox| middle_column(&depth, b, [1.75, 2.25], (140.0, 0.0));
        assert!(middle(&BOX).is_some() && middle(&wide).is_none());
        assert!(middle_column(&depth, &BOX, [1.0, 1.5], (140.0, 0.0)).is_none());
    }

    #[test]
    fn shares_count_what_lies_between_two_depths() {
        let depth = body(120.0, 0.0);
        let profile = Profile::new(&depth, &BOX);
        let (near, far) = (profile.share([1.75, 2.25]), profile.share([3.75, 4.25]));
        assert!(
            (near - 0.5).abs() < 0.05 && (near + far - 1.0).abs() < 1e-9,
            "{near} {far}"
        );
        assert!(profile.share([0.5, 1.5]).abs() < 1e-9);
        // The body goes on above the box, and is not beside it.
        assert!(
            profile.goes_on([1.75, 2.25]) < 0.3,
            "{}",
            profile.goes_on([1.75, 2.25])
        );
        let cut = BoundingBox { x1: 120.0, ..BOX };
        assert!(Profile::new(&depth, &cut).goes_on([1.75, 2.25]) > 0.3);
        assert!(
            profile
                .surface([1.75, 2.25], 0.05)
                .is_some_and(|s| (s.depth - 2.0).abs() < 0.06)
        );
        assert!(profile.surface([1.75, 2.25], 0.6).is_none());
    }
}
