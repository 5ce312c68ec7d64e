//! FAST-9/16 corners of one image.
//!
//! The score of a pixel is the largest threshold `t` at which nine adjacent pixels of the circle of 16 around it are
//! all brighter than the centre by at least `t`, or all darker: it is a corner at threshold `t` if its score is above
//! `t` (Rosten and Drummond, ECCV 2006).

mod cells;

use cells::Cells;
use std::ops::Range;

use stillpoint_imaging::{GrayImage, Simd};

/// The Bresenham circle of radius 3, px, in order (Rosten, Drummond, ECCV 2006).
pub(crate) const CIRCLE: [(i32, i32); 16] = [
    (0, 3),
    (1, 3),
    (2, 2),
    (3, 1),
    (3, 0),
    (3, -1),
    (2, -2),
    (1, -3),
    (0, -3),
    (-1, -3),
    (-2, -2),
    (-3, -1),
    (-3, 0),
    (-3, 1),
    (-2, 2),
    (-1, 3),
];

/// Number of rows that are scored and searched together. Chosen: their scores, some kilobytes, stay in the cache.
const ROWS: usize = 8;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) struct Corner {
    pub(crate) x: u16,
    pub(crate) y: u16,
    pub(crate) score: u8,
}

/// Corner detector for one image size, with its buffers.
#[derive(Clone, Debug, Default)]
pub(crate) struct FastDetector {
    scores: GrayImage,
    corners: Vec<Corner>,
    cells: Cells,
    simd: Simd,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct FastOptions {
    pub(crate) high: u8,
    pub(crate) low: u8,
    /// Distance of corners to the border, px; at least 4.
    pub(crate) margin: usize,
}

impl FastDetector {
    pub(crate) fn new(simd: Simd) -> Self {
        Self {
            simd,
            ..Self::default()
        }
    }

    /// Corners after non-maximum suppression, row by row: those above `high`, and in cells without any of these those
    /// above `low`.
    pub(crate) fn detect(&mut self, image: &GrayImage, options: &FastOptions) -> &[Corner] {
        debug_assert!(options.margin >= 4);
        self.corners.clear();
        let (width, height) = (image.width(), image.height());
        if (self.scores.width(), self.scores.height()) != (width, height) {
            self.scores.resize(width, height);
            // The region outside the searched rectangle is not written again.
            self.scores.data_mut().fill(0);
        }
        if width <= 2 * options.margin || height <= 2 * options.margin {
            return &self.corners;
        }
        self.cells.lay_out((width, height), options);
        // Rows of scores are searched while in the nearest cache. One more row on each side is needed for suppression.
        let (first, end) = (options.margin, height - options.margin);
        let mut scored = first - 1;
        for start in (first..end).step_by(ROWS) {
            let rows = start..(start + ROWS).min(end);
            let until = rows.end + 1;
            score_rows(
                image,
                scored..until,
                options,
                self.scores.data_mut(),
                self.simd,
            );
            scored = until;
            self.find_maxima(rows, options);
        }
        // Weak corners found before the first strong one of their cell.
        let cells = &self.cells;
        self.corners
            .retain(|corner| corner.score > options.high || !cells.is_strong(corner));
        &self.corners
    }

    pub(crate) fn corners(&self) -> &[Corner] {
        &self.corners
    }

    /// The scores of the last call of `detect`: 0 where there is no corner at the low threshold.
    pub(crate) fn scores(&self) -> &GrayImage {
        &self.scores
    }

    fn find_maxima(&mut self, rows: Range<usize>, options: &FastOptions) {
        let margin = options.margin;
        let columns = margin..self.scores.width() - margin;
        for y in rows {
            if (y - margin).is_multiple_of(self.cells.height) {
                self.cells.thresholds.fill(options.low);
            }
            let before = self.corners.len();
            let thresholds = &self.cells.thresholds;
            find_row_maxima(
                &self.scores,
                y,
                columns.clone(),
                thresholds,
                &mut self.corners,
                self.simd,
            );
            for corner in &self.corners[before..] {
                if corner.score > options.high {
                    self.cells.mark_strong(corner, options.high);
                }
            }
        }
    }
}

fn score_rows(
    image: &GrayImage,
    rows: Range<usize>,
    options: &FastOptions,
    scores: &mut [u8],
    simd: Simd,
) {
    let width = image.width();
    let columns = options.margin - 1..width - options.margin + 1;
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::score_rows(image, rows, columns, options.low, scores);
    }
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::score_rows(image, rows, columns, options.low, scores);
    }
    let _ = simd;
    for y in rows {
        let out = &mut scores[y * width..(y + 1) * width];
        score_span(image, y, columns.clone(), options.low, out);
    }
}

