//! Textures of clothes and faces.

use super::canvas::{Canvas, Rgb};
use super::patterns::{gray, random_shapes, vivid};
use crate::random::{Purpose, Stream};

/// Folds of cloth: dark strokes with light ones beside them.
fn folds(c: &mut Canvas, rng: &mut Stream, count: usize, strength: f32) {
    let (w, h) = (c.width as f64, c.height as f64);
    for _ in 0..count {
        let p = [rng.range(0.0, w) as f32, rng.range(0.0, h) as f32];
        let (angle, length) = (rng.range(-0.9, 0.9), rng.range(12.0, 60.0));
        let q = [
            p[0] + (length * libm::cos(angle)) as f32,
            p[1] + (length * libm::sin(angle)) as f32,
        ];
        let width = rng.range(1.5, 3.5) as f32;
        crease(c, p, q, width, -strength);
        let beside = |v: [f32; 2]| [v[0], v[1] + 2.2 * width];
        crease(c, beside(p), beside(q), width, 0.7 * strength);
    }
}

/// Brightens along a line, fading to its sides.
fn crease(c: &mut Canvas, a: [f32; 2], b: [f32; 2], w: f32, by: f32) {
    let (ux, uy) = (b[0] - a[0], b[1] - a[1]);
    let length2 = (ux * ux + uy * uy).max(1e-6);
    let range = |p: f32, q: f32, end: usize| {
        let clip = |v: f32| v.clamp(0.0, end as f32) as usize;
        clip(p.min(q) - 3.0 * w)..clip(p.max(q) + 3.0 * w)
    };
    for y in range(a[1], b[1], c.height) {
        for x in range(a[0], b[0], c.width) {
            let (px, py) = (x as f32 - a[0], y as f32 - a[1]);
            let h = ((px * ux + py * uy) / length2).clamp(0.0, 1.0);
            let (dx, dy) = (px - h * ux, py - h * uy);
            let fade = 1.0 - (dx * dx + dy * dy) / (6.25 * w * w);
            if fade > 0.0 {
                let gain = 1.0 + by * fade * fade * (4.0 * h * (1.0 - h));
                c.pixels[y * c.width + x]
                    .iter_mut()
                    .for_each(|v| *v *= gain);
            }
        }
    }
}

fn weave(c: &mut Canvas, rng: &mut Stream, strength: f32) {
    c.grain(rng, [2, 8], strength);
    c.grain(rng, [8, 2], strength);
    c.grain(rng, [32, 32], strength);
}

fn buttons(c: &mut Canvas, colour: Rgb) {
    let x = 0.5 * c.width as f32;
    c.rect([x - 9.0, 0.0, x - 7.5, 512.0], colour.map(|v| 0.4 * v));
    c.rect([x + 8.0, 0.0, x + 9.0, 512.0], colour.map(|v| 0.55 * v));
    for k in 0..8 {
        c.ellipse([x, 28.0 + 64.0 * k as f32], [3.4, 3.4], colour);
        c.ellipse([x, 28.0 + 64.0 * k as f32], [1.3, 1.3], gray(60.0));
    }
}

/// A checked shirt with a chest pocket.
pub(super) fn plaid(rng: &mut Stream) -> Canvas {
    let [base, band, line]: [Rgb; 3] = [
        [
            [170.0, 52.0, 48.0],
            [52.0, 44.0, 66.0],
            [226.0, 212.0, 190.0],
        ],
        [
            [84.0, 120.0, 168.0],
            [30.0, 46.0, 84.0],
            [232.0, 232.0, 226.0],
        ],
        [
            [72.0, 118.0, 88.0],
            [32.0, 52.0, 48.0],
            [224.0, 200.0, 120.0],
        ],
    ][rng.below(3)];
    let mut c = Canvas::new(512, 512, base);
    // Bands of warp and weft mix where they cross.
    let cloth = |k: usize| {
        let at = k % 32;
        match at {
            0..12 => (band, 0.62),
            18..20 | 25..27 => (line, 0.75),
            _ => (base, 0.0),
        }
    };
    for y in 0..512 {
        for x in 0..512 {
            for (colour, share) in [cloth(x), cloth(y)] {
                let p = &mut c.pixels[y * 512 + x];
                (0..3).for_each(|k| p[k] += (colour[k] - p[k]) * share);
            }
        }
    }
    buttons(&mut c, gray(225.0));
    c.rect([300.0, 120.0, 352.0, 122.0], band.map(|v| 0.5 * v));
    c.rect([300.0, 120.0, 301.5, 182.0], band.map(|v| 0.6 * v));
    c.rect([351.0, 120.0, 352.5, 182.0], band.map(|v| 0.6 * v));
    c.rect([300.0, 181.0, 352.0, 182.5], band.map(|v| 0.6 * v));
    folds(&mut c, rng, 110, 0.42);
    weave(&mut c, rng, 5.0);
    c
}

