//! Static share of an object's surface.

use super::semantic::{MOVER, Mover};
use stillpoint_imaging::CoarseDepth;

/// Log odds from free space below which a surface was seen to be static: the value of agreement with one frame of a
/// third of a second ago (`MATCH_PER_SECOND`), chosen; section 14 of docs/algorithm.md.
const STANDS_STILL: f32 = -1.5;

/// Numbers of static cells and of cells with evidence, among those that an object holds. `evidence`: per cell, log odds
/// of "moving" from free space.
///
/// Cells shared with a person passing in front are excluded, unless they are half or more: then the person may carry
/// the object.
pub(super) fn counts(
    object: &Mover,
    movers: &[Mover],
    grid: &CoarseDepth,
    evidence: &[f32],
) -> [u32; 2] {
    let passes = |m: &&Mover| {
        object.weight < MOVER && m.weight >= MOVER && m.strength > 0.0 && m.id != object.id
    };
    let people: Vec<&Mover> = movers.iter().filter(passes).collect();
    let (mut own, mut shared) = ([0, 0], [0, 0]);
    for (i, [u, v]) in object.cells(grid) {
        let (z, evidence) = (grid.data()[i], evidence[i]);
        if z > 0.0 && object.holds(u, v, z) && (evidence > 0.0 || evidence <= STANDS_STILL) {
            let of = if people.iter().any(|p| p.holds(u, v, z)) {
                &mut shared
            } else {
                &mut own
            };
            *of = [of[0] + u32::from(evidence < 0.0), of[1] + 1];
        }
    }
    if own[1] > shared[1] {
        own
    } else {
        [own[0] + shared[0], own[1] + shared[1]]
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_detection::{BoundingBox, ObjectId};
    use stillpoint_imaging::DepthImage;

    const CELL: usize = 10;

    fn mover(id: u32, weight: f64, [x0, x1]: [f64; 2]) -> Mover {
        Mover {
            id: ObjectId(id),
            bounds: BoundingBox {
                x0,
                y0: 0.0,
                x1,
                y1: 99.0,
            },
            range: Some([0.5, 2.0]),
            weight,
            strength: if weight >= MOVER { 2.5 } else { 0.0 },
        }
    }

    /// Counts of an object over all ten columns of cells, with a moving person over some of them.
    fn beside(person: [f64; 2], weight: f64) -> [u32; 2] {
        let depth = DepthImage::from_vec(100, 100, vec![1.0; 100 * 100]).unwrap();
        let grid = CoarseDepth::new(&depth, CELL);
        let all = [mover(0, weight, [0.0, 99.0]), mover(1, 5.0, person)];
        let mut evidence = vec![-2.0; 100];
        for (i, [u, v]) in all[1].cells(&grid) {
            if all[1].holds(u, v, 1.0) {
                evidence[i] = 2.0;
            }
        }
        counts(&all[0], &all, &grid, &evidence)
    }

    #[test]
    fn person_passing_in_front_does_not_mark_a_thing() {
        assert_eq!(beside([0.0, 40.0], 2.0), [60, 60]);
    }

    #[test]
    fn person_overlapping_most_of_a_thing_carries_it() {
        assert_eq!(beside([0.0, 70.0], 2.0), [30, 100]);
    }

    #[test]
    fn overlap_of_two_people_counts_for_each() {
        assert_eq!(beside([0.0, 40.0], 5.0), [60, 100]);
    }
}
