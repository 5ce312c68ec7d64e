//! The rooms: walls, doors and furniture.

use super::Scene;
use super::build::{Builder, Place};
use super::furniture::DESK;
use super::walls::{HEIGHT, POSTERS, floor_and_ceiling, picture, posters, wall};
use crate::people::Cast;
use crate::texture::Pattern;
use stillpoint_geometry::Vec3;

/// An item on a desk: x, y, rotation, size, pattern, variant.
type Lying = (f64, f64, f64, [f64; 3], Pattern, usize);

/// Items on the work desk, at the desk's height except for the book on top of another.
const LYING: [Lying; 11] = {
    use Pattern::{Cover, Keyboard, Package, Paper, Parcel, Plastic};
    [
        (0.2, -0.2, 0.12, [0.45, 0.16, 0.025], Keyboard, 0),
        (0.56, -0.18, 0.3, [0.06, 0.1, 0.03], Plastic, 7),
        (-0.78, -0.1, 0.2, [0.19, 0.25, 0.035], Cover, 0),
        (-0.5, -0.3, -0.25, [0.18, 0.24, 0.03], Cover, 2),
        (-0.82, 0.33, 0.5, [0.2, 0.27, 0.05], Cover, 3),
        (-0.14, -0.33, 0.1, [0.21, 0.29, 0.0025], Paper, 0),
        (0.75, -0.28, -0.3, [0.21, 0.29, 0.0025], Paper, 1),
        (-0.55, 0.12, -0.2, [0.14, 0.2, 0.05], Package, 1),
        (-0.45, 0.35, 0.3, [0.22, 0.16, 0.14], Parcel, 0),
        (-0.05, -0.12, 1.0, [0.09, 0.05, 0.04], Package, 2),
        (0.9, -0.4, 0.2, [0.12, 0.08, 0.06], Package, 3),
    ]
};

/// Sheets with small items on a desk; where they overlap, the later one is on top.
fn sheets(b: &mut Builder, place: &Place) {
    for (k, (x, y)) in [
        (-0.9, 0.0),
        (-0.25, 0.1),
        (0.38, 0.12),
        (-0.6, -0.42),
        (0.3, -0.48),
    ]
    .into_iter()
    .enumerate()
    {
        let skin = b.skin(Pattern::Clutter, k);
        let z = DESK + 0.0006 * (k + 1) as f64;
        let (right, up) = (
            place.direction(0.6, 0.0, 0.0),
            place.direction(0.0, 0.3, 0.0),
        );
        b.quad(place.point(x, y, z), right, up, skin);
    }
}

/// The desk in the view of the small scenes, centred at a place, front to -y; `tidy` without sheets and clutter.
fn work_desk(b: &mut Builder, place: &Place, tidy: bool) {
    b.desk(place, [2.0, 1.0], 0);
    let on = |x: f64, y: f64, yaw: f64| place.then(x, y, DESK, yaw);
    if !tidy {
        sheets(b, place);
    }
    b.monitor(&on(0.1, 0.28, -0.1), [0.52, 0.33], false, 0);
    b.monitor(&on(0.68, 0.25, -0.5), [0.38, 0.33], true, 1);
    for (x, y, yaw, size, pattern, variant) in LYING {
        let at = on(x, y, yaw);
        match pattern {
            Pattern::Package | Pattern::Parcel => b.carton(&at, size, pattern, variant),
            _ => b.slab(&at, size, pattern, variant),
        }
    }
    let second = place.then(-0.75, -0.08, DESK + 0.035, -0.3);
    b.slab(&second, [0.17, 0.24, 0.03], Pattern::Cover, 1);
    b.carton(
        &on(-0.32, -0.1, 0.5),
        [0.1, 0.06, 0.16],
        Pattern::Package,
        0,
    );
    b.mug(&on(-0.17, 0.02, 0.4), 0);
    b.mug(&on(0.86, 0.0, 0.4), 1);
    b.pens(&on(-0.3, 0.08, 0.0), 0);
    if !tidy {
        b.litter(place, [1.9, 0.9], 12);
    }
}

