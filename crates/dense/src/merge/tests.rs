//! Properties of transformed and merged maps.

use super::*;
use crate::block::FULL;
use crate::cells::Vec3i;
use crate::mesh::MeshOptions;
use crate::volume::tests::{camera, config, look, looking, plane, sphere};
use crate::world::Occupancy;
use proptest::prelude::*;
use stillpoint_geometry::{Vec3, Vec6};
use stillpoint_imaging::Simd;

const RADIUS: f64 = 0.35;

/// A ball around the origin, observed three times from each direction that `from` accepts, with a moving object before it.
fn ball(voxel: f64, cell: f64, from: impl Fn(&Vec3) -> bool) -> DenseMap {
    let config = DenseConfig {
        cell,
        ..config(voxel)
    };
    let mut map = DenseMap::new(&config, Simd::detect());
    for i in 0..26 {
        let d = Vec3::from([i % 3, i / 3 % 3, i / 9].map(|k| f64::from(k) - 1.0));
        if d.norm() > 0.5 && from(&d) {
            let pose = looking(d.normalize() * 1.4, Vec3::zeros());
            let mut seen = look(&pose, sphere(Vec3::zeros(), RADIUS));
            seen.movers[33] = 2500;
            for _ in 0..3 {
                map.integrate(&seen, &camera(), &pose);
            }
        }
    }
    map
}

fn whole(voxel: f64) -> DenseMap {
    ball(voxel, 0.05, |_| true)
}

/// Mean and maximum distance of a mesh's vertices to the ball around a point, and the relative area.
fn errors(map: &DenseMap, centre: &Vec3, options: &MeshOptions) -> [f64; 3] {
    let mesh = map.mesh(options);
    let off = (0..mesh.positions.len() as u32).map(|i| {
        let out = (mesh.position(i) - centre).norm();
        (out - RADIUS).abs()
    });
    let off: Vec<f64> = off.collect();
    let mean = off.iter().sum::<f64>() / off.len() as f64;
    let exact = 4.0 * std::f64::consts::PI * RADIUS * RADIUS;
    [
        mean,
        off.iter().fold(0.0, |m: f64, d| m.max(*d)),
        mesh.area() / exact,
    ]
}

/// Every voxel near a surface: block, index, distance, weight and colour.
fn known(map: &DenseMap) -> Vec<([i32; 3], usize, i16, u16, u32)> {
    let mut known = Vec::new();
    for (key, number) in map.volume.blocks.sorted() {
        let b = map.volume.blocks.get(number);
        let seen = (0..512).filter(|i| b.weight[*i] > 0);
        known.extend(seen.map(|i| (key.0, i, b.distance[i], b.weight[i], b.colour[i])));
    }
    known
}

#[test]
fn identity_motion_keeps_the_map() {
    let map = whole(0.03);
    assert!(map.blocks() > 20 && map.crossed_cells() > 5);
    let moved = map.moved(&Se3::identity());
    assert!(moved.to_bytes() == map.to_bytes());
    // Merging into an empty map gives an equal map.
    let mut empty = map.emptied();
    empty.absorb(&map, &Se3::identity()).unwrap();
    assert!(empty.to_bytes() == map.to_bytes());
    let mut with_nothing = map.clone();
    let far = Se3::exp(&Vec6::new(0.1, 0.2, 0.3, 0.4, 0.5, 0.6));
    with_nothing.absorb(&map.emptied(), &far).unwrap();
    assert!(with_nothing.to_bytes() == map.to_bytes());
    // Whole voxels and quarter turns are lossless: transforming back gives the same map.
    let quarter = Se3::exp(&Vec6::new(
        0.0,
        0.0,
        0.0,
        0.0,
        std::f64::consts::FRAC_PI_2,
        0.0,
    ));
    let step = Se3::new(quarter.rotation, Vec3::new(0.3, -0.6, 0.9));
    let there = map.moved(&step);
    assert!(there.to_bytes() != map.to_bytes());
    assert!(known(&there.moved(&step.inverse())) == known(&map));
}

