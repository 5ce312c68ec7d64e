//! Desks, chairs, shelves and the small items on them.

use super::build::{Builder, Place};
use crate::texture::Pattern;
use stillpoint_geometry::Vec3;

/// Height of a desk top, m.
pub(crate) const DESK: f64 = 0.74;

impl Builder {
    /// A bare desk of `width` x `depth`, centred at a place on the floor, with its front to -y.
    pub(crate) fn desk(&mut self, place: &Place, size: [f64; 2], variant: usize) {
        self.thing("dining table", place, |b| {
            b.desk_faces(place, size, variant)
        });
    }

    fn desk_faces(&mut self, place: &Place, [width, depth]: [f64; 2], variant: usize) {
        let top = self.skin(Pattern::Laminate, variant).tiled(640.0);
        let edge = self.skin(Pattern::Wood, 3).tiled(300.0);
        let leg = self.skin(Pattern::Plastic, 90);
        let (x, y) = (0.5 * width, 0.5 * depth);
        self.cuboid(place, [-x, -y, DESK - 0.03], [x, y, DESK], [edge, top]);
        for (sx, sy) in [(-1.0, -1.0), (1.0, -1.0), (-1.0, 1.0), (1.0, 1.0)] {
            let (cx, cy) = (sx * (x - 0.05), sy * (y - 0.05));
            self.cuboid(
                place,
                [cx - 0.025, cy - 0.025, 0.0],
                [cx + 0.025, cy + 0.025, DESK - 0.03],
                [leg, leg],
            );
        }
    }

    /// A monitor that stands at a place on a desk and faces -y.
    pub(crate) fn monitor(&mut self, place: &Place, size: [f64; 2], lit: bool, variant: usize) {
        self.thing("tv", place, |b| b.monitor_faces(place, size, lit, variant));
    }

    fn monitor_faces(
        &mut self,
        place: &Place,
        [width, height]: [f64; 2],
        lit: bool,
        variant: usize,
    ) {
        let black = self.skin(Pattern::Black, 0);
        let screen = self.skin(
            if lit {
                Pattern::LitScreen
            } else {
                Pattern::DarkScreen
            },
            variant,
        );
        let (w, lift) = (0.5 * width, 0.09);
        self.prism(place, [0.11, 0.015], 10, [black, black]);
        self.cuboid(
            place,
            [-0.03, 0.0, 0.015],
            [0.03, 0.03, lift + 0.1],
            [black, black],
        );
        self.cuboid(
            place,
            [-w, -0.03, lift],
            [w, 0.02, lift + height],
            [black, black],
        );
        self.quad(
            place.point(-w, -0.031, lift),
            place.direction(width, 0.0, 0.0),
            Vec3::new(0.0, 0.0, height),
            screen,
        );
    }

    /// A flat item that lies at a place: a book, a keyboard, a sheet.
    pub(crate) fn slab(&mut self, place: &Place, size: [f64; 3], pattern: Pattern, variant: usize) {
        let build = |b: &mut Self| b.slab_faces(place, size, pattern, variant);
        match pattern {
            Pattern::Keyboard => self.thing("keyboard", place, build),
            Pattern::Cover => self.thing("book", place, build),
            _ => build(self),
        }
    }

    fn slab_faces(&mut self, place: &Place, size: [f64; 3], pattern: Pattern, variant: usize) {
        let top = self.skin(pattern, variant);
        let side = self.skin(
            if pattern == Pattern::Cover {
                Pattern::Paper
            } else {
                Pattern::Plastic
            },
            91,
        );
        let [x, y] = [0.5 * size[0], 0.5 * size[1]];
        self.cuboid(place, [-x, -y, 0.0], [x, y, size[2]], [side, top]);
    }

    /// A box with the same print on all sides.
    pub(crate) fn carton(
        &mut self,
        place: &Place,
        size: [f64; 3],
        pattern: Pattern,
        variant: usize,
    ) {
        let skin = self.skin(pattern, variant);
        let [x, y] = [0.5 * size[0], 0.5 * size[1]];
        self.cuboid(place, [-x, -y, 0.0], [x, y, size[2]], [skin, skin]);
    }

    pub(crate) fn mug(&mut self, place: &Place, variant: usize) {
        let side = self.skin(Pattern::Package, 40 + variant);
        let top = self.skin(Pattern::Plastic, 40 + variant);
        self.thing("cup", place, |b| {
            b.prism(place, [0.04, 0.1], 14, [side, top])
        });
    }

    pub(crate) fn pens(&mut self, place: &Place, variant: usize) {
        let black = self.skin(Pattern::Black, 0);
        self.prism(place, [0.04, 0.1], 10, [black, black]);
        for k in 0..7 {
            let pen = self.skin(Pattern::Plastic, 50 + (variant + k) % 9);
            let (x, y) = (self.rng.range(-0.03, 0.03), self.rng.range(-0.03, 0.03));
            let tall = self.rng.range(0.13, 0.19);
            self.cuboid(
                place,
                [x - 0.004, y - 0.004, 0.1],
                [x + 0.004, y + 0.004, tall],
                [pen, pen],
            );
        }
    }

