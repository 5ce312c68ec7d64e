//! Patterns of walls, floors, desks and objects.

use super::canvas::{Canvas, Rgb};
use super::{clothes, surfaces};
use crate::random::{Purpose, Stream};

/// A kind of surface. The seed determines colours and content.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Pattern {
    /// Painted plaster: almost no texture.
    Plaster,
    /// Brick wall under white paint.
    Brick,
    Carpet,
    Parquet,
    /// Ceiling panels with dots.
    Ceiling,
    /// White laminate of a desk top, with faint grain and stains.
    Laminate,
    Wood,
    Poster,
    Cover,
    Spines,
    Paper,
    Keyboard,
    /// A dark screen with its frame.
    DarkScreen,
    /// A screen with windows and text.
    LitScreen,
    Parcel,
    /// Dark upholstery.
    Fabric,
    /// Moulded plastic: one colour.
    Plastic,
    /// Black glossy plastic.
    Black,
    /// Printed wrapping: bold shapes in many colours.
    Package,
    /// Many small things: cables, clips, pens.
    Clutter,
    Plaid,
    Print,
    Denim,
    Chino,
    Skin,
    Face,
    Shoe,
    /// A side of a printed cardboard box.
    Carton,
    /// A coat with a print of small bold shapes all over.
    Coat,
}

const INK: Rgb = [35.0, 35.0, 45.0];

pub(super) fn vivid(rng: &mut Stream) -> Rgb {
    const COLOURS: [Rgb; 10] = [
        [35.0, 60.0, 150.0],
        [190.0, 40.0, 40.0],
        [230.0, 190.0, 50.0],
        [40.0, 120.0, 70.0],
        [240.0, 240.0, 235.0],
        [30.0, 30.0, 35.0],
        [110.0, 160.0, 210.0],
        [220.0, 120.0, 40.0],
        [130.0, 60.0, 130.0],
        [150.0, 150.0, 145.0],
    ];
    let base = COLOURS[rng.below(COLOURS.len())];
    let gain = rng.range(0.8, 1.05) as f32;
    base.map(|v| v * gain)
}

pub(super) fn gray(v: f64) -> Rgb {
    [v as f32; 3]
}

impl Pattern {
    pub(super) fn paint(self, seed: u64) -> Canvas {
        let rng = &mut Stream::new(seed, Purpose::Texture, self as u64);
        match self {
            Self::Plaster => surfaces::plaster(rng),
            Self::Brick => surfaces::brick(rng),
            Self::Carpet => surfaces::carpet(rng),
            Self::Parquet => surfaces::parquet(rng),
            Self::Ceiling => surfaces::ceiling(rng),
            Self::Laminate => surfaces::laminate(rng),
            Self::Wood => surfaces::wood(rng),
            Self::Poster => poster(rng),
            Self::Cover => cover(rng),
            Self::Spines => spines(rng),
            Self::Paper => paper(rng),
            Self::Keyboard => keyboard(rng),
            Self::DarkScreen => dark_screen(rng),
            Self::LitScreen => lit_screen(rng),
            Self::Parcel => parcel(rng),
            Self::Fabric => surfaces::fabric(rng),
            Self::Plastic => surfaces::plastic(rng),
            Self::Black => surfaces::black(rng),
            Self::Package => package(rng),
            Self::Clutter => clutter(rng),
            Self::Plaid => clothes::plaid(rng),
            Self::Print => clothes::print(rng),
            Self::Coat => clothes::coat(rng),
            Self::Denim => clothes::denim(rng),
            Self::Chino => clothes::chino(rng),
            Self::Skin => clothes::skin(rng, seed),
            Self::Face => clothes::face(rng, seed),
            Self::Shoe => clothes::shoe(rng),
            Self::Carton => surfaces::carton(rng),
        }
    }
}

pub(super) fn random_shapes(c: &mut Canvas, rng: &mut Stream, count: usize, [low, high]: [f64; 2]) {
    let (w, h) = (c.width as f64, c.height as f64);
    for _ in 0..count {
        let p = [rng.range(0.0, w) as f32, rng.range(0.0, h) as f32];
        let half = [rng.range(low, high) as f32, rng.range(low, high) as f32];
        let colour = vivid(rng);
        if rng.chance(0.5) {
            c.ellipse(p, half, colour);
        } else {
            let angle = rng.range(0.0, 3.2);
            c.turned_rect(
                p,
                half,
                [libm::cos(angle) as f32, libm::sin(angle) as f32],
                colour,
            );
        }
    }
}

