//! The shape of a person: rigid parts around the bones, with clothes.

use super::Asked;
use super::mesh::{Cover, Mesh, Ring, Winding, off_axis, ring};
use super::skeleton::Skeleton;
use crate::scene::{Builder, Face, Light};
use crate::texture::Pattern;

#[derive(Clone, Copy)]
pub(crate) struct Dress {
    /// Pattern and variant of the shirt.
    pub(crate) shirt: (Pattern, usize),
    /// Pattern and variant of the trousers.
    pub(crate) trousers: (Pattern, usize),
    pub(crate) head: usize,
    pub(crate) shoes: usize,
    /// Whether the sleeves reach the wrists.
    pub(crate) long_sleeves: bool,
    /// Whether the shirt is a coat that reaches the knees.
    pub(crate) coat: bool,
}

struct Part {
    mesh: Mesh,
    cover: Cover,
}

/// The parts, in the order of [`Body::poses`].
pub(crate) struct Body {
    parts: Vec<Part>,
}

const HIPS: [Ring; 7] = [
    ring(0.13, 0.098, 0.148),
    ring(0.07, 0.106, 0.158),
    off_axis(0.01, -0.008, 0.112, 0.166),
    off_axis(-0.05, -0.012, 0.114, 0.166),
    off_axis(-0.10, -0.006, 0.096, 0.148),
    ring(-0.13, 0.07, 0.11),
    ring(-0.14, 0.03, 0.06),
];
/// A coat from the waist down, about the hips.
const SKIRT: [Ring; 4] = [
    off_axis(0.09, -0.006, 0.118, 0.17),
    off_axis(-0.05, -0.012, 0.136, 0.188),
    off_axis(-0.3, -0.008, 0.158, 0.206),
    off_axis(-0.5, 0.0, 0.172, 0.216),
];
const CHEST: [Ring; 10] = [
    off_axis(0.475, -0.005, 0.055, 0.06),
    off_axis(0.46, -0.008, 0.066, 0.085),
    off_axis(0.435, -0.01, 0.084, 0.15),
    off_axis(0.405, -0.006, 0.1, 0.186),
    off_axis(0.34, 0.0, 0.116, 0.198),
    off_axis(0.24, 0.006, 0.123, 0.186),
    off_axis(0.12, 0.004, 0.114, 0.17),
    off_axis(0.02, 0.002, 0.112, 0.166),
    off_axis(-0.06, -0.01, 0.13, 0.178),
    off_axis(-0.14, -0.016, 0.148, 0.192),
];
const NECK: [Ring; 3] = [
    off_axis(0.1, 0.012, 0.052, 0.05),
    off_axis(0.03, 0.0, 0.054, 0.054),
    off_axis(-0.02, -0.006, 0.07, 0.075),
];
const HEAD: [Ring; 11] = [
    off_axis(0.278, 0.004, 0.03, 0.026),
    off_axis(0.268, 0.004, 0.06, 0.05),
    off_axis(0.245, 0.004, 0.084, 0.067),
    off_axis(0.21, 0.006, 0.098, 0.077),
    off_axis(0.17, 0.008, 0.101, 0.079),
    off_axis(0.13, 0.012, 0.097, 0.076),
    off_axis(0.10, 0.02, 0.088, 0.071),
    off_axis(0.075, 0.03, 0.076, 0.063),
    off_axis(0.052, 0.042, 0.058, 0.052),
    off_axis(0.034, 0.056, 0.038, 0.038),
    off_axis(0.03, 0.064, 0.018, 0.02),
];
const NOSE: [Ring; 4] = [
    off_axis(0.158, 0.104, 0.006, 0.006),
    off_axis(0.135, 0.112, 0.012, 0.009),
    off_axis(0.113, 0.117, 0.017, 0.014),
    off_axis(0.108, 0.108, 0.012, 0.012),
];
const UPPER_ARM: [Ring; 7] = [
    ring(0.056, 0.028, 0.03),
    ring(0.04, 0.052, 0.052),
    ring(0.0, 0.064, 0.062),
    ring(-0.08, 0.06, 0.056),
    ring(-0.18, 0.054, 0.05),
    ring(-0.27, 0.05, 0.047),
    ring(-0.315, 0.042, 0.04),
];
const FOREARM: [Ring; 6] = [
    ring(0.035, 0.034, 0.034),
    ring(0.0, 0.047, 0.046),
    ring(-0.07, 0.048, 0.044),
    ring(-0.17, 0.038, 0.035),
    ring(-0.235, 0.032, 0.029),
    ring(-0.25, 0.034, 0.031),
];
const HAND: [Ring; 5] = [
    ring(0.01, 0.028, 0.021),
    ring(-0.05, 0.042, 0.019),
    ring(-0.09, 0.044, 0.016),
    ring(-0.14, 0.036, 0.013),
    ring(-0.175, 0.02, 0.009),
];
const THIGH: [Ring; 7] = [
    ring(0.075, 0.05, 0.05),
    ring(0.045, 0.085, 0.075),
    ring(-0.02, 0.1, 0.088),
    ring(-0.12, 0.094, 0.086),
    ring(-0.25, 0.08, 0.075),
    ring(-0.38, 0.068, 0.065),
    ring(-0.47, 0.056, 0.054),
];
const SHANK: [Ring; 6] = [
    ring(0.055, 0.045, 0.044),
    ring(0.02, 0.064, 0.061),
    off_axis(-0.1, -0.012, 0.066, 0.06),
    off_axis(-0.22, -0.01, 0.06, 0.055),
    off_axis(-0.34, -0.002, 0.055, 0.052),
    off_axis(-0.405, 0.008, 0.06, 0.056),
];
/// Rings of a shoe from the ankle's opening down to the sole.
const SHOE: [Ring; 6] = [
    off_axis(0.03, -0.004, 0.045, 0.036),
    off_axis(0.0, 0.004, 0.062, 0.042),
    off_axis(-0.025, 0.036, 0.1, 0.046),
    off_axis(-0.045, 0.052, 0.124, 0.05),
    off_axis(-0.068, 0.055, 0.13, 0.052),
    off_axis(-0.085, 0.055, 0.128, 0.05),
];