/// Scores of the pixels `columns` of row `y`, which are at least 3 px from the border; 0 for scores up to `low`.
pub(crate) fn score_span(
    image: &GrayImage,
    y: usize,
    columns: Range<usize>,
    low: u8,
    out: &mut [u8],
) {
    let width = image.width();
    let offsets = CIRCLE.map(|(dx, dy)| dy as isize * width as isize + dx as isize);
    let data = image.data();
    let mut x = columns.start;
    while x + LANES <= columns.end {
        let index = y * width + x;
        out[x..x + LANES].copy_from_slice(&score_lanes::<LANES>(data, index, &offsets, low));
        x += LANES;
    }
    while x < columns.end {
        out[x] = score_lanes::<1>(data, y * width + x, &offsets, low)[0];
        x += 1;
    }
}

/// Number of pixels per block of the portable kernel: arrays of 16 bytes become vector registers of 128 bits wherever
/// available.
const LANES: usize = 16;

fn lanes<const N: usize>(a: [u8; N], b: [u8; N], f: impl Fn(u8, u8) -> u8) -> [u8; N] {
    std::array::from_fn(|i| f(a[i], b[i]))
}

/// Scores of `N` pixels from `index` on, 0 for scores up to `low`.
fn score_lanes<const N: usize>(
    data: &[u8],
    index: usize,
    offsets: &[isize; 16],
    low: u8,
) -> [u8; N] {
    let load = |from: usize| -> [u8; N] {
        let mut values = [0; N];
        values.copy_from_slice(&data[from..from + N]);
        values
    };
    let least = |a, b| lanes(a, b, u8::min);
    let most = |a, b| lanes(a, b, u8::max);
    let at = |k: usize| load(index.wrapping_add_signed(offsets[k]));
    let centre = load(index);
    let score_of = |bright, dark| {
        most(
            lanes(bright, centre, u8::saturating_sub),
            lanes(centre, dark, u8::saturating_sub),
        )
    };
    // Nine adjacent pixels of 16 contain at least one of any two opposite ones, so these bound the score.
    let (mut bright, mut dark) = ([u8::MAX; N], [u8::MIN; N]);
    for k in [0, 4, 2, 6] {
        let (a, b) = (at(k), at(k + 8));
        bright = least(bright, most(a, b));
        dark = most(dark, least(a, b));
    }
    if score_of(bright, dark).iter().fold(0, |a, &b| a.max(b)) <= low {
        return [0; N];
    }
    let circle: [[u8; N]; 16] = std::array::from_fn(at);
    (bright, dark) = ([u8::MIN; N], [u8::MAX; N]);
    // The arcs of nine that start at k and at k + 1 share the eight pixels from k + 1 on.
    for k in (0..16).step_by(2) {
        let (mut low_end, mut high_end) = (circle[k + 1], circle[k + 1]);
        for i in 2..9 {
            low_end = least(low_end, circle[(k + i) % 16]);
            high_end = most(high_end, circle[(k + i) % 16]);
        }
        let (first, last) = (circle[k], circle[(k + 9) % 16]);
        bright = most(bright, least(low_end, most(first, last)));
        dark = least(dark, most(high_end, least(first, last)));
    }
    score_of(bright, dark).map(|score| if score > low { score } else { 0 })
}

/// Appends the pixels `columns` of row `y` whose score exceeds their column's threshold, is above that of the preceding
/// neighbours and not below that of the following ones: of equal neighbours the first wins.
fn find_row_maxima(
    scores: &GrayImage,
    y: usize,
    columns: Range<usize>,
    thresholds: &[u8],
    corners: &mut Vec<Corner>,
    simd: Simd,
) {
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::find_row_maxima(scores, y, columns, thresholds, corners);
    }
    #[cfg(target_arch = "aarch64")]
    if simd.has_neon() {
        return crate::neon::find_row_maxima(scores, y, columns, thresholds, corners);
    }
    let _ = simd;
    maxima_span(scores, y, columns, thresholds, corners);
}