fn poster(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 512, vivid(rng));
    random_shapes(&mut c, rng, 26, [6.0, 60.0]);
    c.grain(rng, [4, 4], 8.0);
    let top = rng.range(20.0, 120.0) as f32;
    let paper = vivid(rng);
    c.rect([20.0, top, 236.0, top + 60.0], paper);
    let ink = if paper[0] + paper[1] + paper[2] > 380.0 {
        INK
    } else {
        gray(240.0)
    };
    c.text(rng, [28.0, top + 10.0, 232.0, top + 56.0], 22.0, ink);
    let y = rng.range(250.0, 360.0) as f32;
    c.rect([30.0, y, 226.0, y + 110.0], gray(238.0));
    c.text(rng, [38.0, y + 8.0, 220.0, y + 104.0], 9.0, INK);
    c.rect([0.0, 0.0, 256.0, 5.0], gray(240.0));
    c.rect([0.0, 507.0, 256.0, 512.0], gray(240.0));
    c.rect([0.0, 0.0, 5.0, 512.0], gray(240.0));
    c.rect([251.0, 0.0, 256.0, 512.0], gray(240.0));
    c
}

fn cover(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 256, vivid(rng));
    c.grain(rng, [64, 64], 14.0);
    let bottom = rng.range(110.0, 180.0) as f32;
    c.rect([0.0, bottom, 256.0, 256.0], vivid(rng));
    for _ in 0..7 {
        let p = [rng.range(30.0, 226.0) as f32, rng.range(80.0, 230.0) as f32];
        let r = rng.range(8.0, 34.0) as f32;
        c.ellipse(p, [r, r], vivid(rng));
        c.ellipse(p, [0.55 * r, 0.55 * r], vivid(rng));
    }
    let ink = gray(if rng.chance(0.5) { 245.0 } else { 25.0 });
    c.text(rng, [20.0, 16.0, 236.0, 70.0], 20.0, ink);
    c.text(rng, [20.0, 232.0, 200.0, 250.0], 11.0, ink);
    c.grain(rng, [4, 4], 5.0);
    c
}

fn spines(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 256, gray(28.0));
    let mut x = 2.0_f32;
    while x < 505.0 {
        let w = (rng.range(14.0, 44.0) as f32).min(510.0 - x);
        let top = rng.range(0.0, 70.0) as f32;
        let colour = vivid(rng);
        c.rect([x, top, x + w - 1.5, 256.0], colour);
        c.rect([x, top + 14.0, x + w - 1.5, top + 20.0], vivid(rng));
        let ink = gray(if colour[1] > 120.0 { 30.0 } else { 235.0 });
        let size = (0.5 * w).clamp(7.0, 16.0);
        let mut y = top + 34.0;
        let end = rng.range(130.0, 245.0) as f32;
        while y + size < end {
            c.text(
                rng,
                [x + 0.2 * w, y, x + 0.2 * w + size, y + 1.1 * size],
                size,
                ink,
            );
            y += 1.25 * size;
        }
        x += w;
    }
    c.grain(rng, [2, 8], 6.0);
    c
}

fn paper(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 256, gray(236.0));
    let size = rng.range(7.0, 10.0) as f32;
    c.text(rng, [24.0, 18.0, 200.0, 36.0], 15.0, INK);
    let end = rng.range(120.0, 240.0) as f32;
    c.text(rng, [24.0, 48.0, 236.0, end], size, gray(60.0));
    if rng.chance(0.6) {
        let y = rng.range(130.0, 170.0) as f32;
        c.rect([30.0, y, 120.0, y + 70.0], vivid(rng));
        c.ellipse([75.0, y + 35.0], [24.0, 24.0], vivid(rng));
    }
    c.grain(rng, [2, 2], 3.0);
    c
}

fn keyboard(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 256, [196.0, 192.0, 178.0]);
    for row in 0..6 {
        let y = 18.0 + row as f32 * 37.0 + if row > 0 { 10.0 } else { 0.0 };
        let mut x = 12.0 + [0.0, 0.0, 8.0, 12.0, 20.0, 0.0][row];
        while x < 480.0 {
            let w = if rng.chance(0.12) || (row == 5 && x > 110.0 && x < 140.0) {
                46.0
            } else {
                24.0
            };
            c.rect([x, y, x + w, y + 31.0], [120.0, 117.0, 108.0]);
            c.rect(
                [x + 2.0, y + 1.0, x + w - 2.5, y + 26.0],
                [214.0, 210.0, 198.0],
            );
            c.text(
                rng,
                [x + 7.0, y + 6.0, x + 18.0, y + 18.0],
                10.0,
                gray(70.0),
            );
            x += w + 3.0;
            if (330.0..352.0).contains(&x) {
                x += 16.0;
            }
        }
    }
    c
}

