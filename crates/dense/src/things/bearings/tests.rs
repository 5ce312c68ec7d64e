//! Tests of localisation by boxes alone.

use super::super::look::{Grid, Look, Sighting};
use super::*;
use crate::kept::Anchor;
use stillpoint_geometry::{Camera, Se3, so3};

const FLOOR: Floor = Floor {
    up: Vec3::new(0.0, 0.0, 1.0),
    offset: 0.0,
};

/// A camera at a position 1.2 m above the floor, looking along y and slightly down.
fn pose(x: f64, y: f64) -> Se3 {
    let ahead = so3::exp(&(-Vec3::x() * (0.5 * PI + 0.2)));
    Se3::new(ahead, Vec3::new(x, y, 1.2))
}

/// The box of a chair with this centre, 0.5 m wide, 0.6 m deep and 1 m high, in a camera.
fn seen_from(grid: &Grid, pose: &Se3, at: [f64; 2]) -> [f32; 4] {
    let far = f64::INFINITY;
    let mut b = [far, far, -far, -far];
    for k in 0..8_u32 {
        let sign = |bit: u32| f64::from(k >> bit & 1) - 0.5;
        let p = Vec3::new(
            at[0] + 0.5 * sign(0),
            at[1] + 0.6 * sign(1),
            f64::from(k >> 2),
        );
        let px = grid.camera.project(&pose.inverse().transform(&p));
        b = [
            b[0].min(px.x),
            b[1].min(px.y),
            b[2].max(px.x),
            b[3].max(px.y),
        ];
    }
    b.map(|v| v as f32)
}

/// The view of a chair with this box; uniform depth, mm.
fn look(grid: &Grid, pose: &Se3, bounds: [f32; 4], depth: u16) -> Look {
    Look {
        stamp: 0.0,
        anchor: Anchor {
            own: None,
            reference: None,
            online: *pose,
            submap: None,
        },
        depths: vec![depth; grid.columns * grid.rows].into(),
        sightings: vec![Sighting {
            track: 1,
            run: 0,
            class: ClassId::from_name("chair").unwrap(),
            score: 0.8,
            counts: true,
            bounds,
            depths: [2.0, 3.0],
        }],
    }
}

/// Locates a chair from positions `xs` along x; it is at `chair` in each view, with a wall behind it at `wall` m or no depth.
fn found(xs: &[f64], chair: impl Fn(usize) -> [f64; 2], wall: Option<f64>) -> Option<Vec3> {
    let grid = Grid::new(&Camera::pinhole(640, 480, [525.0, 525.0, 320.0, 240.0]));
    let poses: Vec<Se3> = xs.iter().map(|x| pose(*x, 0.0)).collect();
    let depth = wall.map_or(0, |w| (1000.0 * w) as u16);
    let kept = |(i, pose): (usize, &Se3)| {
        let jitter = [3.0, -2.0, -3.0, 2.0].map(|j| if i.is_multiple_of(2) { j } else { -j });
        let exact = seen_from(&grid, pose, chair(i));
        look(
            &grid,
            pose,
            [0, 1, 2, 3].map(|k| exact[k] + jitter[k]),
            depth,
        )
    };
    let looks: Vec<Look> = poses.iter().enumerate().map(kept).collect();
    let placed: Vec<Placed<'_>> = (looks.iter().zip(&poses))
        .map(|(l, p)| Placed::at(l, &grid, *p))
        .collect();
    let seen: Vec<Seen> = (0..looks.len()).map(|l| (l, 0)).collect();
    let class = ClassId::from_name("chair").unwrap();
    let standing = standing(class, &seen, &placed, &FLOOR)?;
    let sum: Vec3 = standing.points.iter().map(|p| p.1).sum();
    Some(sum / standing.points.len() as f64)
}

const PASSING: [f64; 7] = [-0.5, -0.35, -0.2, 0.0, 0.15, 0.3, 0.45];

#[test]
fn chair_without_depth_is_located_by_its_boxes() {
    let chair = [0.3, 2.6];
    let middle = found(&PASSING, |_| chair, None).unwrap();
    let off = (middle.xy() - Vec2::from(chair)).norm();
    assert!(off < 0.08, "{middle} {off}");
}

#[test]
fn inconsistent_boxes_give_no_position() {
    let two = |i: usize| [if i.is_multiple_of(2) { -0.4 } else { 0.5 }, 2.6];
    assert!(found(&PASSING, two, None).is_none());
    // From a single place only the usual size gives the distance, which is not accepted.
    assert!(found(&[0.0; 7], |_| [0.3, 2.6], None).is_none());
    assert!(found(&PASSING[..3], |_| [0.3, 2.6], None).is_none());
}

#[test]
fn object_seen_through_is_rejected() {
    assert!(found(&PASSING, |_| [0.3, 2.6], Some(4.0)).is_none());
    // Control: a surface at its place.
    assert!(found(&PASSING, |_| [0.3, 2.6], Some(2.6)).is_some());
}

#[test]
fn border_derivatives_match_differences() {
    let grid = Grid::new(&Camera::pinhole(640, 480, [525.0, 525.0, 320.0, 240.0]));
    let look = look(&grid, &pose(0.2, 0.1), [200.0, 100.0, 330.0, 380.0], 0);
    let placed = Placed::at(&look, &grid, pose(0.2, 0.1));
    let borders = borders((0, 0), &placed, &FLOOR.level_from_world());
    assert_eq!(borders.len(), 2);
    for b in &borders {
        let at = Vec3::new(-0.1, 2.3, 0.35);
        let square = |v: &Vec3| Square {
            centre: v.xy(),
            half: v.z,
            turn: Rotation2::new(0.4),
        };
        let error = |v: &Vec3| b.error(&square(v));
        let slope = b.slope(&square(&at));
        for k in 0..3 {
            let mut step = Vec3::zeros();
            step[k] = 1e-6;
            let numeric = (error(&(at + step)) - error(&(at - step))) / 2e-6;
            assert!((numeric - slope[k]).abs() < 1e-3, "{numeric} {slope}");
        }
    }
}