/// A T-shirt with a large print on its chest and small ones elsewhere.
pub(super) fn print(rng: &mut Stream) -> Canvas {
    let base: Rgb = [
        [214.0, 210.0, 204.0],
        [44.0, 52.0, 74.0],
        [210.0, 176.0, 70.0],
    ][rng.below(3)];
    let dark = base[1] < 120.0;
    let mut c = Canvas::new(512, 512, base);
    let ink = gray(if dark { 230.0 } else { 40.0 });
    for k in 0..13 {
        let y = 300.0 + 16.0 * k as f32;
        c.rect([0.0, y, 512.0, y + 6.0], ink.map(|v| 0.8 * v + 20.0));
    }
    folds(&mut c, rng, 110, 0.36);
    let (x, y) = (256.0, 130.0);
    c.ellipse([x, y], [62.0, 56.0], vivid(rng));
    c.ellipse([x, y], [50.0, 45.0], ink);
    for k in 0..7 {
        let angle = 0.9 * f64::from(k) + rng.range(0.0, 0.4);
        let (dx, dy) = (36.0 * libm::cos(angle), 32.0 * libm::sin(angle));
        let half = [rng.range(5.0, 15.0) as f32, rng.range(4.0, 9.0) as f32];
        let turn = [libm::cos(2.0 * angle) as f32, libm::sin(2.0 * angle) as f32];
        c.turned_rect([x + dx as f32, y + dy as f32], half, turn, vivid(rng));
    }
    c.text(rng, [x - 72.0, 200.0, x + 76.0, 232.0], 26.0, ink);
    c.text(rng, [30.0, 210.0, 150.0, 290.0], 12.0, ink);
    c.text(rng, [400.0, 220.0, 500.0, 280.0], 14.0, ink);
    c.text(rng, [x - 60.0, 244.0, x + 64.0, 286.0], 11.0, ink);
    c.text(rng, [10.0, 90.0, 110.0, 130.0], 30.0, ink);
    c.text(rng, [420.0, 60.0, 506.0, 200.0], 18.0, ink);
    weave(&mut c, rng, 4.0);
    c
}

/// A coat with a print of small bold shapes all over, which gives it more corners than the furniture of a room.
pub(super) fn coat(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 512, gray(46.0));
    random_shapes(&mut c, rng, 1800, [3.0, 9.0]);
    folds(&mut c, rng, 110, 0.3);
    weave(&mut c, rng, 5.0);
    c
}

/// Blue jeans: seams, pockets, worn thighs.
pub(super) fn denim(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 512, [58.0, 76.0, 112.0]);
    for k in 0..4 {
        c.ellipse(
            [64.0 + 128.0 * k as f32, 190.0],
            [34.0, 110.0],
            [82.0, 102.0, 138.0],
        );
    }
    let thread = [176.0, 134.0, 80.0];
    for x in [0.0, 128.0, 256.0, 384.0] {
        c.rect([x, 0.0, x + 2.0, 512.0], [34.0, 44.0, 70.0]);
        for k in 0..64 {
            let y = 8.0 * k as f32;
            c.rect([x + 4.0, y, x + 5.3, y + 4.5], thread);
        }
    }
    for x in [30.0, 160.0, 300.0, 420.0] {
        c.stroke([x, 40.0], [x + 60.0, 70.0], 1.2, thread);
        c.stroke([x + 3.0, 36.0], [x + 63.0, 66.0], 1.6, [36.0, 46.0, 74.0]);
    }
    folds(&mut c, rng, 110, 0.34);
    c.grain(rng, [2, 2], 9.0);
    weave(&mut c, rng, 7.0);
    c
}

pub(super) fn chino(rng: &mut Stream) -> Canvas {
    let base: Rgb = [
        [152.0, 132.0, 98.0],
        [70.0, 72.0, 76.0],
        [96.0, 104.0, 84.0],
    ][rng.below(3)];
    let mut c = Canvas::new(512, 512, base);
    for x in [0.0, 128.0, 256.0, 384.0] {
        c.rect([x, 0.0, x + 1.6, 512.0], base.map(|v| 0.62 * v));
        c.stroke(
            [x + 26.0, 30.0],
            [x + 70.0, 64.0],
            1.3,
            base.map(|v| 0.55 * v),
        );
    }
    folds(&mut c, rng, 120, 0.32);
    weave(&mut c, rng, 5.0);
    c
}

/// The complexion of a person's face and hands, from their common seed.
fn complexion(seed: u64) -> Rgb {
    let rng = &mut Stream::new(seed, Purpose::People, 1);
    [
        [214.0, 164.0, 136.0],
        [186.0, 132.0, 102.0],
        [226.0, 180.0, 156.0],
    ][rng.below(3)]
}