/// Rings scaled to a person's size; `girth` widens them.
fn scaled(rings: &[Ring], size: f64, girth: f64) -> Vec<Ring> {
    let scale = |r: &Ring| Ring {
        at: r.at * size,
        centre: r.centre.map(|c| c * size),
        radius: r.radius.map(|c| c * size * girth),
    };
    rings.iter().map(scale).collect()
}

/// Texels per metre of clothes.
const CLOTH: f64 = 512.0;

impl Body {
    /// A body of some size and girth (1 is 1.76 m and slim); `mover` is its number.
    pub(crate) fn new(b: &mut Builder, dress: &Dress, [size, girth]: [f64; 2], mover: u8) -> Self {
        let mut parts: Vec<Part> = Vec::new();
        let mut add = |b: &mut Builder, rings: &[Ring], sides: usize, look: Look| {
            let skin = b.skin(look.pattern.0, look.pattern.1);
            let power = if look.square { 2.6 } else { 2.0 };
            let slim = if look.pattern.0 == Pattern::Face {
                1.0
            } else {
                girth
            };
            let mesh = Mesh::tube(&scaled(rings, size, slim), sides, power, look.winding);
            let cover = Cover {
                texture: skin.texture,
                infrared: skin.infrared,
                mover,
                surface: 64 * u16::from(mover) + parts.len() as u16 + 1,
            };
            parts.push(Part { mesh, cover });
        };
        let cloth = |pattern, around: f64, first: f64| Look {
            pattern,
            square: false,
            winding: Winding {
                around,
                along: CLOTH / size,
                first,
            },
        };
        let skin = cloth((Pattern::Skin, dress.head), 128.0, 0.0);
        let (shirt, trousers) = (dress.shirt, dress.trousers);
        let square = |look| Look {
            square: true,
            ..look
        };
        add(b, &HIPS, 14, square(cloth(trousers, 512.0, 0.0)));
        // The print is on the chest: the texture goes once around, with its centre at the front.
        add(b, &CHEST, 18, square(cloth(shirt, 512.0, -60.0)));
        add(b, &NECK, 12, skin);
        let face = Winding {
            around: 256.0,
            along: 256.0 / (0.42 * size),
            first: 0.0,
        };
        let head = Look {
            pattern: (Pattern::Face, dress.head),
            square: false,
            winding: face,
        };
        add(b, &HEAD, 16, head);
        add(b, &NOSE, 6, skin);
        for side in 0..2 {
            let first = 100.0 + 190.0 * side as f64;
            add(b, &UPPER_ARM, 10, cloth(shirt, 192.0, first));
            let sleeve = cloth(shirt, 160.0, first + 180.0);
            let lower = if dress.long_sleeves { sleeve } else { skin };
            add(b, &FOREARM, 10, lower);
            add(b, &HAND, 8, skin);
        }
        for side in 0..2 {
            let first = 60.0 + 230.0 * side as f64;
            add(b, &THIGH, 12, cloth(trousers, 256.0, first));
            add(b, &SHANK, 12, cloth(trousers, 192.0, first + 240.0));
            let shoe = cloth((Pattern::Shoe, dress.shoes), 128.0, 0.0);
            add(b, &SHOE, 12, square(shoe));
        }
        if dress.coat {
            add(b, &SKIRT, 18, square(cloth(shirt, 512.0, 240.0)));
        }
        Self { parts }
    }

    /// Adds the faces of the body with its bones at given poses.
    pub(crate) fn place(
        &self,
        s: &Skeleton,
        light: &Light,
        asked: &mut dyn Asked,
        out: &mut Vec<Face>,
    ) {
        let trunk = [s.hips, s.chest, s.head, s.head, s.head];
        let limbs = s.arms.iter().chain(&s.legs).flatten();
        let poses = trunk.iter().chain(limbs).chain([&s.hips]);
        for (part, pose) in self.parts.iter().zip(poses) {
            part.mesh.place(pose, part.cover, light, asked, out);
        }
    }
}

#[derive(Clone, Copy)]
struct Look {
    pattern: (Pattern, usize),
    /// A rounded rectangle instead of an ellipse.
    square: bool,
    winding: Winding,
}
