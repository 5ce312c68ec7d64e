//! Two identical rooms side by side on a corridor: perceptual aliasing for place recognition.
//!
//! One room with its part of the corridor is built, lit by its own lamps, and then copied face by face: same furniture, clutter, textures
//! and light. Only the corridor's two ends differ.

use super::Scene;
use super::build::{Builder, Place};
use super::furniture::DESK;
use super::walls::{HEIGHT, floor_and_ceiling, picture, posters, wall};
use crate::texture::Pattern;
use std::f64::consts::{FRAC_PI_2, PI};
use stillpoint_geometry::Vec3;

/// Distance along x from a point of the first room to the same point of the second, m. With it, half of the walk takes 692 frames and three
/// periods of the walker's glance, so that both rooms are seen with nearly the same gaze.
pub(super) const SHIFT: f64 = 6.06;

/// Half the width of a room along x, and its depth along y from the corridor's wall on, m.
const ROOM: [f64; 2] = [2.8, 5.1];

/// The corridor's two walls along y, m.
const CORRIDOR: [f64; 2] = [-1.9, -0.1];

/// The rectangular path about the desks: half its width, its first and its last y, m.
const ROUND: [f64; 3] = [1.3, 0.95, 3.85];

/// The walk's line in the corridor, y, m.
const AISLE: f64 = -0.9;

/// Length of the walk from its start to the same point of the second room, m.
const HALF: f64 = SHIFT + 2.0 * (ROUND[1] - AISLE) + 4.0 * ROUND[0] + 2.0 * (ROUND[2] - ROUND[1]);

/// Corners of the closed walk: about the desks of the first room, along the corridor, about the desks of the second room, and back. The
/// second half equals the first in the other room, except for the direction in the corridor.
pub(super) const WALK: [[f64; 2]; 16] = {
    let [w, y0, y1] = ROUND;
    let b = SHIFT;
    [
        [w, y0],
        [w, y1],
        [-w, y1],
        [-w, y0],
        [0.0, y0],
        [0.0, AISLE],
        [b, AISLE],
        [b, y0],
        [b + w, y0],
        [b + w, y1],
        [b - w, y1],
        [b - w, y0],
        [b, y0],
        [b, AISLE],
        [0.0, AISLE],
        [0.0, y0],
    ]
};

/// Lengths of the walk, m: until it has gone about the desks of the second room, and until it has done so in the first room again, after a
/// complete loop.
pub(super) const LENGTHS: [f64; 2] = [HALF + 9.0, 2.0 * HALF + 6.0];

pub(super) fn equal_rooms(seed: u64) -> Scene {
    let mut b = Builder::new(seed);
    let lamps = [(-1.2, 1.4, 1.2), (1.2, 3.7, 1.2), (0.4, -1.0, 0.7)];
    for (x, y, power) in lamps {
        b.lamp(x, y, 2.65, power);
    }
    shell(&mut b);
    desks(&mut b);
    along_walls(&mut b);
    pictures(&mut b);
    corridor(&mut b);
    b.copy_all(&Vec3::new(SHIFT, 0.0, 0.0));
    // The ends are lit by the lamps of both parts.
    for (x, y, power) in lamps {
        b.lamp(x + SHIFT, y, 2.65, power);
    }
    ends(&mut b);
    b.finish()
}

/// Floors, ceilings, walls and the door of one room and its part of the corridor.
fn shell(b: &mut Builder) {
    let ([x, y], [south, north], half) = (ROOM, CORRIDOR, 0.5 * SHIFT);
    floor_and_ceiling(b, [-x, 0.0, x, y], Pattern::Carpet);
    floor_and_ceiling(b, [-half, south, half, 0.0], Pattern::Parquet);
    let plaster = b.skin(Pattern::Plaster, 0).tiled(260.0);
    let brick = b.skin(Pattern::Brick, 0).tiled(512.0);
    wall(b, [-x, y], [x, y], [0.0, HEIGHT], plaster);
    wall(b, [x, y], [x, 0.0], [0.0, HEIGHT], brick);
    wall(b, [-x, 0.0], [-x, y], [0.0, HEIGHT], plaster);
    wall(b, [half, south], [-half, south], [0.0, HEIGHT], plaster);
    let wood = b.skin(Pattern::Wood, 5).tiled(256.0);
    let place = Place::new(0.0, 0.0, 0.0, 0.0);
    let mut part = |low: [f64; 3], high: [f64; 3], skin| b.cuboid(&place, low, high, [skin, skin]);
    part([-half, north, 0.0], [-0.5, 0.0, HEIGHT], plaster);
    part([0.5, north, 0.0], [half, 0.0, HEIGHT], plaster);
    part([-0.5, north, 2.1], [0.5, 0.0, HEIGHT], plaster);
    let (front, back) = (north - 0.02, 0.02);
    part([-0.55, front, 0.0], [-0.47, back, 2.18], wood);
    part([0.47, front, 0.0], [0.55, back, 2.18], wood);
    part([-0.47, front, 2.1], [0.47, back, 2.18], wood);
}