/// The office; with people it has chairs instead of the second desk, for space.
pub(super) fn office(seed: u64, cast: Option<Cast>) -> Scene {
    let b = &mut Builder::new(seed);
    b.lamp(-1.2, 0.0, 2.65, 1.0);
    b.lamp(1.4, 0.6, 2.65, 0.9);
    let (x, y) = (3.0, 2.5);
    floor_and_ceiling(b, [-x, -y, x, y], Pattern::Parquet);
    let (plaster, brick) = (
        b.skin(Pattern::Plaster, 0).tiled(260.0),
        b.skin(Pattern::Brick, 0).tiled(512.0),
    );
    wall(b, [-x, y], [x, y], [0.0, HEIGHT], plaster);
    wall(b, [x, y], [x, -y], [0.0, HEIGHT], brick);
    wall(b, [x, -y], [-x, -y], [0.0, HEIGHT], plaster);
    wall(b, [-x, -y], [-x, y], [0.0, HEIGHT], plaster);
    // The scene with the coat has a tidy desk before a bare wall.
    let bare = cast == Some(Cast::Coated);
    // A crowd needs the space before the desk.
    let far = matches!(cast, Some(Cast::Crowd | Cast::Coated | Cast::Fetching));
    let desk = if far { 0.3 } else { -0.3 };
    work_desk(b, &Place::new(0.0, desk, 0.0, 0.0), bare);
    match cast {
        None => second_desk(b),
        Some(cast) => cast.enter(b, seed),
    }
    if !bare {
        b.shelf(&Place::new(-1.7, 2.15, 0.0, 0.0), 1.2, 5, 0);
        b.shelf(&Place::new(1.9, 2.15, 0.0, 0.0), 1.4, 4, 1);
    }
    b.shelf(
        &Place::new(2.65, 0.2, 0.0, -std::f64::consts::FRAC_PI_2),
        1.2,
        3,
        2,
    );
    b.shelf(
        &Place::new(-2.65, -0.6, 0.0, std::f64::consts::FRAC_PI_2),
        1.6,
        5,
        3,
    );
    if !bare {
        posters(b, Vec3::new(-0.9, y, 0.0), Vec3::x(), 2.0, 0);
    }
    posters(b, Vec3::new(x, 2.2, 0.0), -Vec3::y(), 4.5, 2);
    posters(b, Vec3::new(2.6, -y, 0.0), -Vec3::x(), 5.2, 4);
    posters(b, Vec3::new(-x, 0.4, 0.0), Vec3::y(), 2.0, 6);
    b.carton(
        &Place::new(2.5, -1.9, 0.0, 0.3),
        [0.5, 0.4, 0.35],
        Pattern::Parcel,
        1,
    );
    b.carton(
        &Place::new(-2.4, 1.9, 0.0, 0.7),
        [0.45, 0.4, 0.5],
        Pattern::Parcel,
        2,
    );
    std::mem::replace(b, Builder::new(seed)).finish()
}

/// A second desk behind the first one, seen from its back, and two chairs.
fn second_desk(b: &mut Builder) {
    let back = Place::new(0.15, 0.85, 0.0, std::f64::consts::PI);
    b.desk(&back, [1.9, 0.9], 1);
    b.monitor(&back.then(-0.1, 0.1, DESK, 0.1), [0.5, 0.32], true, 2);
    b.litter(&back, [1.8, 0.8], 20);
    b.chair(&Place::new(-1.5, 1.5, 0.0, 2.2), 0);
    b.chair(&Place::new(0.3, 1.75, 0.0, 0.2), 1);
}

/// Half the distance between the far ends of the walk, m.
const FAR: f64 = 7.7;

/// Corners of the walk through both doors of the two rooms.
pub(super) const WALK: [[f64; 2]; 7] = [
    [-4.0, 1.5],
    [0.0, 1.5],
    [FAR, 1.5],
    [FAR, 6.0],
    [0.0, 6.0],
    [-FAR, 6.0],
    [-FAR, 1.5],
];

