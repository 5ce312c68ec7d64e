//! Walls, floors, ceilings and wall decorations.

use super::build::{Builder, Skin};
use crate::texture::Pattern;
use stillpoint_geometry::Vec3;

pub(super) const POSTERS: usize = 24;

pub(super) const HEIGHT: f64 = 2.7;

/// Builds a wall from (x0, y0) to (x1, y1), visible from its right hand side.
pub(super) fn wall(
    b: &mut Builder,
    [x0, y0]: [f64; 2],
    [x1, y1]: [f64; 2],
    [z0, z1]: [f64; 2],
    skin: Skin,
) {
    let (right, up) = (
        Vec3::new(x1 - x0, y1 - y0, 0.0),
        Vec3::new(0.0, 0.0, z1 - z0),
    );
    b.quad(Vec3::new(x0, y0, z0), right, up, skin);
}

/// Floor and ceiling of the rectangle [x0, y0, x1, y1].
pub(super) fn floor_and_ceiling(b: &mut Builder, [x0, y0, x1, y1]: [f64; 4], floor: Pattern) {
    let (ex, ey) = (Vec3::new(x1 - x0, 0.0, 0.0), Vec3::new(0.0, y1 - y0, 0.0));
    let below = b.skin(floor, 0).tiled(420.0);
    let above = b.skin(Pattern::Ceiling, 0).tiled(420.0);
    b.quad(Vec3::new(x0, y0, 0.0), ex, ey, below);
    b.quad(Vec3::new(x0, y1, HEIGHT), ex, -ey, above);
}

/// A flat picture on a wall: `centre` on the wall, `out` its normal.
pub(super) fn picture(
    b: &mut Builder,
    centre: Vec3,
    out: Vec3,
    [width, height]: [f64; 2],
    skin: Skin,
) {
    let right = Vec3::z().cross(&out) * width;
    let up = Vec3::new(0.0, 0.0, height);
    b.quad(centre + out * 0.006 - (right + up) * 0.5, right, up, skin);
}

/// Random posters along a wall from `start` in direction `along` over `length`.
pub(super) fn posters(b: &mut Builder, start: Vec3, along: Vec3, length: f64, first: usize) {
    let out = along.cross(&Vec3::z());
    let mut x = 0.3;
    let mut k = first;
    while x < length - 0.7 {
        let width = b.rng.range(0.4, 0.65);
        let z = b.rng.range(1.4, 1.7);
        let skin = b.skin(Pattern::Poster, k % POSTERS);
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