pub(super) fn skin(rng: &mut Stream, seed: u64) -> Canvas {
    let mut c = Canvas::new(128, 128, complexion(seed));
    c.grain(rng, [32, 32], 7.0);
    c.grain(rng, [8, 8], 4.0);
    c.grain(rng, [2, 2], 3.0);
    c
}

/// A head from crown to chin, the face in the middle.
pub(super) fn face(rng: &mut Stream, seed: u64) -> Canvas {
    let tone = complexion(seed);
    let mut c = Canvas::new(256, 256, tone);
    let hair: Rgb = [[52.0, 36.0, 26.0], [36.0, 32.0, 32.0], [122.0, 84.0, 48.0]][rng.below(3)];
    // Hair from the crown to the forehead, at the sides to the ears, at the back to the neck.
    c.rect([0.0, 0.0, 256.0, 92.0], hair);
    c.rect([0.0, 80.0, 62.0, 196.0], hair);
    c.rect([194.0, 80.0, 256.0, 196.0], hair);
    c.rect([62.0, 80.0, 74.0, 142.0], hair);
    c.rect([182.0, 80.0, 194.0, 142.0], hair);
    for k in 0..9 {
        let x = 84.0 + 11.0 * f64::from(k) + rng.range(-3.0, 3.0);
        let y = 92.0 + rng.range(0.0, 9.0);
        c.ellipse([x as f32, y as f32], [8.0, 7.0], hair);
    }
    for _ in 0..260 {
        let (x, y) = (rng.range(0.0, 256.0), rng.range(0.0, 190.0));
        let inside = y < 86.0 || ((y < 190.0) && !(64.0..192.0).contains(&x));
        if inside {
            let shade = hair.map(|v| v * rng.range(0.6, 1.7) as f32);
            let end = [
                (x + rng.range(-5.0, 5.0)) as f32,
                (y + rng.range(8.0, 22.0)) as f32,
            ];
            c.stroke([x as f32, y as f32], end, 0.7, shade);
        }
    }
    for x in [68.0_f32, 188.0] {
        c.ellipse([x, 152.0], [7.0, 13.0], tone.map(|v| 0.86 * v));
        c.ellipse([x, 152.0], [3.0, 7.0], tone.map(|v| 0.66 * v));
    }
    for (x, side) in [(108.0_f32, -1.0_f32), (148.0, 1.0)] {
        c.ellipse([x, 136.0], [15.0, 10.0], tone.map(|v| 0.88 * v));
        c.stroke(
            [x - 11.0, 124.0 + side],
            [x + 11.0, 124.0 - side],
            2.2,
            hair.map(|v| 0.9 * v),
        );
        c.ellipse([x, 137.0], [9.0, 4.6], gray(236.0));
        c.ellipse([x + 0.5, 137.0], [4.0, 4.4], [62.0, 52.0, 46.0]);
        c.ellipse([x + 0.5, 137.0], [1.8, 2.0], gray(14.0));
        c.stroke([x - 9.0, 134.0], [x + 9.0, 133.5], 0.9, gray(40.0));
    }
    c.stroke([121.0, 162.0], [125.0, 164.0], 1.6, tone.map(|v| 0.5 * v));
    c.stroke([131.0, 164.0], [135.0, 162.0], 1.6, tone.map(|v| 0.5 * v));
    c.ellipse([128.0, 182.0], [17.0, 4.5], [168.0, 88.0, 82.0]);
    c.stroke([112.0, 182.0], [144.0, 182.0], 0.9, [104.0, 46.0, 46.0]);
    c.ellipse([128.0, 196.0], [10.0, 2.0], tone.map(|v| 0.85 * v));
    c.grain(rng, [16, 16], 5.0);
    c.grain(rng, [2, 2], 3.0);
    c
}

/// A sports shoe from the opening down to the sole.
pub(super) fn shoe(rng: &mut Stream) -> Canvas {
    let base: Rgb = [
        [40.0, 40.0, 46.0],
        [176.0, 176.0, 180.0],
        [92.0, 62.0, 42.0],
    ][rng.below(3)];
    let mut c = Canvas::new(128, 128, base);
    random_shapes(&mut c, rng, 7, [3.0, 9.0]);
    for k in 0..5 {
        let y = 26.0 + 9.0 * k as f32;
        c.stroke([54.0, y], [74.0, y + 5.0], 1.3, gray(232.0));
        c.stroke([74.0, y], [54.0, y + 5.0], 1.3, gray(232.0));
    }
    c.rect([0.0, 92.0, 128.0, 106.0], gray(214.0));
    c.rect([0.0, 106.0, 128.0, 128.0], gray(58.0));
    c.grain(rng, [4, 4], 4.0);
    c
}