/// Far walls and length of the two rooms, m.
const TWO_ROOMS: [f64; 2] = [9.0, 7.5];

/// Positions of the two doors along the wall between the rooms, m; each is 1 m wide and 2.1 m high.
const DOORS: [f64; 2] = [1.5, 6.0];

pub(super) fn two_rooms(seed: u64) -> Scene {
    let b = &mut Builder::new(seed);
    for (x, y) in [
        (-6.5, 2.0),
        (-6.5, 5.5),
        (-2.5, 2.0),
        (-2.5, 5.5),
        (2.5, 3.7),
        (6.5, 2.0),
        (6.5, 5.5),
    ] {
        b.lamp(x, y, 2.65, 0.95);
    }
    let [x, y] = TWO_ROOMS;
    floor_and_ceiling(b, [-x, 0.0, 0.0, y], Pattern::Parquet);
    floor_and_ceiling(b, [0.0, 0.0, x, y], Pattern::Carpet);
    let plaster = b.skin(Pattern::Plaster, 0).tiled(260.0);
    let brick = b.skin(Pattern::Brick, 0).tiled(512.0);
    for (side, skin) in [(-1.0, plaster), (1.0, brick)] {
        let far = [[side * x, 0.0], [side * x, y]];
        let long = [[0.0, y], [side * x, y], [side * x, 0.0], [0.0, 0.0]];
        let order = |a: [f64; 2], c: [f64; 2]| if side > 0.0 { (a, c) } else { (c, a) };
        for (a, c) in [(long[0], long[1]), (far[1], far[0]), (long[2], long[3])] {
            let (a, c) = order(a, c);
            wall(b, a, c, [0.0, HEIGHT], skin);
        }
    }
    wall_with_doors(b, y);
    for side in [-1.0, 1.0] {
        island(b, side);
        along_walls(b, side);
    }
    std::mem::replace(b, Builder::new(seed)).finish()
}

/// The wall between the rooms, at x = 0.
fn wall_with_doors(b: &mut Builder, length: f64) {
    let plaster = b.skin(Pattern::Plaster, 1).tiled(260.0);
    let wood = b.skin(Pattern::Wood, 5).tiled(256.0);
    let place = Place::new(0.0, 0.0, 0.0, 0.0);
    let mut from = 0.0;
    for door in DOORS {
        b.cuboid(
            &place,
            [-0.08, from, 0.0],
            [0.08, door - 0.5, HEIGHT],
            [plaster, plaster],
        );
        b.cuboid(
            &place,
            [-0.08, door - 0.5, 2.1],
            [0.08, door + 0.5, HEIGHT],
            [plaster, plaster],
        );
        for y in [door - 0.55, door + 0.47] {
            b.cuboid(&place, [-0.1, y, 0.0], [0.1, y + 0.08, 2.18], [wood, wood]);
        }
        b.cuboid(
            &place,
            [-0.1, door - 0.5, 2.1],
            [0.1, door + 0.5, 2.18],
            [wood, wood],
        );
        from = door + 0.5;
    }
    b.cuboid(
        &place,
        [-0.08, from, 0.0],
        [0.08, length, HEIGHT],
        [plaster, plaster],
    );
    for x in [-0.08, 0.08] {
        let out = Vec3::x() * if x > 0.0 { 1.0 } else { -1.0 };
        for (k, y) in [0.5, 2.6, 3.7, 4.8, 7.0].into_iter().enumerate() {
            let kind = b.rng.below(POSTERS);
            let skin = b.skin(Pattern::Poster, (kind + k) % POSTERS);
            let width = b.rng.range(0.5, 0.7);
            picture(b, Vec3::new(x, y, 1.5), out, [width, 1.4 * width], skin);
        }
    }
}

