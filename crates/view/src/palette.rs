//! Palettes of 255 colours for images, and the pixels to redraw.
//!
//! Groups of colours are split where that reduces the squared error most (Wu, Efficient statistical computations for optimal color
//! quantization, 1991, here over the list of colours that occur), and then refined by Lloyd's algorithm.

use crate::Picture;

/// Bits per channel by which colours are distinguished: finer differences are invisible.
const BITS: u32 = 6;
const LEVELS: usize = 1 << (3 * BITS);
/// Colours of a palette; the last index of 256 marks unchanged pixels.
const COLOURS: usize = 255;
/// Maximum difference per channel at which a pixel counts as unchanged: below the noise of most cameras.
const SAME: u8 = 9;
/// Lloyd iterations: two achieve most of the improvement.
const ROUNDS: usize = 2;

/// A colour that occurs, and its weight.
#[derive(Clone, Copy, Debug)]
struct Entry {
    rgb: [f32; 3],
    weight: f32,
}

pub(crate) struct Palette {
    colours: Vec<[f32; 3]>,
}

impl Palette {
    pub(crate) const UNCHANGED: u8 = COLOURS as u8;

    pub(crate) fn of(picture: &Picture) -> Self {
        let mut entries = entries(picture);
        let mut colours = split(&mut entries);
        for _ in 0..ROUNDS {
            colours = means(&entries, &colours);
        }
        Self { colours }
    }

    /// Interleaved RGB, for 256 indices.
    pub(crate) fn rgb(&self) -> Vec<u8> {
        let mut rgb: Vec<u8> = self.colours.iter().flatten().map(|v| byte(*v)).collect();
        rgb.resize(3 * (COLOURS + 1), 0);
        rgb
    }

    /// The index of each pixel. `shown` is the displayed image, which is updated; if its size differs, everything is drawn.
    pub(crate) fn indices(&self, picture: &Picture, shown: &mut Vec<u8>) -> Vec<u8> {
        let fresh = shown.len() != picture.data().len();
        shown.resize(picture.data().len(), 0);
        // Cached palette index plus 1; 0 if not looked up yet.
        let mut found = vec![0u16; LEVELS];
        let pixels = picture
            .data()
            .chunks_exact(3)
            .zip(shown.chunks_exact_mut(3));
        pixels
            .map(|(new, old)| {
                if !fresh
                    && new
                        .iter()
                        .zip(old.iter())
                        .all(|(a, b)| a.abs_diff(*b) <= SAME)
                {
                    return Self::UNCHANGED;
                }
                let key = key(new);
                if found[key] == 0 {
                    let rgb = [new[0], new[1], new[2]].map(f32::from);
                    found[key] = nearest(&self.colours, rgb) as u16 + 1;
                }
                let index = usize::from(found[key] - 1);
                for (old, v) in old
                    .iter_mut()
                    .zip(self.colours.get(index).unwrap_or(&[0.0; 3]))
                {
                    *old = byte(*v);
                }
                index as u8
            })
            .collect()
    }
}

fn byte(v: f32) -> u8 {
    (v + 0.5) as u8
}

fn key(rgb: &[u8]) -> usize {
    rgb.iter()
        .fold(0, |key, v| key << BITS | usize::from(v >> (8 - BITS)))
}

/// The colours that occur, in a fixed order. Rare ones get additional weight, or a few marks on a large wall would have no palette colour.
fn entries(picture: &Picture) -> Vec<Entry> {
    let mut sums = vec![[0u32; 4]; LEVELS];
    for rgb in picture.data().chunks_exact(3) {
        let sum = &mut sums[key(rgb)];
        for (s, v) in sum.iter_mut().zip(rgb) {
            *s += u32::from(*v);
        }
        sum[3] += 1;
    }
    sums.iter()
        .filter(|s| s[3] > 0)
        .map(|s| Entry {
            rgb: [s[0], s[1], s[2]].map(|v| v as f32 / s[3] as f32),
            weight: (s[3] as f32).sqrt(),
        })
        .collect()
}

/// Sum of weights, weighted sums and weighted sums of squares of a list of colours.
#[derive(Clone, Copy, Debug, Default)]
struct Moments {
    weight: f64,
    sum: [f64; 3],
    squares: [f64; 3],
}

impl Moments {
    fn add(&mut self, e: &Entry) {
        let w = f64::from(e.weight);
        self.weight += w;
        for c in 0..3 {
            let v = f64::from(e.rgb[c]);
            self.sum[c] += w * v;
            self.squares[c] += w * v * v;
        }
    }

    fn of(entries: &[Entry]) -> Self {
        let mut all = Self::default();
        for e in entries {
            all.add(e);
        }
        all
    }

    /// Squared error of each channel when the mean represents all.
    fn errors(&self) -> [f64; 3] {
        [0, 1, 2]
            .map(|c| (self.squares[c] - self.sum[c] * self.sum[c] / self.weight.max(1e-9)).max(0.0))
    }

    fn error(&self) -> f64 {
        self.errors().iter().sum()
    }

    fn without(&self, other: &Self) -> Self {
        Self {
            weight: self.weight - other.weight,
            sum: [0, 1, 2].map(|c| self.sum[c] - other.sum[c]),
            squares: [0, 1, 2].map(|c| self.squares[c] - other.squares[c]),
        }
    }

    fn mean(&self) -> [f32; 3] {
        self.sum.map(|s| (s / self.weight.max(1e-9)) as f32)
    }
}