/// Two desks face to face in the centre of the room, with their chairs.
fn desks(b: &mut Builder) {
    for (k, (dy, yaw)) in [(-0.39, 0.0), (0.39, PI)].into_iter().enumerate() {
        let desk = Place::new(0.0, 2.4 + dy, 0.0, yaw);
        b.desk(&desk, [1.3, 0.75], k);
        let (x, turn) = (b.rng.range(-0.2, 0.2), b.rng.range(-0.3, 0.3));
        b.monitor(&desk.then(x, 0.2, DESK, turn), [0.5, 0.32], k == 0, k);
        let at = desk.then(x, -0.2, DESK, 0.5 * turn);
        b.slab(&at, [0.45, 0.16, 0.025], Pattern::Keyboard, k);
        b.litter(&desk, [1.2, 0.7], 10);
        let (x, turn) = (b.rng.range(-0.2, 0.2), b.rng.range(-0.4, 0.4));
        b.chair(&desk.then(x, -0.25, 0.0, PI + turn), k);
    }
}

/// Shelves, a desk, chairs and parcels along the walls of the room.
fn along_walls(b: &mut Builder) {
    let [x, y] = ROOM;
    let jitter = b.rng.range(-0.15, 0.15);
    b.shelf(&Place::new(-1.6 + jitter, y - 0.32, 0.0, 0.0), 1.3, 4, 0);
    b.shelf(&Place::new(1.5 - jitter, y - 0.32, 0.0, 0.0), 1.2, 3, 1);
    b.shelf(&Place::new(0.35 - x, 1.7, 0.0, FRAC_PI_2), 1.4, 5, 2);
    let desk = Place::new(x - 0.42, 2.7, 0.0, -FRAC_PI_2);
    b.desk(&desk, [1.6, 0.75], 1);
    b.monitor(&desk.then(0.2, 0.15, DESK, 0.2), [0.5, 0.32], true, 5);
    b.litter(&desk, [1.5, 0.65], 10);
    let turn = b.rng.range(-0.4, 0.4);
    b.chair(&Place::new(0.5 - x, 3.6, 0.0, FRAC_PI_2 + turn), 2);
    b.chair(&Place::new(x - 0.5, 0.6, 0.0, -0.8 + turn), 0);
    for (px, py) in [(2.4, 4.5), (-2.4, 0.45), (0.0, 4.8)] {
        let (kind, turn, size) = (
            b.rng.below(4),
            b.rng.range(-0.5, 0.5),
            b.rng.range(0.8, 1.1),
        );
        let low = Place::new(px, py, 0.0, turn);
        b.carton(&low, [0.45 * size, 0.4, 0.4 * size], Pattern::Parcel, kind);
        let high = low.then(0.02, 0.0, 0.4 * size, 0.4);
        b.carton(&high, [0.3, 0.25, 0.25 * size], Pattern::Package, kind);
    }
}

/// Posters on the four walls of the room.
fn pictures(b: &mut Builder) {
    let [x, y] = ROOM;
    posters(b, Vec3::new(-x, y, 0.0), Vec3::x(), 2.0 * x, 0);
    posters(b, Vec3::new(x, y, 0.0), -Vec3::y(), y, 6);
    posters(b, Vec3::new(-x, 0.0, 0.0), Vec3::y(), y, 12);
    posters(b, Vec3::new(x, 0.0, 0.0), -Vec3::x(), x - 0.5, 17);
    posters(b, Vec3::new(-0.55, 0.0, 0.0), -Vec3::x(), x - 0.5, 20);
}

/// Posters, a shelf and parcels in one part of the corridor.
fn corridor(b: &mut Builder) {
    let ([south, north], half) = (CORRIDOR, 0.5 * SHIFT);
    posters(b, Vec3::new(half, south, 0.0), -Vec3::x(), SHIFT, 3);
    posters(b, Vec3::new(-half, north, 0.0), Vec3::x(), half - 0.6, 9);
    posters(b, Vec3::new(0.6, north, 0.0), Vec3::x(), half - 0.6, 14);
    b.shelf(&Place::new(1.6, south + 0.32, 0.0, PI), 1.0, 4, 3);
    for (x, kind) in [(-1.9, 2), (0.1, 3), (-0.55, 1)] {
        let turn = b.rng.range(-0.3, 0.3);
        let parcel = Place::new(x, south + 0.23, 0.0, turn);
        b.carton(&parcel, [0.45, 0.3, 0.4], Pattern::Parcel, kind);
        let top = parcel.then(0.02, 0.0, 0.4, 0.3);
        b.carton(&top, [0.3, 0.22, 0.22], Pattern::Package, kind);
    }
}

/// The walls that close the corridor, each with a different poster.
fn ends(b: &mut Builder) {
    let ([south, north], half) = (CORRIDOR, 0.5 * SHIFT);
    let brick = b.skin(Pattern::Brick, 0).tiled(512.0);
    let (west, east) = (-half, SHIFT + half);
    wall(b, [west, south], [west, north], [0.0, HEIGHT], brick);
    wall(b, [east, north], [east, south], [0.0, HEIGHT], brick);
    let middle = 0.5 * (south + north);
    for (x, out, variant) in [(west, Vec3::x(), 22), (east, -Vec3::x(), 23)] {
        let skin = b.skin(Pattern::Poster, variant);
        picture(b, Vec3::new(x, middle, 1.5), out, [0.7, 0.98], skin);
    }
}
