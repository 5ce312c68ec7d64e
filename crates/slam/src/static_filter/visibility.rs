//! The free-space test: whether each cell's surface was there in earlier frames, or these saw through its place.
//!
//! A cell of the current depth image is reprojected into earlier frames. If the earlier depth agrees, the surface may
//! have been static; if it is farther, the place was empty, so the surface has moved; if it is nearer, the place was
//! occluded. Agreement with a recent frame is weak evidence, since slow motion stays below the noise; seeing through is
//! proof at any age. (docs/algorithm.md, free-space test.)

use super::cells::{Cells, NONE};
use super::surroundings::Surroundings;
use std::array::from_fn;
use stillpoint_geometry::Se3;
use stillpoint_imaging::CoarseDepth;

/// Log odds of "moving" from one earlier frame that saw through the place: 55 to one. Chosen: twice the maximum for
/// agreement with another frame, since another surface may have the same depth. Without this evidence fr1_xyz_walkers
/// has 14 times the error (decision 54).
const SEEN_THROUGH: f32 = 4.0;
/// Log odds against moving from agreement with an earlier frame, per second of its age, up to half of [`SEEN_THROUGH`].
/// Chosen: the limit is reached after 0.44 s, when an object at 2 m and 0.17 m/s has left the tolerance of 7 cm.
const MATCH_PER_SECOND: f32 = 4.5;
/// Minimum number of neighbours with depth in the earlier frame to call a place empty: the majority of 3x3 cells.
const MIN_VALID: u8 = 5;

/// Cells per block. Chosen: 16 numbers of single precision are whole vector registers, of 128 to 512 bits; results do
/// not depend on it.
const LANES: usize = 16;

/// Depth of an earlier frame, with its pose at the depth image's stamp.
pub(super) struct Earlier<'a> {
    pub(super) grid: &'a CoarseDepth,
    /// Per cell, whether it was found to move.
    pub(super) moving: &'a [bool],
    pub(super) around: &'a Surroundings,
    pub(super) earlier_from_now: Se3,
    /// Age, s.
    pub(super) age: f64,
}

/// A rigid motion in single precision, for points given by ray and depth.
pub(super) struct CellMotion {
    r: [[f32; 3]; 3],
    t: [f32; 3],
}

impl CellMotion {
    pub(super) fn new(pose: &Se3) -> Self {
        let r = pose.rotation_matrix();
        Self {
            r: [0, 1, 2].map(|i| [0, 1, 2].map(|j| r[(i, j)] as f32)),
            t: [0, 1, 2].map(|i| pose.translation[i] as f32),
        }
    }

    /// Transforms the points at depths `z` (m) along rays (x/z, y/z).
    #[inline(always)]
    fn apply_all<const L: usize>(&self, u: &[f32; L], v: &[f32; L], z: &[f32; L]) -> [[f32; L]; 3] {
        let x: [f32; L] = from_fn(|l| u[l] * z[l]);
        let y: [f32; L] = from_fn(|l| v[l] * z[l]);
        from_fn(|i| {
            let (r, t) = (&self.r[i], self.t[i]);
            from_fn(|l| r[0] * x[l] + r[1] * y[l] + r[2] * z[l] + t)
        })
    }

    /// Transforms the cells from index `first` on with depths `depth`. Calls `f(index - first, target cell, transformed
    /// depth in m)` for each cell with depth that lands in a cell of `table`.
    #[inline(always)]
    pub(super) fn for_each(
        &self,
        cells: &Cells,
        table: &[u16],
        (first, depth): (usize, &[f32]),
        mut f: impl FnMut(usize, usize, f32),
    ) {
        let rays = cells.rays()[first..].chunks(LANES);
        for (block, (rays, depth)) in rays.zip(depth.chunks(LANES)).enumerate() {
            // Branch-free blocks, for vectorisation.
            let (mut x, mut y, mut z) = ([0.0; LANES], [0.0; LANES], [0.0; LANES]);
            for (k, ([u, v], depth)) in rays.iter().zip(depth).enumerate() {
                (x[k], y[k], z[k]) = (*u, *v, *depth);
            }
            let moved = self.apply_all(&x, &y, &z);
            let entries = cells.entries(&moved);
            for (k, _) in depth.iter().enumerate().filter(|(_, z)| **z > 0.0) {
                let place = table[entries[k] as usize];
                if place != NONE {
                    f(block * LANES + k, usize::from(place), moved[2][k]);
                }
            }
        }
    }
}