    pub(crate) fn chair(&mut self, place: &Place, variant: usize) {
        self.thing("chair", place, |b| b.chair_faces(place, variant));
    }

    fn chair_faces(&mut self, place: &Place, variant: usize) {
        let fabric = self.skin(Pattern::Fabric, variant).tiled(400.0);
        let black = self.skin(Pattern::Black, 0);
        self.cuboid(
            place,
            [-0.24, -0.24, 0.42],
            [0.24, 0.24, 0.5],
            [fabric, fabric],
        );
        self.cuboid(
            place,
            [-0.22, 0.2, 0.58],
            [0.22, 0.27, 1.05],
            [fabric, fabric],
        );
        self.cuboid(
            place,
            [-0.03, 0.22, 0.45],
            [0.03, 0.26, 0.6],
            [black, black],
        );
        self.prism(place, [0.03, 0.42], 8, [black, black]);
        for side in [-0.27, 0.23] {
            self.cuboid(
                place,
                [side, -0.15, 0.66],
                [side + 0.04, 0.15, 0.69],
                [black, black],
            );
            self.cuboid(
                place,
                [side, 0.05, 0.46],
                [side + 0.04, 0.09, 0.66],
                [black, black],
            );
        }
        for k in 0..5 {
            let leg = place.then(0.0, 0.0, 0.03, 1.2566 * f64::from(k));
            self.cuboid(&leg, [0.0, -0.02, 0.0], [0.3, 0.02, 0.04], [black, black]);
        }
    }

    /// A book shelf with its back at y = 0.3 of a place and its front to -y; `rows` boards.
    pub(crate) fn shelf(&mut self, place: &Place, width: f64, rows: usize, variant: usize) {
        let wood = self.skin(Pattern::Wood, variant).tiled(300.0);
        let (w, step) = (0.5 * width, 0.36);
        let height = step * rows as f64;
        self.cuboid(
            place,
            [-w, -0.02, 0.0],
            [-w + 0.02, 0.3, height + 0.02],
            [wood, wood],
        );
        self.cuboid(
            place,
            [w - 0.02, -0.02, 0.0],
            [w, 0.3, height + 0.02],
            [wood, wood],
        );
        self.quad(
            place.point(-w, 0.29, 0.0),
            place.direction(width, 0.0, 0.0),
            Vec3::new(0.0, 0.0, height),
            wood,
        );
        for k in 0..=rows {
            let z = step * k as f64;
            self.cuboid(
                place,
                [-w + 0.02, -0.02, z],
                [w - 0.02, 0.29, z + 0.02],
                [wood, wood],
            );
            if k == rows {
                break;
            }
            let mut x = -w + 0.03;
            while x < w - 0.2 {
                let length = self.rng.range(0.2, 0.5).min(w - 0.03 - x);
                let front = self.rng.range(0.0, 0.05);
                if self.rng.chance(0.75) {
                    let kind = self.rng.below(8);
                    let books = self.skin(Pattern::Spines, kind);
                    let high = z + self.rng.range(0.22, 0.3);
                    self.cuboid(
                        place,
                        [x, front, z + 0.02],
                        [x + length, 0.26, high],
                        [books, books],
                    );
                } else {
                    let kind = self.rng.below(8);
                    let at =
                        place.then(x + 0.5 * length, 0.12, z + 0.02, self.rng.range(-0.4, 0.4));
                    let pattern = if kind < 4 {
                        Pattern::Package
                    } else {
                        Pattern::Parcel
                    };
                    self.carton(&at, [0.6 * length, 0.14, 0.18], pattern, kind);
                }
                x += length + self.rng.range(0.0, 0.06);
            }
        }
    }

    /// Clutter on a desk of `width` x `depth` at a place on the floor; lower in the front two thirds.
    pub(crate) fn litter(&mut self, place: &Place, [width, depth]: [f64; 2], count: usize) {
        for k in 0..count {
            let x = self.rng.range(-0.44, 0.44) * width;
            let y = self.rng.range(-0.4, 0.4) * depth;
            let yaw = self.rng.range(-0.8, 0.8);
            // Each item a little higher than the previous one, so that sheets are never coplanar.
            let at = place.then(x, y, DESK + 0.002 * (k + 1) as f64, yaw);
            let variant = self.rng.below(10);
            let size = self.rng.range(0.8, 1.2);
            match self.rng.below(8) {
                0 | 1 => self.slab(&at, [0.21, 0.29, 0.002], Pattern::Paper, variant % 5),
                2 | 3 => self.slab(
                    &at,
                    [0.17 * size, 0.24 * size, 0.02 + 0.02 * size],
                    Pattern::Cover,
                    variant,
                ),
                4 => self.mug(&at, variant),
                5 => self.carton(
                    &at,
                    [0.08 * size, 0.06, 0.15 * size],
                    Pattern::Package,
                    variant,
                ),
                6 => self.pens(&at, variant),
                _ => self.carton(&at, [0.12 * size, 0.05, 0.03], Pattern::Package, variant),
            }
        }
    }
}
