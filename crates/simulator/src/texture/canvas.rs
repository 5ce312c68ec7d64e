//! Paints anti-aliased shapes, letter-like glyphs and noise on a float image.

use crate::random::Stream;

pub(crate) struct Canvas {
    pub(crate) width: usize,
    pub(crate) height: usize,
    pub(crate) pixels: Vec<[f32; 3]>,
}

pub(crate) type Rgb = [f32; 3];

impl Canvas {
    pub(crate) fn new(width: usize, height: usize, colour: Rgb) -> Self {
        Self {
            width,
            height,
            pixels: vec![colour; width * height],
        }
    }

    /// The next mip level: means of 2 x 2 pixels (2 x 1 where one side is already 1).
    pub(crate) fn halved(&self) -> Self {
        let (dx, dy) = (self.width.min(2), self.height.min(2));
        let mut half = Self::new(self.width / dx, self.height / dy, [0.0; 3]);
        let share = 1.0 / (dx * dy) as f32;
        for y in 0..half.height {
            for x in 0..half.width {
                let mut sum = [0.0; 3];
                for (j, i) in [(0, 0), (0, 1), (1, 0), (1, 1)] {
                    if i < dx && j < dy {
                        let p = self.pixels[(y * dy + j) * self.width + x * dx + i];
                        (0..3).for_each(|c| sum[c] += p[c] * share);
                    }
                }
                half.pixels[y * half.width + x] = sum;
            }
        }
        half
    }

    /// Paints a shape given by its signed distance `sdf` (px, negative inside), with soft borders of one pixel. `bounds` is [left, top,
    /// right, bottom] of the shape.
    pub(crate) fn shape(&mut self, bounds: [f32; 4], colour: Rgb, sdf: impl Fn(f32, f32) -> f32) {
        let clip = |v: f32, max: usize| v.clamp(0.0, max as f32) as usize;
        for y in clip(bounds[1] - 1.0, self.height)..clip(bounds[3] + 2.0, self.height) {
            for x in clip(bounds[0] - 1.0, self.width)..clip(bounds[2] + 2.0, self.width) {
                let cover = (0.5 - sdf(x as f32 + 0.5, y as f32 + 0.5)).clamp(0.0, 1.0);
                if cover > 0.0 {
                    let p = &mut self.pixels[y * self.width + x];
                    (0..3).for_each(|c| p[c] += (colour[c] - p[c]) * cover);
                }
            }
        }
    }

    /// An axis-aligned rectangle [left, top, right, bottom].
    pub(crate) fn rect(&mut self, r: [f32; 4], colour: Rgb) {
        self.shape(r, colour, |x, y| {
            (r[0] - x).max(x - r[2]).max(r[1] - y).max(y - r[3])
        });
    }

    /// A rectangle about a centre with half sides `half`, rotated by an angle given as (cos, sin).
    pub(crate) fn turned_rect(
        &mut self,
        [cx, cy]: [f32; 2],
        half: [f32; 2],
        [c, s]: [f32; 2],
        colour: Rgb,
    ) {
        let r = half[0] + half[1];
        self.shape([cx - r, cy - r, cx + r, cy + r], colour, |x, y| {
            let (dx, dy) = (x - cx, y - cy);
            ((c * dx + s * dy).abs() - half[0]).max((c * dy - s * dx).abs() - half[1])
        });
    }

    pub(crate) fn ellipse(&mut self, [cx, cy]: [f32; 2], [rx, ry]: [f32; 2], colour: Rgb) {
        self.shape([cx - rx, cy - ry, cx + rx, cy + ry], colour, |x, y| {
            let (dx, dy) = ((x - cx) / rx, (y - cy) / ry);
            ((dx * dx + dy * dy).sqrt() - 1.0) * rx.min(ry)
        });
    }

    /// A stroke from `a` to `b` of half width `w`.
    pub(crate) fn stroke(&mut self, a: [f32; 2], b: [f32; 2], w: f32, colour: Rgb) {
        let (ux, uy) = (b[0] - a[0], b[1] - a[1]);
        let length2 = (ux * ux + uy * uy).max(1e-6);
        let bounds = [
            a[0].min(b[0]) - w,
            a[1].min(b[1]) - w,
            a[0].max(b[0]) + w,
            a[1].max(b[1]) + w,
        ];
        self.shape(bounds, colour, |x, y| {
            let (px, py) = (x - a[0], y - a[1]);
            let h = ((px * ux + py * uy) / length2).clamp(0.0, 1.0);
            let (dx, dy) = (px - h * ux, py - h * uy);
            (dx * dx + dy * dy).sqrt() - w
        });
    }

    /// One letter-like glyph: three or four strokes between points of a 3 x 3 grid in the box at (x, y).
    fn glyph(&mut self, rng: &mut Stream, [x, y]: [f32; 2], size: f32, colour: Rgb) {
        let at = |k: usize| {
            [
                x + (k % 3) as f32 * 0.3 * size,
                y + (k / 3) as f32 * 0.5 * size,
            ]
        };
        let mut from = rng.below(9);
        for _ in 0..3 + rng.below(2) {
            let to = (from + 1 + rng.below(8)) % 9;
            self.stroke(at(from), at(to), 0.075 * size, colour);
            from = to;
        }
    }

    /// Lines of words in a box [left, top, right, bottom], glyphs of `size` px.
    pub(crate) fn text(&mut self, rng: &mut Stream, r: [f32; 4], size: f32, colour: Rgb) {
        let mut y = r[1];
        while y + size <= r[3] {
            let end = r[2]
                - if rng.chance(0.3) {
                    rng.unit() as f32 * 0.6 * (r[2] - r[0])
                } else {
                    0.0
                };
            let mut x = r[0];
            let mut left = 2 + rng.below(8);
            while x + 0.7 * size <= end {
                if left == 0 {
                    left = 2 + rng.below(8);
                    x += 0.5 * size;
                    continue;
                }
                self.glyph(rng, [x, y], size, colour);
                x += 0.9 * size;
                left -= 1;
            }
            y += 1.7 * size;
        }
    }

    /// Adds smooth periodic noise of the given amplitude, with lattice cells of `cell` = [x, y] px (which must divide the sides), equal in
    /// all channels.
    pub(crate) fn grain(&mut self, rng: &mut Stream, cell: [usize; 2], amplitude: f32) {
        let (nx, ny) = (
            (self.width / cell[0]).max(1),
            (self.height / cell[1]).max(1),
        );
        let lattice: Vec<f32> = (0..nx * ny)
            .map(|_| rng.range(-1.0, 1.0) as f32 * amplitude)
            .collect();
        let across: Vec<f32> = (0..cell[0]).map(|x| x as f32 / cell[0] as f32).collect();
        for (y, row) in self.pixels.chunks_exact_mut(self.width).enumerate() {
            let (j, fy) = (y / cell[1] % ny, (y % cell[1]) as f32 / cell[1] as f32);
            let (row0, row1) = (j * nx, (j + 1) % ny * nx);
            for (i, pixels) in row.chunks_mut(cell[0]).enumerate() {
                let (i, k) = (i % nx, (i + 1) % nx);
                let [a, b] = [lattice[row0 + i], lattice[row0 + k]];
                let [c, d] = [lattice[row1 + i], lattice[row1 + k]];
                for (pixel, fx) in pixels.iter_mut().zip(&across) {
                    let (top, bottom) = (a + (b - a) * fx, c + (d - c) * fx);
                    let v = top + (bottom - top) * fy;
                    pixel.iter_mut().for_each(|p| *p += v);
                }
            }
        }
    }
}