/// Adds the evidence of one earlier frame to the log odds `evidence` of the cells from index `first` on.
pub(super) fn add_evidence(
    cells: &Cells,
    now: &CoarseDepth,
    earlier: &Earlier<'_>,
    (first, evidence): (usize, &mut [f32]),
) {
    let weight = (MATCH_PER_SECOND * earlier.age as f32).min(0.5 * SEEN_THROUGH);
    let motion = CellMotion::new(&earlier.earlier_from_now);
    motion.for_each(
        cells,
        cells.inner(),
        (first, &now.data()[first..first + evidence.len()]),
        |cell, place, z| match compare(earlier, cells, place, z) {
            Seen::Through => evidence[cell] += SEEN_THROUGH,
            Seen::Same => evidence[cell] -= weight,
            Seen::Hidden => {}
        },
    );
}

/// Observation of a place by an earlier frame.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Seen {
    /// The place was empty.
    Through,
    /// A surface was there.
    Same,
    /// Occluded, or no depth.
    Hidden,
}

/// Compares a depth with the 3x3 cells around its place. Surfaces that were moving then do not count as the same static
/// one: large objects overlap with their earlier position.
#[inline]
fn compare(earlier: &Earlier<'_>, cells: &Cells, place: usize, z: f32) -> Seen {
    let (before, moving, around) = (earlier.grid.data(), earlier.moving, earlier.around);
    let (width, tolerance) = (cells.width, cells.depth_tolerance(z));
    let is_same = |i: usize| (before[i] > 0.0) & ((before[i] - z).abs() <= tolerance) & !moving[i];
    // The most frequent case first.
    if is_same(place) {
        return Seen::Same;
    }
    let (nearest, farthest) = (around.nearest[place], around.farthest_still[place]);
    // If all cells are farther, or all static ones nearer, none can be the same.
    let none_is_same = (nearest - z > tolerance) | (z - farthest > tolerance);
    let mut rows = [place - width, place, place + width].into_iter();
    if !none_is_same && rows.any(|row| (row - 1..=row + 1).any(is_same)) {
        Seen::Same
    } else if around.valid[place] >= MIN_VALID && nearest > z + tolerance {
        Seen::Through
    } else {
        Seen::Hidden
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::sensor::{DepthNoise, SensorConfig};
    use stillpoint_geometry::nalgebra::UnitQuaternion;
    use stillpoint_geometry::{Camera, Vec3};
    use stillpoint_imaging::DepthImage;

    const W: usize = 5;
    const PLACE: usize = 2 * W + 2;

    /// A grid as large as the tables below, for a sensor with this noise scale.
    fn five_by_five(noise_scale: f64) -> Cells {
        let size = (W * super::super::cells::CELL_PX) as u32;
        let camera = Camera::pinhole(size, size, [40.0, 40.0, 19.5, 19.5]);
        let sensor = SensorConfig {
            noise_scale,
            ..SensorConfig::default()
        };
        Cells::new(&camera, sensor.noise())
    }

    /// Result for 3x3 cells with these depths, with a surface at 2 m in the current frame.
    fn seen(around: [f32; 9], moving: [bool; 9]) -> Seen {
        seen_among(&five_by_five(1.0), around, moving)
    }

    fn seen_among(cells: &Cells, around: [f32; 9], moving: [bool; 9]) -> Seen {
        let (mut before, mut label) = ([9.0; 25], [false; 25]);
        for i in 0..9 {
            let cell = (i / 3 + 1) * W + i % 3 + 1;
            (before[cell], label[cell]) = (around[i], moving[i]);
        }
        let found = seen_as_defined((&before, &label), cells.depth_tolerance(2.0));
        let around = Surroundings::new(W, &before, &label);
        let grid = grid_of(&before);
        let earlier = Earlier {
            grid: &grid,
            moving: &label,
            around: &around,
            earlier_from_now: Se3::identity(),
            age: 1.0,
        };
        assert_eq!(compare(&earlier, cells, PLACE, 2.0), found);
        found
    }

    fn grid_of(depths: &[f32]) -> CoarseDepth {
        const CELL: usize = super::super::cells::CELL_PX;
        let pixel = |i: usize| depths[i / (W * CELL) / CELL * W + i % (W * CELL) / CELL];
        let data = (0..depths.len() * CELL * CELL).map(pixel).collect();
        let height = depths.len() / W * CELL;
        CoarseDepth::new(&DepthImage::from_vec(W * CELL, height, data).unwrap(), CELL)
    }

    /// Reference implementation of the comparison at 2 m.
    fn seen_as_defined((before, moving): (&[f32], &[bool]), tolerance: f32) -> Seen {
        let (mut valid, mut farther, mut same) = (0, 0, false);
        for row in [PLACE - W, PLACE, PLACE + W] {
            for i in row - 1..=row + 1 {
                let there = before[i];
                valid += u8::from(there > 0.0);
                farther += u8::from(there > 2.0 + tolerance);
                same |= there > 0.0 && (there - 2.0).abs() <= tolerance && !moving[i];
            }
        }
        match same {
            true => Seen::Same,
            false if valid >= MIN_VALID && farther == valid => Seen::Through,
            false => Seen::Hidden,
        }
    }

    #[test]
    fn cell_comparison_matches_its_definition() {
        let cells = five_by_five(1.0);
        let depths = [0.0, 1.0, 1.9, 2.0, 2.06, 2.2, 3.0];
        let mut x = 1_u64;
        let mut seen = [0; 3];
        for _ in 0..5000 {
            let mut next = |n: usize| {
                x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                (x >> 33) as usize % n
            };
            // Mostly one-sided, as surfaces are.
            let (from, count) = (next(7), 1 + next(4));
            let around = std::array::from_fn(|_| depths[(from + next(count)).min(6)]);
            let one_in = 2 + next(9);
            let moving = std::array::from_fn(|_| next(one_in) == 0);
            seen[seen_among(&cells, around, moving) as usize] += 1;
        }
        assert!(seen.iter().all(|n| *n > 200), "{seen:?}");
    }

    fn with(value: f32, rest: f32, count: usize) -> [f32; 9] {
        std::array::from_fn(|i| if i < count { value } else { rest })
    }

    const STILL: [bool; 9] = [false; 9];

    #[test]
    fn seen_through_same_and_hidden_are_distinguished() {
        assert_eq!(seen([3.0; 9], STILL), Seen::Through);
        assert_eq!(seen([2.0; 9], STILL), Seen::Same);
        assert_eq!(seen([1.0; 9], STILL), Seen::Hidden);
        // One matching cell suffices: edges move by a cell.
        assert_eq!(seen(with(2.0, 3.0, 1), STILL), Seen::Same);
        assert_eq!(seen(with(2.0, 1.0, 1), STILL), Seen::Same);
        // A single nearer cell may have occluded it.
        assert_eq!(seen(with(1.0, 3.0, 1), STILL), Seen::Hidden);
    }

    #[test]
    fn depths_agree_only_within_the_tolerance() {
        let tolerance = five_by_five(1.0).depth_tolerance(2.0);
        assert!((0.04..0.12).contains(&tolerance));
        for sign in [-1.0, 1.0] {
            assert_eq!(seen([2.0 + sign * 0.9 * tolerance; 9], STILL), Seen::Same);
            assert_ne!(seen([2.0 + sign * 1.1 * tolerance; 9], STILL), Seen::Same);
        }
    }

    #[test]
    fn noise_scale_widens_the_tolerance() {
        assert_eq!(seen([2.15; 9], STILL), Seen::Through);
        let noisy = five_by_five(10.0);
        assert_eq!(seen_among(&noisy, [2.15; 9], STILL), Seen::Same);
    }

    #[test]
    fn depth_holes_are_no_evidence() {
        assert_eq!(seen([0.0; 9], STILL), Seen::Hidden);
        assert_eq!(seen(with(3.0, 0.0, 4), STILL), Seen::Hidden);
        assert_eq!(seen(with(3.0, 0.0, 5), STILL), Seen::Through);
        assert_eq!(seen(with(2.0, 0.0, 1), STILL), Seen::Same);
    }

    #[test]
    fn earlier_moving_surface_does_not_confirm_the_place() {
        assert_eq!(seen([2.0; 9], [true; 9]), Seen::Hidden);
        let half = std::array::from_fn(|i| i < 4);
        assert_eq!(seen([2.0; 9], half), Seen::Same);
        // Nor does it prove that the place was empty.
        assert_eq!(seen(with(2.0, 3.0, 1), [true; 9]), Seen::Hidden);
        // A farther surface was seen regardless of its own motion.
        assert_eq!(seen([3.0; 9], [true; 9]), Seen::Through);
    }

    #[test]
    fn cell_motion_matches_the_rigid_transform() {
        let turn = UnitQuaternion::from_euler_angles(0.1, -0.2, 0.3);
        let pose = Se3::new(turn, Vec3::new(0.2, -0.1, 0.4));
        let p = CellMotion::new(&pose).apply_all(&[0.3], &[-0.2], &[2.5]);
        let exact = pose.transform(&Vec3::new(0.75, -0.5, 2.5));
        for i in 0..3 {
            assert!((f64::from(p[i][0]) - exact[i]).abs() < 1e-5);
        }
    }

    /// A wall at `wall` m, and a person at 1.5 m in the columns of `person`.
    fn scene(wall: f32, person: impl Fn(usize) -> bool) -> CoarseDepth {
        let data = (0..320 * 240).map(|i| if person(i % 320) { 1.5 } else { wall });
        let image = DepthImage::from_vec(320, 240, data.collect()).unwrap();
        CoarseDepth::new(&image, super::super::cells::CELL_PX)
    }

    fn evidence(
        now: &CoarseDepth,
        before: &CoarseDepth,
        back: f64,
        age: f64,
        was_moving: bool,
    ) -> Vec<f32> {
        let cells = Cells::new(
            &Camera::pinhole(320, 240, [260.0, 260.0, 159.5, 119.5]),
            DepthNoise::default(),
        );
        let mut evidence = vec![0.0; cells.count()];
        let moving = vec![was_moving; cells.count()];
        let earlier = Earlier {
            grid: before,
            moving: &moving,
            around: &Surroundings::new(cells.width, before.data(), &moving),
            earlier_from_now: Se3::new(UnitQuaternion::identity(), Vec3::new(0.0, 0.0, back)),
            age,
        };
        add_evidence(&cells, now, &earlier, (0, &mut evidence));
        // Processing in two parts gives the same result.
        let (mut parts, middle) = (vec![0.0; cells.count()], cells.count() / 2 + 3);
        let (a, b) = parts.split_at_mut(middle);
        add_evidence(&cells, now, &earlier, (0, a));
        add_evidence(&cells, now, &earlier, (middle, b));
        assert_eq!(parts, evidence);
        evidence
    }

    #[test]
    fn entering_person_moves_and_the_wall_is_static() {
        let person = |x: usize| (128..192).contains(&x);
        let (now, before) = (scene(3.0, person), scene(3.0, |_| false));
        let evidence = evidence(&now, &before, 0.0, 1.0, false);
        let (mut came, mut still) = (0, 0);
        for (i, e) in evidence.iter().enumerate() {
            let (x, y) = (i % 40, i / 40);
            if !(1..39).contains(&x) || !(1..29).contains(&y) {
                assert!(e.abs() < f32::EPSILON, "nothing is known at the border");
            } else if (16..24).contains(&x) {
                assert!(*e >= SEEN_THROUGH);
                came += 1;
            } else {
                assert!(*e < 0.0);
                still += 1;
            }
        }
        assert!(came > 200 && still > 500);
    }

    #[test]
    fn wall_uncovered_by_a_person_is_no_evidence() {
        let person = |x: usize| (128..192).contains(&x);
        let evidence = evidence(&scene(3.0, |_| false), &scene(3.0, person), 0.0, 1.0, false);
        // The uncovered wall is not new: its place was occluded before.
        let middle = 15 * 40 + 20;
        assert!(evidence[middle].abs() < f32::EPSILON);
    }

    #[test]
    fn camera_motion_is_compensated() {
        // The wall is 30 cm nearer because the camera moved.
        let (now, before) = (scene(2.7, |_| false), scene(3.0, |_| false));
        let middle = 15 * 40 + 20;
        assert!(evidence(&now, &before, 0.3, 1.0, false)[middle] < 0.0);
        // Control: without camera motion the wall has moved.
        assert!(evidence(&now, &before, 0.0, 1.0, false)[middle] > 0.0);
    }

    #[test]
    fn agreement_grows_with_age_unless_moving_before() {
        let wall = scene(3.0, |_| false);
        let middle = 15 * 40 + 20;
        let at = |age, was_moving| evidence(&wall, &wall, 0.0, age, was_moving)[middle];
        assert!(at(0.2, false) > at(0.4, false));
        assert!((at(3.0, false) + 0.5 * SEEN_THROUGH).abs() < f32::EPSILON);
        // A large moving object overlaps with its earlier position.
        assert!(at(0.2, true).abs() < f32::EPSILON);
        assert!(at(3.0, true).abs() < f32::EPSILON);
    }
}
