//! FAST-9/16 corners of one image.
//!
//! The score of a pixel is the largest threshold `t` at which nine adjacent pixels of the circle of 16 around it are all brighter than the centre by
//! at least `t`, or all darker: it is a corner at threshold `t` exactly when its score is above `t` (Rosten and Drummond, ECCV 2006).

use stillpoint_imaging::{GrayImage, Simd};

/// The Bresenham circle of radius 3, px, in order.
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

/// Side of a cell that is searched with the low threshold when the other finds nothing, px.
const CELL: usize = 32;

/// A corner of one level.
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
    cell_is_strong: Vec<bool>,
    simd: Simd,
}

/// What to look for and where.
#[derive(Clone, Copy, Debug)]
pub(crate) struct FastOptions {
    pub(crate) high: u8,
    pub(crate) low: u8,
    /// Corners keep this distance to the border, px; at least 4.
    pub(crate) margin: usize,
}

impl FastDetector {
    pub(crate) fn new(simd: Simd) -> Self {
        Self {
            simd,
            ..Self::default()
        }
    }

    /// Corners after non-maximum suppression, row by row: those above `high`, and in cells without any of these those above `low`.
    pub(crate) fn detect(&mut self, image: &GrayImage, options: &FastOptions) -> &[Corner] {
        debug_assert!(options.margin >= 4);
        self.corners.clear();
        let (width, height) = (image.width(), image.height());
        if (self.scores.width(), self.scores.height()) != (width, height) {
            self.scores.resize(width, height);
            // What lies outside the searched rectangle is never written again.
            self.scores.data_mut().fill(0);
        }
        if width <= 2 * options.margin || height <= 2 * options.margin {
            return &self.corners;
        }
        score_image(image, options, self.scores.data_mut(), self.simd);
        find_maxima(&self.scores, options.margin, &mut self.corners, self.simd);
        self.prefer_strong(options, width, height);
        &self.corners
    }

    /// The corners of the last call of `detect`.
    pub(crate) fn corners(&self) -> &[Corner] {
        &self.corners
    }

    /// The scores of the last call of `detect`: 0 where there is no corner at the low threshold.
    pub(crate) fn scores(&self) -> &GrayImage {
        &self.scores
    }

    fn prefer_strong(&mut self, options: &FastOptions, width: usize, height: usize) {
        let margin = options.margin;
        let (inner_width, inner_height) = (width - 2 * margin, height - 2 * margin);
        // Cells of equal size as near to CELL as the image allows.
        let across = ((inner_width + CELL / 2) / CELL).max(1);
        let down = ((inner_height + CELL / 2) / CELL).max(1);
        let cell_width = inner_width.div_ceil(across) as u32;
        let cell_height = inner_height.div_ceil(down) as u32;
        let cell_of = |corner: &Corner| {
            let column = (u32::from(corner.x) - margin as u32) / cell_width;
            let row = (u32::from(corner.y) - margin as u32) / cell_height;
            row as usize * across + column as usize
        };
        self.cell_is_strong.clear();
        self.cell_is_strong.resize(across * down, false);
        for corner in &self.corners {
            if corner.score > options.high {
                self.cell_is_strong[cell_of(corner)] = true;
            }
        }
        let strong = &self.cell_is_strong;
        self.corners
            .retain(|corner| corner.score > options.high || !strong[cell_of(corner)]);
    }
}

fn score_image(image: &GrayImage, options: &FastOptions, scores: &mut [u8], simd: Simd) {
    let (width, height) = (image.width(), image.height());
    // One pixel more on each side: suppression looks at all neighbours of a corner.
    let columns = options.margin - 1..width - options.margin + 1;
    let rows = options.margin - 1..height - options.margin + 1;
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::score_rows(image, rows, columns, options.low, scores);
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
    columns: std::ops::Range<usize>,
    low: u8,
    out: &mut [u8],
) {
    let width = image.width();
    let data = image.data();
    let offsets = CIRCLE.map(|(dx, dy)| dy as isize * width as isize + dx as isize);
    for x in columns {
        let index = y * width + x;
        let centre = data[index];
        let at = |k: usize| data[index.wrapping_add_signed(offsets[k])];
        // Nine adjacent pixels of 16 hold at least one of any two opposite ones, so these bound the score.
        let (mut bright, mut dark) = (u8::MAX, u8::MIN);
        for k in [0, 4, 2, 6] {
            bright = bright.min(at(k).max(at(k + 8)));
            dark = dark.max(at(k).min(at(k + 8)));
        }
        let bound = bright
            .saturating_sub(centre)
            .max(centre.saturating_sub(dark));
        out[x] = if bound > low {
            let score = score_of(std::array::from_fn(at), centre);
            if score > low { score } else { 0 }
        } else {
            0
        };
    }
}

/// The FAST score of a centre with this circle.
fn score_of(circle: [u8; 16], centre: u8) -> u8 {
    // Arcs of nine starting at k and at k + 1, for odd k + 1, share the eight pixels from k + 1 on.
    let (mut bright, mut dark) = (u8::MIN, u8::MAX);
    for k in (0..16).step_by(2) {
        let (mut least, mut most) = (u8::MAX, u8::MIN);
        for i in 1..9 {
            least = least.min(circle[(k + i) % 16]);
            most = most.max(circle[(k + i) % 16]);
        }
        let (first, last) = (circle[k], circle[(k + 9) % 16]);
        bright = bright.max(least.min(first.max(last)));
        dark = dark.min(most.max(first.min(last)));
    }
    bright
        .saturating_sub(centre)
        .max(centre.saturating_sub(dark))
}

fn find_maxima(scores: &GrayImage, margin: usize, corners: &mut Vec<Corner>, simd: Simd) {
    let columns = margin..scores.width() - margin;
    let rows = margin..scores.height() - margin;
    #[cfg(target_arch = "x86_64")]
    if simd.has_avx2() {
        return crate::avx2::find_maxima(scores, rows, columns, corners);
    }
    let _ = simd;
    for y in rows {
        maxima_span(scores, y, columns.clone(), corners);
    }
}

/// Appends the pixels `columns` of row `y` whose score is above that of the neighbours before and not below that of the neighbours after them: of
/// equal neighbours the first one wins.
pub(crate) fn maxima_span(
    scores: &GrayImage,
    y: usize,
    columns: std::ops::Range<usize>,
    corners: &mut Vec<Corner>,
) {
    let (above, row, below) = (scores.row(y - 1), scores.row(y), scores.row(y + 1));
    for x in columns {
        let score = row[x];
        if score == 0 {
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