/// [`find_row_maxima`] for any machine.
pub(crate) fn maxima_span(
    scores: &GrayImage,
    y: usize,
    columns: Range<usize>,
    thresholds: &[u8],
    corners: &mut Vec<Corner>,
) {
    let (above, row, below) = (scores.row(y - 1), scores.row(y), scores.row(y + 1));
    for x in columns {
        let score = row[x];
        if score <= thresholds[x] {
            continue;
        }
        let before = above[x - 1].max(above[x]).max(above[x + 1]).max(row[x - 1]);
        let after = below[x - 1].max(below[x]).max(below[x + 1]).max(row[x + 1]);
        if score > before && score >= after {
            corners.push(Corner {
                x: x as u16,
                y: y as u16,
                score,
            });
        }
    }
}

#[cfg(test)]
mod tests {
    use proptest::prelude::*;

    use super::*;

    const OPTIONS: FastOptions = FastOptions {
        high: 20,
        low: 7,
        margin: 4,
    };

    /// The definition: nine adjacent pixels of the circle all brighter, or all darker, by more than the threshold.
    fn is_corner(image: &GrayImage, x: usize, y: usize, threshold: i32) -> bool {
        let centre = i32::from(image.at(x, y));
        let differences = CIRCLE.map(|(dx, dy)| {
            let (x, y) = (x as i32 + dx, y as i32 + dy);
            i32::from(image.at(x as usize, y as usize)) - centre
        });
        let arc = |start: usize, sign: i32| {
            (start..start + 9).all(|k| sign * differences[k % 16] > threshold)
        };
        (0..16).any(|start| arc(start, 1) || arc(start, -1))
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(48))]
        #[test]
        fn scores_match_the_fast_definition(
            width in 9_usize..80, height in 9_usize..14, palette in any::<[u8; 3]>(), seed in any::<u64>(),
        ) {
            // Few grey values, so that arcs of nine occur.
            let mut state = seed;
            let data = (0..width * height).map(|_| {
                state = state.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
                palette[[0, 0, 0, 1, 1, 2][(state >> 40) as usize % 6]]
            });
            let image = GrayImage::from_vec(width, height, data.collect()).expect("this size");
            for simd in [Simd::Scalar, Simd::detect()] {
                let mut detector = FastDetector::new(simd);
                detector.detect(&image, &OPTIONS);
                for y in 3..height - 3 {
                    for x in 3..width - 3 {
                        let score = i32::from(detector.scores().at(x, y));
                        prop_assert!(score == 0 || score > 7);
                        prop_assert_eq!(score > 0, is_corner(&image, x, y, 7));
                        prop_assert!(score == 0 || is_corner(&image, x, y, score - 1));
                        prop_assert!(score == 0 || !is_corner(&image, x, y, score));
                    }
                }
            }
        }
    }

    #[test]
    fn square_has_four_corners() {
        let bright = |x: usize, y: usize| (20..40).contains(&x) && (24..50).contains(&y);
        let data = (0..64 * 80)
            .map(|i| if bright(i % 64, i / 64) { 150 } else { 50 })
            .collect();
        let image = GrayImage::from_vec(64, 80, data).expect("this size");
        for simd in [Simd::Scalar, Simd::detect()] {
            let mut detector = FastDetector::new(simd);
            let corners = detector.detect(&image, &OPTIONS);
            for (x, y) in [(20_u16, 24_u16), (39, 24), (20, 49), (39, 49)] {
                let near = corners
                    .iter()
                    .filter(|c| c.x.abs_diff(x) <= 2 && c.y.abs_diff(y) <= 2);
                assert_eq!(near.count(), 1, "at ({x}, {y}): {corners:?}");
            }
            assert_eq!(corners.len(), 4);
            assert!(corners.iter().all(|corner| corner.score == 100));
        }
    }
}