/// The means of the groups into which the colours are split, at most [`COLOURS`].
fn split(entries: &mut [Entry]) -> Vec<[f32; 3]> {
    let all = Moments::of(entries);
    // First and last entry (exclusive) of each group.
    let mut groups = vec![(0, entries.len(), all)];
    while groups.len() < COLOURS {
        let worst = (0..groups.len()).max_by(|a, b| {
            let (a, b) = (groups[*a].2.error(), groups[*b].2.error());
            a.total_cmp(&b)
        });
        let Some(worst) = worst.filter(|i| groups[*i].2.error() > 1.0) else {
            break;
        };
        let (from, to, moments) = groups[worst];
        let Some((middle, first)) = best_cut(&mut entries[from..to], &moments) else {
            break;
        };
        groups[worst] = (from, from + middle, first);
        groups.push((from + middle, to, moments.without(&first)));
    }
    groups.iter().map(|(_, _, m)| m.mean()).collect()
}

/// Sorts a group along its widest channel; returns the cut, and the moments before it.
fn best_cut(group: &mut [Entry], moments: &Moments) -> Option<(usize, Moments)> {
    let errors = moments.errors();
    let widest = (0..3).max_by(|a, b| errors[*a].total_cmp(&errors[*b]))?;
    group.sort_by(|a, b| a.rgb[widest].total_cmp(&b.rgb[widest]));
    let mut before = Moments::default();
    let mut best: Option<(f64, usize, Moments)> = None;
    for i in 1..group.len() {
        before.add(&group[i - 1]);
        let error = before.error() + moments.without(&before).error();
        if best.is_none_or(|(least, _, _)| error < least) {
            best = Some((error, i, before));
        }
    }
    best.map(|(_, i, m)| (i, m))
}

/// Index of the nearest colour; the first of equals.
fn nearest(colours: &[[f32; 3]], rgb: [f32; 3]) -> usize {
    let mut best = (f32::INFINITY, 0);
    for (i, c) in colours.iter().enumerate() {
        let d: f32 = c.iter().zip(rgb).map(|(a, b)| (a - b) * (a - b)).sum();
        if d < best.0 {
            best = (d, i);
        }
    }
    best.1
}

/// Moves each colour to the mean of its nearest entries.
fn means(entries: &[Entry], colours: &[[f32; 3]]) -> Vec<[f32; 3]> {
    let mut moments = vec![Moments::default(); colours.len()];
    for e in entries {
        moments[nearest(colours, e.rgb)].add(e);
    }
    let moved = moments.iter().zip(colours);
    moved
        .map(|(m, old)| if m.weight > 0.0 { m.mean() } else { *old })
        .collect()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Colour;

    fn error(picture: &Picture) -> (f64, u8) {
        let palette = Palette::of(picture);
        let mut shown = Vec::new();
        palette.indices(picture, &mut shown);
        let differences = picture
            .data()
            .iter()
            .zip(&shown)
            .map(|(a, b)| a.abs_diff(*b));
        let sum: f64 = differences.clone().map(|d| f64::from(d).powi(2)).sum();
        (
            (sum / shown.len() as f64).sqrt(),
            differences.max().unwrap(),
        )
    }

    #[test]
    fn few_colours_are_kept_exactly() {
        let mut p = Picture::new(40, 30, Colour(200, 201, 202));
        for i in 0..200i64 {
            let colour = Colour(
                (i * 7 % 251) as u8,
                (i * 13 % 241) as u8,
                (i * 29 % 239) as u8,
            );
            p.fill((i % 40, i / 40), (i % 40 + 1, i / 40 + 1), colour, 1.0);
        }
        let (rms, most) = error(&p);
        assert!(rms < 0.8 && most <= 4, "{rms} {most}");
        assert_eq!(error(&Picture::new(3, 2, Colour::RIGID)), (0.0, 0));
    }

    #[test]
    fn many_colours_are_approximated_and_rare_marks_kept() {
        // Every colour of a slice through the cube, and one mark of nine pixels.
        let pixels =
            (0..256 * 256).flat_map(|i| [(i % 256) as u8 / 2 + 60, (i / 256) as u8 / 2 + 60, 120]);
        let image = stillpoint_imaging::ColourImage::from_vec(256, 256, pixels.collect()).unwrap();
        let mut p = Picture::from_colour(&image);
        p.fill((100, 100), (103, 103), Colour::RIGID, 1.0);
        let (rms, _) = error(&p);
        assert!(rms < 3.5, "{rms}");
        let palette = Palette::of(&p);
        let mut shown = Vec::new();
        palette.indices(&p, &mut shown);
        let at = 3 * (101 * 256 + 101);
        let Colour(r, g, b) = Colour::RIGID;
        for (found, wanted) in shown[at..at + 3].iter().zip([r, g, b]) {
            assert!(found.abs_diff(wanted) < 8, "{:?}", &shown[at..at + 3]);
        }
    }

    #[test]
    fn unchanged_pixels_are_not_redrawn() {
        let mut p = Picture::new(20, 10, Colour(100, 100, 100));
        let mut shown = Vec::new();
        let first = Palette::of(&p).indices(&p, &mut shown);
        assert!(first.iter().all(|i| *i != Palette::UNCHANGED));
        p.fill((0, 0), (20, 5), Colour(104, 98, 100), 1.0);
        p.fill((3, 7), (5, 8), Colour::RIGID, 1.0);
        let second = Palette::of(&p).indices(&p, &mut shown);
        assert_eq!(
            second.iter().filter(|i| **i != Palette::UNCHANGED).count(),
            2
        );
        assert_eq!(shown[3 * (7 * 20 + 3)], Colour::RIGID.0);
        assert_eq!(shown[0], 100);
    }
}