/// Four desks with their chairs in the centre of a room.
fn island(b: &mut Builder, side: f64) {
    use std::f64::consts::PI;
    for (k, (dx, dy, yaw)) in [
        (-1.0, -0.45, 0.0),
        (0.8, -0.45, 0.0),
        (-1.0, 0.45, PI),
        (0.8, 0.45, PI),
    ]
    .into_iter()
    .enumerate()
    {
        let desk = Place::new(side * 4.3 + dx, 3.75 + dy, 0.0, yaw);
        b.desk(&desk, [1.7, 0.85], k % 2);
        let (x, turn) = (b.rng.range(-0.3, 0.3), b.rng.range(-0.3, 0.3));
        b.monitor(&desk.then(x, 0.2, DESK, turn), [0.5, 0.32], k % 2 == 0, k);
        let at = desk.then(x, -0.22, DESK, 0.5 * turn);
        b.slab(&at, [0.45, 0.16, 0.025], Pattern::Keyboard, k % 3);
        b.litter(&desk, [1.6, 0.8], 12);
        b.carton(
            &desk.then(0.7, 0.2, DESK, turn),
            [0.22, 0.25, 0.28],
            Pattern::Parcel,
            k,
        );
        let (sx, turn) = (b.rng.range(-0.3, 0.3), b.rng.range(-0.6, 0.6));
        b.chair(&desk.then(sx, -0.5, 0.0, PI + turn), k % 3);
    }
}

/// Shelves, posters, desks and parcels along the outer walls of a room.
fn along_walls(b: &mut Builder, side: f64) {
    use std::f64::consts::{FRAC_PI_2, PI};
    let [x, y] = TWO_ROOMS;
    let variant = if side > 0.0 { 4 } else { 0 };
    let poster = if side > 0.0 { 12 } else { 0 };
    for (k, at) in [1.6, 3.9, 6.4].into_iter().enumerate() {
        let jitter = b.rng.range(-0.2, 0.2);
        b.shelf(
            &Place::new(side * (at + jitter), y - 0.32, 0.0, 0.0),
            1.3,
            3 + k % 3,
            variant + k,
        );
        b.shelf(
            &Place::new(side * (at - jitter), 0.32, 0.0, PI),
            1.2,
            5 - k % 3,
            variant + k,
        );
    }
    b.shelf(
        &Place::new(side * (x - 0.32), 2.0, 0.0, -side * FRAC_PI_2),
        1.4,
        5,
        variant,
    );
    let desk = Place::new(side * (x - 0.45), 4.6, 0.0, -side * FRAC_PI_2);
    b.desk(&desk, [1.8, 0.8], 1);
    b.monitor(&desk.then(0.2, 0.15, DESK, 0.1), [0.5, 0.32], true, 5);
    b.litter(&desk, [1.7, 0.7], 12);
    for (px, py) in [
        (0.5, 0.4),
        (8.5, 0.5),
        (8.4, 7.0),
        (0.5, 7.1),
        (5.2, 0.3),
        (2.75, 7.2),
    ] {
        let kind = b.rng.below(4);
        let turn = b.rng.range(-0.5, 0.5);
        let size = b.rng.range(0.8, 1.2);
        let place = Place::new(side * px, py, 0.0, turn);
        b.carton(
            &place,
            [0.45 * size, 0.4, 0.4 * size],
            Pattern::Parcel,
            kind,
        );
        b.carton(
            &place.then(0.02, 0.0, 0.4 * size, 0.4),
            [0.3, 0.25, 0.25 * size],
            Pattern::Package,
            kind,
        );
    }
    let (near, far) = (0.2 * side, x * side);
    let west = near.min(far);
    let east = near.max(far);
    posters(b, Vec3::new(west, y, 0.0), Vec3::x(), east - west, poster);
    posters(
        b,
        Vec3::new(east, 0.0, 0.0),
        -Vec3::x(),
        east - west,
        poster + 5,
    );
    let start = if side > 0.0 {
        (Vec3::new(far, y, 0.0), -Vec3::y())
    } else {
        (Vec3::new(far, 0.0, 0.0), Vec3::y())
    };
    posters(b, start.0, start.1, y, poster + 9);
}
