//! Segments a floor plan into rooms.
//!
//! A door has walls close by on both sides; a room has a core that is farther from all walls than half a door's width, and every other cell
//! belongs to the core with the shortest path. Furniture does not count as walls, so that it divides no room. (After the distance-transform
//! segmentation in: Bormann et al., Room segmentation: survey, implementation, and analysis, ICRA 2016.)

use crate::plan::distances;

/// Half the width of the widest door, m.
const DOOR: f64 = 0.6;
/// Minimum distance of a room's core from all walls, m: less is a niche or a wide door.
const ROOM: f64 = 0.85;
/// Maximum width of unseen gaps that are filled, m: desks hide the floor behind them.
const UNSEEN: f64 = 0.5;
/// Minimum area of a room without a core, m^2: a corridor.
const LEAST_AREA: f64 = 2.0;

/// Value of a cell of the plan.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Ground {
    /// Unobserved.
    Unknown,
    /// Free, or furniture.
    Open,
    /// A wall, or something equally high.
    Wall,
}

/// The room of each cell of a plan of `width` cells per row, each with a side of `side` m, counted from 1 in the order of their first
/// cells; 0 for none. Cells are 8-connected.
#[must_use]
pub fn rooms(cells: &[Ground], width: usize, side: f64) -> Vec<u32> {
    if cells.is_empty() || width == 0 {
        return Vec::new();
    }
    let walls: Vec<bool> = cells.iter().map(|c| *c == Ground::Wall).collect();
    let open: Vec<bool> = cells.iter().map(|c| *c == Ground::Open).collect();
    let from_wall = distances(&walls, width, side);
    let from_open = distances(&open, width, side);
    let inside: Vec<bool> = walls
        .iter()
        .zip(&from_open)
        .map(|(wall, d)| !wall && f64::from(*d) <= UNSEEN)
        .collect();
    let mut labels = cores(&inside, &from_wall, width);
    spread(&mut labels, &inside, width);
    corridors(&mut labels, &inside, width, side);
    // Unseen cells are not part of a room in the end.
    let seen = labels
        .iter()
        .zip(&open)
        .map(|(l, o)| if *o { *l } else { 0 });
    in_order(seen.collect())
}

pub(crate) fn around(i: usize, width: usize, count: usize) -> impl Iterator<Item = usize> {
    let (x, y) = (i % width, i / width);
    let height = count / width;
    (0..9).filter(|k| *k != 4).filter_map(move |k| {
        let (x, y) = ((x + k % 3).checked_sub(1)?, (y + k / 3).checked_sub(1)?);
        (x < width && y < height).then_some(y * width + x)
    })
}

/// All cells connected to one, among those that `belongs` accepts; marks them.
fn region(
    first: usize,
    width: usize,
    marked: &mut [bool],
    belongs: impl Fn(usize) -> bool,
) -> Vec<usize> {
    let mut cells = vec![first];
    marked[first] = true;
    let mut next = 0;
    while let Some(i) = cells.get(next).copied() {
        next += 1;
        for j in around(i, width, marked.len()) {
            if !marked[j] && belongs(j) {
                marked[j] = true;
                cells.push(j);
            }
        }
    }
    cells
}

fn cores(inside: &[bool], from_wall: &[f32], width: usize) -> Vec<u32> {
    let far = |i: usize, d: f64| inside[i] && f64::from(from_wall[i]) >= d;
    let mut marked = vec![false; inside.len()];
    let mut labels = vec![0; inside.len()];
    let mut number = 0;
    for first in 0..inside.len() {
        if marked[first] || !far(first, DOOR) {
            continue;
        }
        let cells = region(first, width, &mut marked, |j| far(j, DOOR));
        if cells.iter().any(|i| far(*i, ROOM)) {
            number += 1;
            cells.iter().for_each(|i| labels[*i] = number);
        }
    }
    labels
}

fn spread(labels: &mut [u32], inside: &[bool], width: usize) {
    let mut cells: Vec<usize> = (0..labels.len()).filter(|i| labels[*i] > 0).collect();
    let mut next = 0;
    while let Some(i) = cells.get(next).copied() {
        next += 1;
        for j in around(i, width, labels.len()) {
            if inside[j] && labels[j] == 0 {
                labels[j] = labels[i];
                cells.push(j);
            }
        }
    }
}

fn corridors(labels: &mut [u32], inside: &[bool], width: usize, side: f64) {
    let mut number = labels.iter().copied().max().unwrap_or(0);
    let mut marked: Vec<bool> = labels.iter().map(|l| *l > 0).collect();
    for first in 0..labels.len() {
        if marked[first] || !inside[first] {
            continue;
        }
        let cells = region(first, width, &mut marked, |j| inside[j]);
        if cells.len() as f64 * side * side >= LEAST_AREA {
            number += 1;
            cells.iter().for_each(|i| labels[*i] = number);
        }
    }
}