proptest! {
    #![proptest_config(ProptestConfig::with_cases(6))]

    /// A transformed ball is round, closed, coloured and in place; the control is not.
    #[test]
    fn moved_ball_stays_round_closed_and_in_place(
        turn in prop::array::uniform3(-2.0_f64..2.0),
        step in prop::array::uniform3(-3.0_f64..3.0),
        voxel in 0.02_f64..0.04,
    ) {
        let map = whole(voxel);
        let pose = Se3::exp(&Vec6::new(step[0], step[1], step[2], turn[0], turn[1], turn[2]));
        let centre = pose.translation;
        let before = errors(&map, &Vec3::zeros(), &MeshOptions::default());
        let after = errors(&map.moved(&pose), &centre, &MeshOptions::default());
        prop_assert!(after[1] < 0.5 * voxel, "{before:?} {after:?}");
        prop_assert!(after[0] < before[0] + 0.05 * voxel, "{before:?} {after:?}");
        prop_assert!((after[2] / before[2] - 1.0).abs() < 0.02, "{before:?} {after:?}");
        let mesh = map.moved(&pose).mesh(&MeshOptions::default());
        prop_assert!(mesh.colours.iter().all(|c| *c == [0xc0, 0x80, 0x40]));
        prop_assert!(errors(&map, &centre, &MeshOptions::default())[0] > voxel || centre.norm() < 0.1);
    }

    /// Unknown space stays unknown, and known distances equal the interpolation.
    #[test]
    fn moving_creates_no_new_surface_or_free_space(turn in prop::array::uniform3(-2.0_f64..2.0), step in prop::array::uniform3(-1.0_f64..1.0)) {
        let map = ball(0.03, 0.05, |d| d.x > 0.0);
        let pose = Se3::exp(&Vec6::new(step[0], step[1], step[2], turn[0], turn[1], turn[2]));
        let (moved, back) = (map.moved(&pose), pose.inverse());
        let (mut known, mut borders) = (0, 0);
        for (key, number) in moved.volume.blocks.sorted() {
            let block = moved.volume.blocks.get(number);
            for i in 0..512 {
                let at = Vec3::from([i % 8, i / 8 % 8, i / 64].map(|k| k as f64));
                let p = (Vec3::from(key.xyz().map(|k| 8.0 * f64::from(k))) + at) * 0.03;
                let expected = map.distance(&back.transform(&p));
                if block.weight[i] > 0 {
                    let found = f64::from(block.distance[i]) / f64::from(FULL) * map.volume.truncation;
                    // At the border of measured space a voxel takes the value of the nearest one.
                    let near = (back.transform(&p) / 0.03).map(|v| v.round() as i32);
                    prop_assert!(map.volume.voxel_at(near.into()).is_some_and(|v| v.1 > 0));
                    let off = expected.map_or(0.0, |d| (d - found).abs());
                    prop_assert!(off < 1e-5, "{expected:?} {found}");
                    borders += usize::from(expected.is_none());
                    known += 1;
                } else {
                    prop_assert!(expected.is_none());
                }
            }
        }
        prop_assert!(known > 1000 && borders * 3 < known, "{known} {borders}");
    }

    /// Cells that are free in the transformed map were free; crossed cells stay crossed.
    #[test]
    fn moved_cells_are_conservative(
        turn in prop::array::uniform3(-2.0_f64..2.0),
        step in prop::array::uniform3(-1.0_f64..1.0),
        cells in prop::sample::select(vec![(0.05, 0.05), (0.05, 0.03), (0.03, 0.05)]),
    ) {
        let map = ball(0.03, cells.0, |d| d.x > 0.0);
        let pose = Se3::exp(&Vec6::new(step[0], step[1], step[2], turn[0], turn[1], turn[2]));
        let mut moved = ball(0.03, cells.1, |_| false);
        moved.absorb(&map, &pose).unwrap();
        let back = pose.inverse();
        let (mut free, mut kept) = (0, 0);
        moved.for_each_known(|at, known| {
            if known != Occupancy::Free { return; }
            free += 1;
            let at_point = |p: [f64; 3]| {
                let p = Vec3::from_fn(|k, _| f64::from(at[k]) + p[k]) * cells.1;
                map.occupancy(&back.transform(&p))
            };
            assert_ne!(at_point([0.5; 3]), Occupancy::Unknown, "{at:?}");
            for p in [[0.3, 0.7, 0.3], [0.7, 0.3, 0.3], [0.4, 0.5, 0.8]] {
                kept += usize::from(at_point(p) == Occupancy::Free);
            }
        });
        // In the others the surface moved to a neighbouring cell.
        prop_assert!(free > 500 && kept as f64 > 0.97 * 3.0 * f64::from(free), "{free} {kept}");
        let mut crossed = 0;
        map.cells.for_each(|at, _, count| {
            let p = pose.transform(&((at.map(f64::from) + Vec3::repeat(0.5)) * cells.0));
            assert!(moved.crossed(&p) >= count);
            crossed += usize::from(count > 0);
        });
        prop_assert!(crossed > 5);
    }
}

#[test]
fn two_halves_merge_in_the_axes_of_the_first() {
    let halves = || [true, false].map(|side| ball(0.03, 0.05, move |d| (d.z > 0.5) == side));
    let pose = Se3::exp(&Vec6::new(0.7, -0.4, 0.2, 0.5, -1.0, 0.3));
    let [mut first, second] = halves();
    let other = second.moved(&pose.inverse());
    let alone = errors(&first, &Vec3::zeros(), &MeshOptions::default());
    first.absorb(&other, &pose).unwrap();
    let both = errors(&first, &Vec3::zeros(), &MeshOptions::default());
    let all = errors(&whole(0.03), &Vec3::zeros(), &MeshOptions::default());
    assert!(
        both[0] < all[0] + 0.05 * 0.03 && both[1] < 0.5 * 0.03,
        "{both:?} {all:?}"
    );
    assert!(
        alone[2] < 0.9 && (both[2] - all[2]).abs() < 0.03,
        "{alone:?} {both:?} {all:?}"
    );
    // Reproducible; and the control, merged without the transform.
    let [mut again, _] = halves();
    again.absorb(&other, &pose).unwrap();
    assert!(again.to_bytes() == first.to_bytes());
    let [mut wrong, _] = halves();
    wrong.absorb(&other, &Se3::identity()).unwrap();
    let wrong = errors(&wrong, &Vec3::zeros(), &MeshOptions::default());
    assert!(wrong[0] > 0.05, "{wrong:?}");
}