fn dark_screen(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 256, [16.0, 16.0, 18.0]);
    c.grain(rng, [128, 128], 3.0);
    c.rect([0.0, 0.0, 256.0, 9.0], [34.0, 34.0, 37.0]);
    c.rect([0.0, 240.0, 256.0, 256.0], [38.0, 38.0, 41.0]);
    c.rect([0.0, 0.0, 7.0, 256.0], [34.0, 34.0, 37.0]);
    c.rect([249.0, 0.0, 256.0, 256.0], [34.0, 34.0, 37.0]);
    c.text(rng, [110.0, 244.0, 150.0, 254.0], 7.0, gray(170.0));
    c.ellipse([236.0, 249.0], [2.5, 2.5], [90.0, 160.0, 240.0]);
    c
}

fn lit_screen(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 512, [60.0, 85.0, 120.0]);
    for _ in 0..4 {
        let (x, y) = (rng.range(16.0, 260.0) as f32, rng.range(16.0, 260.0) as f32);
        let (w, h) = (
            rng.range(140.0, 240.0) as f32,
            rng.range(120.0, 220.0) as f32,
        );
        let dark = rng.chance(0.4);
        c.rect([x, y, x + w, y + h], gray(if dark { 30.0 } else { 235.0 }));
        c.rect([x, y, x + w, y + 14.0], [90.0, 120.0, 170.0]);
        c.text(
            rng,
            [x + 8.0, y + 20.0, x + w - 6.0, y + h - 6.0],
            10.0,
            gray(if dark { 210.0 } else { 40.0 }),
        );
    }
    for (k, r) in [
        [0.0, 0.0, 512.0, 14.0],
        [0.0, 494.0, 512.0, 512.0],
        [0.0, 0.0, 12.0, 512.0],
        [500.0, 0.0, 512.0, 512.0],
    ]
    .into_iter()
    .enumerate()
    {
        c.rect(r, gray(165.0 + k as f64));
    }
    c
}

fn parcel(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 256, [168.0, 128.0, 84.0]);
    c.grain(rng, [2, 64], 5.0);
    c.grain(rng, [8, 8], 4.0);
    c.rect([112.0, 0.0, 144.0, 256.0], [190.0, 160.0, 110.0]);
    let (x, y) = (rng.range(10.0, 60.0) as f32, rng.range(20.0, 120.0) as f32);
    c.rect([x, y, x + 90.0, y + 70.0], gray(235.0));
    c.text(rng, [x + 6.0, y + 6.0, x + 84.0, y + 40.0], 8.0, INK);
    let mut bar = x + 8.0;
    while bar < x + 80.0 {
        let w = rng.range(1.0, 3.5) as f32;
        c.rect([bar, y + 44.0, bar + w, y + 64.0], INK);
        bar += w + rng.range(1.2, 4.0) as f32;
    }
    c.text(rng, [150.0, 180.0, 250.0, 240.0], 24.0, [110.0, 60.0, 40.0]);
    c
}

fn package(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(128, 128, vivid(rng));
    random_shapes(&mut c, rng, 9, [4.0, 26.0]);
    c.rect([12.0, 20.0, 116.0, 54.0], gray(235.0));
    let ink = vivid(rng).map(|v| v * 0.5);
    c.text(rng, [18.0, 25.0, 112.0, 52.0], 16.0, ink);
    c.text(rng, [14.0, 90.0, 110.0, 122.0], 8.0, INK);
    c
}

fn clutter(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 256, [224.0, 222.0, 220.0]);
    c.grain(rng, [32, 2], 10.0);
    for _ in 0..7 {
        let shade = gray(rng.range(20.0, 80.0));
        let mut p = [rng.range(0.0, 512.0), rng.range(0.0, 256.0)];
        let mut angle = rng.range(0.0, std::f64::consts::TAU);
        for _ in 0..40 {
            angle += rng.range(-0.5, 0.5);
            let q = [p[0] + 9.0 * libm::cos(angle), p[1] + 9.0 * libm::sin(angle)];
            c.stroke(p.map(|v| v as f32), q.map(|v| v as f32), 2.2, shade);
            p = q;
        }
    }
    for _ in 0..44 {
        let p = [rng.range(10.0, 500.0) as f32, rng.range(10.0, 246.0) as f32];
        let angle = rng.range(0.0, 3.2);
        let turn = [libm::cos(angle) as f32, libm::sin(angle) as f32];
        let half = [rng.range(3.0, 26.0) as f32, rng.range(2.0, 7.0) as f32];
        c.turned_rect([p[0] + 2.0, p[1] + 2.0], half, turn, gray(150.0));
        let colour = vivid(rng);
        c.turned_rect(p, half, turn, colour);
        c.turned_rect(p, [0.4 * half[0], 0.5 * half[1]], turn, vivid(rng));
    }
    c
}
