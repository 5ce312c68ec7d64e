//! Depth distribution in a box and beside it, to attribute small visible parts.

use super::common::{MUCH, PART};
use super::depth::{DepthMode, MOST_CELLS};
use crate::BoundingBox;
use stillpoint_imaging::CoarseDepth;

/// Minimum number of cells with depth: the standard deviation of a share of eight is 18 %.
pub(super) const LEAST_CELLS: usize = 8;

/// Depths of cells in ascending order, m.
#[derive(Clone, Debug, PartialEq)]
struct Depths(Vec<f64>);

impl Depths {
    fn new(mut depths: Vec<f64>) -> Self {
        depths.sort_by(f64::total_cmp);
        Self(depths)
    }

    fn between(&self, [near, far]: [f64; 2]) -> &[f64] {
        let at = |z: f64| self.0.partition_point(|d| *d < z);
        let (from, to) = (at(near), at(far));
        &self.0[from..to.max(from)]
    }
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Profile {
    inside: Depths,
    /// Left, right and above.
    beside: Depths,
}

impl Profile {
    pub(super) fn new(depth: &CoarseDepth, b: &BoundingBox) -> Self {
        let (w, h) = (b.width() * PART, b.height() * PART);
        let around = BoundingBox {
            x0: b.x0 - w,
            y0: b.y0 - h,
            x1: b.x1 + w,
            // Below are the feet and the floor at the same depth.
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
            inside: Depths::new(inside),
            beside: Depths::new(beside),
        }
    }

    /// Share of the cells with depth within a depth range, 0 to 1.
    pub(super) fn share(&self, range: [f64; 2]) -> f64 {
        self.inside.between(range).len() as f64 / self.inside.0.len().max(1) as f64
    }

    /// Share of the cells within a depth range that lie beside the box, 0 to 1.
    pub(super) fn goes_on(&self, range: [f64; 2]) -> f64 {
        let count = |depths: &Depths| depths.between(range).len();
        let (inside, beside) = (count(&self.inside), count(&self.beside));
        beside as f64 / (inside + beside).max(1) as f64
    }

    /// The surface within a depth range; `None` if its share of cells is below `least`.
    pub(super) fn surface(&self, range: [f64; 2], least: f64) -> Option<DepthMode> {
        let share = self.share(range);
        let own = self.inside.between(range);
        let depth = *own.get(own.len() / 2)?;
        (share >= least).then_some(DepthMode {
            depth,
            range,
            share,
        })
    }
}

/// Middle, across the image, of a box's cells within a depth range, raw px in a row: the median column of vertical
/// lines through them that shift right by `lean` per pixel down. `None` if there are too few, or if most of the box is
/// at other depths: then the cells may belong to another object.
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
    let enough = found.len() >= LEAST_CELLS && found.len() as f64 >= MUCH * f64::from(all);
    enough.then(|| (found[found.len() / 2] + found[(found.len() - 1) / 2]) / 2.0)
}

/// Position (px) and depth of the cells centred in a box.
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

    /// A body at 2 m, 80 px wide, whose middle is at `column` in row 140 and shifts right by `lean` per pixel down; a
    /// wall at 4 m.
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
    fn leaning_person_is_centred_on_the_body_axis() {
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
    fn surface_filling_little_of_a_box_has_no_middle() {
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
    fn shares_count_depths_within_a_range() {
        let depth = body(120.0, 0.0);
        let profile = Profile::new(&depth, &BOX);
        let (near, far) = (profile.share([1.75, 2.25]), profile.share([3.75, 4.25]));
        assert!(
            (near - 0.5).abs() < 0.05 && (near + far - 1.0).abs() < 1e-9,
            "{near} {far}"
        );
        assert!(profile.share([0.5, 1.5]).abs() < 1e-9);
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
