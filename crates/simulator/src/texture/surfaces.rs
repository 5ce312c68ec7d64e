//! Plain surfaces: walls, floors, desks, cloth, plastic.

use super::canvas::Canvas;
use super::patterns::{gray, random_shapes, vivid};
use crate::random::Stream;

pub(super) fn plaster(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 512, [205.0, 203.0, 198.0]);
    for (cell, amplitude) in [(128, 5.0), (32, 4.0), (8, 5.0), (4, 6.0), (2, 7.0)] {
        c.grain(rng, [cell, cell], amplitude);
    }
    for _ in 0..14 {
        let (x, y) = (rng.range(0.0, 512.0) as f32, rng.range(0.0, 512.0) as f32);
        let shade = gray(rng.range(130.0, 190.0));
        c.stroke(
            [x, y],
            [
                x + rng.range(-9.0, 9.0) as f32,
                y + rng.range(-9.0, 9.0) as f32,
            ],
            0.8,
            shade,
        );
    }
    c
}

pub(super) fn brick(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 512, [178.0, 176.0, 172.0]);
    for row in 0..8 {
        for column in -1..4 {
            let x = column as f32 * 128.0 + if row % 2 == 0 { 0.0 } else { 64.0 };
            let y = row as f32 * 64.0;
            let shade = gray(rng.range(196.0, 216.0));
            c.rect([x + 3.0, y + 3.0, x + 125.0, y + 61.0], shade);
        }
    }
    c.grain(rng, [32, 32], 5.0);
    c.grain(rng, [8, 8], 6.0);
    c.grain(rng, [2, 2], 5.0);
    c
}

pub(super) fn carpet(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 512, [96.0, 100.0, 112.0]);
    for (cell, amplitude) in [(128, 8.0), (16, 8.0), (4, 18.0), (2, 26.0)] {
        c.grain(rng, [cell, cell], amplitude);
    }
    c
}

pub(super) fn parquet(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(512, 512, [140.0, 100.0, 62.0]);
    for column in 0..8 {
        let x = column as f32 * 64.0;
        let mut y = -(rng.range(0.0, 200.0) as f32);
        while y < 512.0 {
            let length = rng.range(120.0, 260.0) as f32;
            let gain = rng.range(0.78, 1.15) as f32;
            c.rect(
                [x + 0.7, y + 0.7, x + 63.3, y + length - 0.7],
                [162.0 * gain, 117.0 * gain, 74.0 * gain],
            );
            y += length;
        }
    }
    c.grain(rng, [4, 64], 9.0);
    c.grain(rng, [2, 16], 9.0);
    c
}

pub(super) fn ceiling(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 256, [222.0, 222.0, 218.0]);
    c.rect([0.0, 0.0, 256.0, 3.0], gray(165.0));
    c.rect([0.0, 0.0, 3.0, 256.0], gray(165.0));
    for _ in 0..160 {
        let p = [rng.range(6.0, 250.0) as f32, rng.range(6.0, 250.0) as f32];
        let r = rng.range(0.8, 2.0) as f32;
        c.ellipse(p, [r, r], gray(rng.range(150.0, 190.0)));
    }
    c
}

pub(super) fn laminate(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(1024, 512, [226.0, 224.0, 222.0]);
    c.grain(rng, [64, 8], 5.0);
    c.grain(rng, [32, 2], 10.0);
    c.grain(rng, [8, 2], 7.0);
    c.grain(rng, [2, 2], 4.0);
    for _ in 0..90 {
        let p = [rng.range(0.0, 1024.0) as f32, rng.range(0.0, 512.0) as f32];
        let r = rng.range(1.0, 4.0) as f32;
        c.ellipse(p, [r, r * 0.7], gray(rng.range(150.0, 205.0)));
    }
    c
}

pub(super) fn wood(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 256, [150.0, 108.0, 66.0]);
    c.grain(rng, [8, 128], 18.0);
    c.grain(rng, [2, 32], 16.0);
    c.grain(rng, [2, 4], 9.0);
    c.grain(rng, [16, 16], 5.0);
    for _ in 0..3 {
        let (p, r) = (
            [rng.range(20.0, 236.0) as f32, rng.range(20.0, 236.0) as f32],
            rng.range(4.0, 9.0) as f32,
        );
        c.ellipse(p, [r, 1.6 * r], [95.0, 60.0, 35.0]);
        c.ellipse(p, [0.4 * r, 0.7 * r], [70.0, 42.0, 25.0]);
    }
    c
}

pub(super) fn fabric(rng: &mut Stream) -> Canvas {
    let base = [[44.0, 50.0, 70.0], [60.0, 60.0, 62.0], [90.0, 40.0, 40.0]][rng.below(3)];
    let mut c = Canvas::new(256, 256, base);
    c.grain(rng, [32, 32], 5.0);
    c.grain(rng, [4, 4], 6.0);
    c.grain(rng, [2, 2], 8.0);
    c
}

pub(super) fn plastic(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(64, 64, vivid(rng));
    c.grain(rng, [16, 16], 4.0);
    c
}

pub(super) fn black(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(64, 64, [24.0, 24.0, 26.0]);
    c.grain(rng, [16, 16], 3.0);
    c
}

/// Printed cardboard: shapes in many colours, a label, tape and text.
pub(super) fn carton(rng: &mut Stream) -> Canvas {
    let mut c = Canvas::new(256, 256, [186.0, 148.0, 104.0]);
    random_shapes(&mut c, rng, 26, [5.0, 22.0]);
    c.rect([118.0, 0.0, 140.0, 256.0], [214.0, 190.0, 150.0]);
    let ink = gray(38.0);
    c.text(rng, [12.0, 14.0, 112.0, 60.0], 24.0, ink);
    c.rect([148.0, 150.0, 246.0, 236.0], gray(238.0));
    c.text(rng, [154.0, 156.0, 240.0, 230.0], 9.0, ink);
    c.text(rng, [12.0, 190.0, 110.0, 246.0], 13.0, [120.0, 30.0, 30.0]);
    c.rect([0.0, 0.0, 256.0, 3.0], [120.0, 92.0, 62.0]);
    c.rect([0.0, 253.0, 256.0, 256.0], [120.0, 92.0, 62.0]);
    c.grain(rng, [2, 64], 5.0);
    c.grain(rng, [4, 4], 4.0);
    c
}
