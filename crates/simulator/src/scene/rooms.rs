//! The rooms: where walls, doors and furniture stand.

use super::Scene;
use super::build::{Builder, Place, Skin};
use super::furniture::DESK;
use crate::texture::Pattern;
use stillpoint_geometry::Vec3;

/// Height of a room, m.
const HEIGHT: f64 = 2.7;

/// Builds a wall from (x0, y0) to (x1, y1), to be seen from its right hand side.
fn wall(b: &mut Builder, [x0, y0]: [f64; 2], [x1, y1]: [f64; 2], [z0, z1]: [f64; 2], skin: Skin) {
    let (right, up) = (
        Vec3::new(x1 - x0, y1 - y0, 0.0),
        Vec3::new(0.0, 0.0, z1 - z0),
    );
    b.quad(Vec3::new(x0, y0, z0), right, up, skin);
}

/// Floor and ceiling of the rectangle [x0, y0, x1, y1].
fn floor_and_ceiling(b: &mut Builder, [x0, y0, x1, y1]: [f64; 4], floor: Pattern) {
    let (ex, ey) = (Vec3::new(x1 - x0, 0.0, 0.0), Vec3::new(0.0, y1 - y0, 0.0));
    let below = b.skin(floor, 0).tiled(420.0);
    let above = b.skin(Pattern::Ceiling, 0).tiled(420.0);
    b.quad(Vec3::new(x0, y0, 0.0), ex, ey, below);
    b.quad(Vec3::new(x0, y1, HEIGHT), ex, -ey, above);
}

/// A flat picture on a wall: `centre` on the wall, `out` its normal.
fn picture(b: &mut Builder, centre: Vec3, out: Vec3, [width, height]: [f64; 2], skin: Skin) {
    let right = Vec3::z().cross(&out) * width;
    let up = Vec3::new(0.0, 0.0, height);
    b.quad(centre + out * 0.006 - (right + up) * 0.5, right, up, skin);
}

/// The desk that the small scenes look at, centred at a place, front to -y.
fn work_desk(b: &mut Builder, place: &Place) {
    let size = [2.0, 1.0];
    b.desk(place, size, 0);
    let on = |x: f64, y: f64, yaw: f64| place.then(x, y, DESK, yaw);
    let mess = b.skin(Pattern::Clutter, 0);
    b.quad(
        place.point(-0.85, 0.0, DESK + 0.001),
        place.direction(0.6, 0.0, 0.0),
        place.direction(0.0, 0.4, 0.0),
        mess,
    );
    b.monitor(&on(0.1, 0.28, -0.1), [0.52, 0.33], false, 0);
    b.monitor(&on(0.68, 0.25, -0.5), [0.38, 0.33], true, 1);
    b.slab(
        &on(0.2, -0.2, 0.12),
        [0.45, 0.16, 0.025],
        Pattern::Keyboard,
        0,
    );
    b.slab(
        &on(0.56, -0.18, 0.3),
        [0.06, 0.1, 0.03],
        Pattern::Plastic,
        7,
    );
    b.slab(
        &on(-0.78, -0.1, 0.2),
        [0.19, 0.25, 0.035],
        Pattern::Cover,
        0,
    );
    b.slab(
        &place.then(-0.75, -0.08, DESK + 0.035, -0.3),
        [0.17, 0.24, 0.03],
        Pattern::Cover,
        1,
    );
    b.slab(
        &on(-0.5, -0.3, -0.25),
        [0.18, 0.24, 0.03],
        Pattern::Cover,
        2,
    );
    b.slab(&on(-0.82, 0.33, 0.5), [0.2, 0.27, 0.05], Pattern::Cover, 3);
    b.slab(
        &on(-0.14, -0.33, 0.1),
        [0.21, 0.29, 0.0025],
        Pattern::Paper,
        0,
    );
    b.slab(
        &on(0.75, -0.28, -0.3),
        [0.21, 0.29, 0.0025],
        Pattern::Paper,
        1,
    );
    b.mug(&on(-0.17, 0.02, 0.4), 0);
    b.pens(&on(-0.3, 0.08, 0.0), 0);
    b.carton(
        &on(-0.32, -0.1, 0.5),
        [0.1, 0.06, 0.16],
        Pattern::Package,
        0,
    );
    b.carton(
        &on(-0.55, 0.12, -0.2),
        [0.14, 0.2, 0.05],
        Pattern::Package,
        1,
    );
    b.carton(
        &on(-0.45, 0.35, 0.3),
        [0.22, 0.16, 0.14],
        Pattern::Parcel,
        0,
    );
    b.carton(
        &on(-0.05, -0.12, 1.0),
        [0.09, 0.05, 0.04],
        Pattern::Package,
        2,
    );
    b.mug(&on(0.86, 0.0, 0.4), 1);
    b.carton(&on(0.9, -0.4, 0.2), [0.12, 0.08, 0.06], Pattern::Package, 3);
}

/// Posters of random kind along a wall from `start` in direction `along` over `length`.
fn posters(b: &mut Builder, start: Vec3, along: Vec3, length: f64, first: usize) {
    let out = along.cross(&Vec3::z());
    let mut x = 0.3;
    let mut k = first;
    while x < length - 0.7 {
        let width = b.rng.range(0.4, 0.65);
        let z = b.rng.range(1.4, 1.7);
        let skin = b.skin(Pattern::Poster, k % 8);
        picture(
            b,
            start + along * (x + 0.5 * width) + Vec3::new(0.0, 0.0, z),
            out,
            [width, 1.4 * width],
            skin,
        );
        x += width + b.rng.range(0.25, 0.9);
        k += 1;
    }
}

pub(super) fn office(seed: u64) -> Scene {
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
    work_desk(b, &Place::new(0.0, -0.3, 0.0, 0.0));
    // A second desk behind the first one, seen from its back.
    let back = Place::new(0.15, 0.85, 0.0, std::f64::consts::PI);
    b.desk(&back, [1.9, 0.9], 1);
    b.monitor(&back.then(-0.1, 0.1, DESK, 0.1), [0.5, 0.32], true, 2);
    b.litter(&back, [1.8, 0.8], 14);
    b.chair(&Place::new(-1.5, 1.5, 0.0, 2.2), 0);
    b.chair(&Place::new(0.3, 1.75, 0.0, 0.2), 1);
    b.shelf(&Place::new(-1.7, 2.15, 0.0, 0.0), 1.2, 5, 0);
    b.shelf(&Place::new(1.9, 2.15, 0.0, 0.0), 1.4, 4, 1);
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
    posters(b, Vec3::new(-0.9, y, 0.0), Vec3::x(), 2.0, 0);
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

pub(super) fn two_rooms(seed: u64) -> Scene {
    office(seed)
}