fn in_order(labels: Vec<u32>) -> Vec<u32> {
    let most = labels.iter().copied().max().unwrap_or(0) as usize;
    let mut numbers = vec![0; most + 1];
    let mut next = 0;
    for l in &labels {
        if *l > 0 && numbers[*l as usize] == 0 {
            next += 1;
            numbers[*l as usize] = next;
        }
    }
    labels.iter().map(|l| numbers[*l as usize]).collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const SIDE: f64 = 0.1;

    /// A plan of walls along `[x0, y0, x1, y1]` (cells), open inside.
    fn plan(width: usize, height: usize, houses: &[[usize; 4]]) -> Vec<Ground> {
        let mut cells = vec![Ground::Unknown; width * height];
        for [x0, y0, x1, y1] in houses {
            for y in *y0..=*y1 {
                for x in *x0..=*x1 {
                    let wall = x == *x0 || x == *x1 || y == *y0 || y == *y1;
                    cells[y * width + x] = if wall { Ground::Wall } else { Ground::Open };
                }
            }
        }
        cells
    }

    fn open(cells: &mut [Ground], width: usize, [x0, y0, x1, y1]: [usize; 4]) {
        for y in y0..=y1 {
            cells[y * width + x0..=y * width + x1].fill(Ground::Open);
        }
    }

    fn count(labels: &[u32]) -> u32 {
        labels.iter().copied().max().unwrap_or(0)
    }

    /// Two rooms of 4 x 3 m with a wall between them and a door of `door` cells.
    fn two(door: usize) -> Vec<Ground> {
        let mut cells = plan(83, 33, &[[1, 1, 41, 31], [41, 1, 81, 31]]);
        if door > 0 {
            open(&mut cells, 83, [41, 12, 41, 11 + door]);
        }
        cells
    }

    #[test]
    fn doors_separate_rooms_and_wide_openings_do_not() {
        for (door, expected) in [(0, 2), (7, 2), (10, 2), (18, 1)] {
            let labels = rooms(&two(door), 83, SIDE);
            assert_eq!(count(&labels), expected, "a door of {door} cells");
            assert_eq!(labels[15 * 83 + 20], 1);
            assert_eq!(labels[15 * 83 + 60], expected);
            // Exactly the open cells belong to rooms.
            let cells = two(door);
            assert!(
                labels
                    .iter()
                    .zip(&cells)
                    .all(|(l, c)| (*l > 0) == (*c == Ground::Open))
            );
        }
    }

    #[test]
    fn furniture_and_its_occlusions_do_not_split_a_room() {
        let mut cells = plan(83, 33, &[[1, 1, 81, 31]]);
        for y in 2..31 {
            cells[y * 83 + 38..y * 83 + 45].fill(Ground::Unknown);
        }
        let labels = rooms(&cells, 83, SIDE);
        assert_eq!(count(&labels), 1);
        assert_eq!(labels[15 * 83 + 41], 0, "nobody was there");
        // A niche is not a room, a separate corridor is one.
        let mut cells = plan(83, 50, &[[1, 1, 81, 31], [20, 31, 34, 40]]);
        open(&mut cells, 83, [23, 31, 30, 31]);
        assert_eq!(count(&rooms(&cells, 83, SIDE)), 1);
        let corridor = plan(83, 50, &[[1, 1, 81, 9]]);
        assert_eq!(count(&rooms(&corridor, 83, SIDE)), 1);
        assert_eq!(count(&rooms(&plan(20, 20, &[[5, 5, 9, 9]]), 20, SIDE)), 0);
        assert!(rooms(&[], 0, SIDE).is_empty());
    }

    proptest! {
        #[test]
        fn segmentation_is_invariant_to_right_angle_rotations(
            splits in prop::collection::vec((8_usize..32, 3_usize..20, 0_usize..16), 0..3),
            holes in prop::collection::vec(0_usize..40 * 40, 0..12),
        ) {
            const N: usize = 40;
            let mut cells = plan(N, N, &[[0, 0, N - 1, N - 1]]);
            for (at, door, wide) in &splits {
                for y in 0..N {
                    if y < *door || y >= door + wide {
                        cells[y * N + at] = Ground::Wall;
                    }
                }
            }
            holes.iter().for_each(|i| cells[*i] = Ground::Unknown);
            let turned: Vec<Ground> = (0..N * N).map(|i| cells[(N - 1 - i % N) * N + i / N]).collect();
            let (a, b) = (rooms(&cells, N, SIDE), rooms(&turned, N, SIDE));
            prop_assert_eq!(count(&a), count(&b));
            let area = |labels: &[u32]| labels.iter().filter(|l| **l > 0).count();
            prop_assert_eq!(area(&a), area(&b));
        }
    }
}
