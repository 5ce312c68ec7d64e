//! Resamples the counts of a coarse grid.
//!
//! The free count of a cell is the minimum over all cells that it overlaps. If one of those held a surface that was lost at its border, the
//! cell is unknown. Crossed cells stay crossed: none is lost between the centres of others.

use super::{Steps, for_each_between};
use crate::block::{Key, SIDE};
use crate::cells::{CellBlock, Cells};
use crate::world::DenseMap;
use stillpoint_geometry::Se3;

/// Maximum number of sample points along each axis of a cell, for comparison with smaller cells.
const MOST_POINTS: f64 = 8.0;

#[derive(Clone, Copy, Debug, Default)]
struct Counts {
    free: u16,
    crossed: u16,
    arrived: u16,
}

struct Occupied(Vec<[i32; 3]>);

impl Occupied {
    fn of(map: &DenseMap) -> Self {
        let mut cells = map.cells_with_surface();
        cells.sort_unstable();
        cells.dedup();
        Self(cells)
    }

    fn has(&self, at: &[i32; 3]) -> bool {
        self.0.binary_search(at).is_ok()
    }
}

/// Resamples the grid of a map to one whose surface is complete and whose grid is empty.
pub(super) fn resample(from: &DenseMap, to: &mut DenseMap, to_from: &Se3) {
    let (side, to_side) = (from.cells.side, to.cells.side);
    let there = Steps::new(side, to_side, to_from);
    let back = Steps::new(to_side, side, &to_from.inverse());
    let occupied = [from, to].map(Occupied::of);
    let points = points(to_side / side);
    for (key, _) in from.cells.blocks.sorted() {
        let first = key.xyz().map(|k| f64::from(k) * SIDE as f64);
        let Some(reach) = there.reach(first) else {
            continue;
        };
        for_each_between(reach, |at| {
            let cell_at = |p: &[f64; 3]| {
                let p = std::array::from_fn(|k| f64::from(at[k]) + p[k]);
                back.at(p).map(|v| v.floor() as i32)
            };
            let middle = cell_at(&[0.5; 3]);
            if block_of(middle) != key {
                return;
            }
            let mut counts = counts(&from.cells, middle);
            let free = |p: &[f64; 3]| {
                let cell = cell_at(p);
                let lost = occupied[0].has(&cell) && !occupied[1].has(&at);
                if lost { 0 } else { from.cells.counts(cell)[0] }
            };
            if counts.free > 0 {
                counts.free = points.iter().map(free).min().unwrap_or(0);
            }
            raise(&mut to.cells, at, counts);
        });
    }
    keep_crossed(&from.cells, &mut to.cells, &there);
}

/// Transfers each crossed cell to the cell at its centre.
fn keep_crossed(from: &Cells, to: &mut Cells, there: &Steps) {
    from.for_each(|at, _, crossed| {
        let to_cell = there.at(at.map(|v| f64::from(v) + 0.5).into());
        if crossed > 0 && to_cell.iter().all(|v| v.abs() < super::FARTHEST) {
            let counts = Counts {
                crossed,
                ..Counts::default()
            };
            raise(to, to_cell.map(|v| v.floor() as i32), counts);
        }
    });
}

/// Sample points in a cell from its first corner, in cell sides: two along each axis, more if the other cells are smaller.
fn points(ratio: f64) -> Vec<[f64; 3]> {
    let n = (2.0 * ratio).ceil().clamp(2.0, MOST_POINTS) as i32;
    let mut points = Vec::new();
    for_each_between([[0; 3], [n - 1; 3]], |at| {
        points.push(at.map(|k| (f64::from(k) + 0.5) / f64::from(n)));
    });
    points
}

fn block_of(at: [i32; 3]) -> Key {
    let [x, y, z] = at.map(|v| v.div_euclid(SIDE as i32));
    Key::new(x, y, z)
}

fn index_of(at: [i32; 3]) -> usize {
    let [x, y, z] = at.map(|v| v.rem_euclid(SIDE as i32) as usize);
    (z * SIDE + y) * SIDE + x
}

fn counts(cells: &Cells, at: [i32; 3]) -> Counts {
    let i = index_of(at);
    let block = cells.blocks.at(block_of(at));
    block.map_or(Counts::default(), |b| Counts {
        free: b.free[i],
        crossed: b.crossed[i],
        arrived: b.arrived[i],
    })
}

/// Raises the counts of a cell to at least these.
fn raise(cells: &mut Cells, at: [i32; 3], counts: Counts) {
    if counts.free == 0 && counts.crossed == 0 && counts.arrived == 0 {
        return;
    }
    let number = cells.blocks.find_or_make(block_of(at));
    let (block, i) = (cells.blocks.get_mut(number), index_of(at));
    block.free[i] = block.free[i].max(counts.free);
    block.crossed[i] = block.crossed[i].max(counts.crossed);
    block.arrived[i] = block.arrived[i].max(counts.arrived);
}

/// Adds the counts of another grid with the same cells; arrival times take the maximum.
pub(super) fn sum(to: &mut Cells, other: &Cells) {
    for (key, number) in other.blocks.sorted() {
        let from = other.blocks.get(number);
        let number = to.blocks.find_or_make(key);
        let CellBlock {
            free,
            crossed,
            arrived,
        } = to.blocks.get_mut(number);
        let add = |to: &mut [u16], from: &[u16]| {
            for (a, b) in to.iter_mut().zip(from) {
                *a = a.saturating_add(*b);
            }
        };
        add(free, &from.free);
        add(crossed, &from.crossed);
        for (a, b) in arrived.iter_mut().zip(&from.arrived) {
            *a = (*a).max(*b);
        }
    }
}