#[test]
fn merging_averages_by_weight_and_keeps_occupied_cells() {
    let wall = |z: f64, frames: usize| {
        let mut map = DenseMap::new(&config(0.02), Simd::detect());
        for _ in 0..frames {
            let pose = Se3::identity();
            map.integrate(&look(&pose, plane(Vec3::z(), z)), &camera(), &pose);
        }
        map
    };
    let at = |map: &DenseMap| map.distance(&Vec3::new(0.01, 0.02, 1.0)).unwrap();
    let mut map = wall(1.0, 6);
    let before = at(&map);
    map.absorb(&wall(1.02, 3), &Se3::identity()).unwrap();
    let step = at(&map) - before;
    assert!((step - 0.02 / 3.0).abs() < 5e-4, "{step}");
    // An object that one map saw through stays, and so does its cell.
    let there = |map: &DenseMap| {
        let wall = map.distance(&Vec3::new(0.01, 0.02, 1.0));
        let cell = map.occupancy(&Vec3::new(0.01, 0.02, 1.0));
        (wall.is_some_and(|d| d.abs() < 0.005), cell)
    };
    for [mut map, other] in [[wall(1.0, 3), wall(2.0, 9)], [wall(2.0, 9), wall(1.0, 3)]] {
        map.absorb(&other, &Se3::identity()).unwrap();
        assert_eq!(there(&map), (true, Occupancy::Occupied));
    }
    assert_eq!(there(&wall(2.0, 9)), (false, Occupancy::Free));
}

#[test]
fn other_voxel_sizes_are_resampled_or_refused() {
    let pose = Se3::exp(&Vec6::new(0.3, -0.2, 0.1, 0.5, -1.0, 0.3));
    for (voxel, other) in [(0.02, 0.04), (0.04, 0.02), (0.015, 0.06), (0.03, 0.01)] {
        let mut map = ball(voxel, 0.05, |_| false);
        map.absorb(&whole(other), &pose).unwrap();
        let before = errors(&whole(other), &Vec3::zeros(), &MeshOptions::default());
        let after = errors(&map, &pose.translation, &MeshOptions::default());
        let coarse = voxel.max(other);
        assert_eq!(map.voxel(), voxel);
        assert!(
            after[1] < 0.5 * coarse,
            "{voxel} {other}: {before:?} {after:?}"
        );
        assert!(
            (after[2] / before[2] - 1.0).abs() < 0.05,
            "{voxel} {other}: {before:?} {after:?}"
        );
    }
    for (voxel, other, words) in [
        (
            0.05,
            0.01,
            "0.022 to 0.200 m beside those of 0.05 m, found 0.01 m",
        ),
        (
            0.01,
            0.05,
            "0.000 to 0.040 m beside those of 0.01 m, found 0.05 m",
        ),
    ] {
        let [mut map, other] = [voxel, other].map(|v| ball(v, 0.05, |d| d.x > 0.5 && d.y == 0.0));
        let before = map.to_bytes();
        let said = map.absorb(&other, &pose).unwrap_err().to_string();
        assert!(said.contains(words) && said.contains("--voxel"), "{said}");
        assert!(map.to_bytes() == before);
    }
}

#[test]
fn much_larger_cells_are_refused() {
    let [mut map, other] = [0.02, 0.1].map(|cell| ball(0.04, cell, |_| false));
    let said = map.absorb(&other, &Se3::identity()).unwrap_err();
    let words = "expected cells of 0.000 to 0.080 m beside those of 0.02 m, found 0.1 m";
    assert!(said.to_string().starts_with(words), "{said}");
}

#[test]
fn non_finite_or_huge_motions_give_an_empty_map() {
    let map = ball(0.04, 0.05, |d| d.x > 0.5);
    for x in [f64::NAN, f64::INFINITY, 1e12] {
        let far = Se3 {
            translation: Vec3::new(x, 0.0, 0.0),
            ..Se3::identity()
        };
        assert_eq!(map.moved(&far).to_bytes(), map.emptied().to_bytes());
    }
}

impl DenseMap {
    fn crossed_cells(&self) -> usize {
        let mut cells: Vec<Vec3i> = Vec::new();
        self.cells
            .for_each(|at, _, crossed| cells.extend((crossed > 0).then_some(at)));
        cells.len()
    }
}
