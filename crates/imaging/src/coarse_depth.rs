//! Depth images reduced to cells, for depth-connected regions and motion detection.

use crate::{DepthImage, workers};
use std::array::from_fn;

/// Maximum depth range of samples of one surface, as a share of their depth.
const ONE_SURFACE: f32 = 0.03;

/// One depth per square cell of the image; 0 where most of the cell has no depth.
///
/// The depth of a cell is the mean of the valid ones among 16 samples when they belong to one surface, else their
/// median: at an edge it is the depth of one side, never a mean of both.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct CoarseDepth {
    cell: usize,
    width: usize,
    height: usize,
    data: Vec<f32>,
}

impl CoarseDepth {
    /// Reduces a depth image to cells of `cell` x `cell` px (at least 4); a remainder at the right and bottom is
    /// ignored.
    #[must_use]
    pub fn new(depth: &DepthImage, cell: usize) -> Self {
        let mut coarse = Self::default();
        coarse.rebuild(depth, cell);
        coarse
    }

    /// As [`CoarseDepth::new`], reusing the memory.
    pub fn rebuild(&mut self, depth: &DepthImage, cell: usize) {
        // Larger than any image.
        let cell = cell.clamp(4, 1 << 24);
        let (width, height) = (depth.width() / cell, depth.height() / cell);
        (self.cell, self.width, self.height) = (cell, width, height);
        self.data.resize(width * height, 0.0);
        workers::in_rows(&mut self.data, width, |first, data| {
            reduce_rows(depth, cell, first, data);
        });
    }

    /// Side of a cell, px.
    #[must_use]
    pub fn cell(&self) -> usize {
        self.cell
    }

    /// Number of cells in a row.
    #[must_use]
    pub fn width(&self) -> usize {
        self.width
    }

    /// Number of rows of cells.
    #[must_use]
    pub fn height(&self) -> usize {
        self.height
    }

    /// Depths, m, row by row; 0 where unknown.
    #[must_use]
    pub fn data(&self) -> &[f32] {
        &self.data
    }

    /// Depth of a cell, m; `None` where unknown or outside.
    #[must_use]
    pub fn get(&self, x: usize, y: usize) -> Option<f32> {
        let inside = x < self.width && y < self.height;
        inside
            .then(|| self.data[y * self.width + x])
            .filter(|z| *z > 0.0)
    }

    /// The raw pixel at the middle of a cell.
    #[must_use]
    #[inline]
    pub fn centre(&self, x: usize, y: usize) -> [f64; 2] {
        let size = self.cell as f64;
        let middle = |i: usize| (i as f64 + 0.5) * size - 0.5;
        [middle(x), middle(y)]
    }
}

/// Depths of some rows of cells of `cell` x `cell` px, from row `first` on.
fn reduce_rows(depth: &DepthImage, cell: usize, first: usize, data: &mut [f32]) {
    let width = depth.width() / cell;
    let offsets = [0, 1, 2, 3].map(|i| (2 * i + 1) * cell / 8);
    for (y, data) in (first..).zip(data.chunks_mut(width.max(1))) {
        let rows = offsets.map(|o| {
            let start = (y * cell + o) * depth.width();
            &depth.data()[start..start + width * cell]
        });
        let blocks = if cell == BLOCK_CELL { width / LANES } else { 0 };
        for x in 0..blocks {
            let block = |row: &&[f32]| row.as_chunks().0[x * LANES..].first_chunk().copied();
            let [a, b, c, d] = rows.each_ref().map(block);
            if let (Some(a), Some(b), Some(c), Some(d)) = (a, b, c, d) {
                let reduced = Samples::of_block([&a, &b, &c, &d]).reduce();
                data[x * LANES..][..LANES].copy_from_slice(&reduced);
            }
        }
        for (x, z) in data.iter_mut().enumerate().skip(blocks * LANES) {
            [*z] = Samples::of_cell(&rows, x * cell, offsets).reduce();
        }
    }
}

/// Number of cells reduced together as a block.
const LANES: usize = 4;
/// Side of cells reduced in blocks, px; other cells are reduced one by one.
const BLOCK_CELL: usize = 8;

type BlockRow = [[f32; BLOCK_CELL]; LANES];

/// The 16 samples of each of `L` cells; `f32::MAX` stands for invalid depths.
struct Samples<const L: usize>([[f32; L]; 16]);

impl Samples<LANES> {
    #[inline(always)]
    fn of_block(rows: [&BlockRow; 4]) -> Self {
        let sample = |k: usize| std::array::from_fn(|l| or_max(rows[k / 4][l][2 * (k % 4) + 1]));
        Self(std::array::from_fn(sample))
    }
}

impl Samples<1> {
    /// From four rows of the image, at `offsets` from column `x`.
    #[inline(always)]
    fn of_cell(rows: &[&[f32]; 4], x: usize, offsets: [usize; 4]) -> Self {
        let sample = |k: usize| [or_max(rows[k / 4][x + offsets[k % 4]])];
        Self(std::array::from_fn(sample))
    }
}

/// Replaces invalid depths by `f32::MAX`. Branch-free, since holes are unpredictable.
#[inline(always)]
fn or_max(z: f32) -> f32 {
    if (z > 0.0) & (z < f32::INFINITY) {
        z
    } else {
        f32::MAX
    }
}

impl<const L: usize> Samples<L> {
    #[inline(always)]
    fn reduce(&self) -> [f32; L] {
        let (mut near, mut far) = ([f32::MAX; L], [0.0_f32; L]);
        let (mut sum, mut count) = ([0.0_f32; L], [0.0_f32; L]);
        for z in &self.0 {
            let held: [f32; L] = from_fn(|l| if z[l] < f32::MAX { z[l] } else { 0.0 });
            let one: [f32; L] = from_fn(|l| if z[l] < f32::MAX { 1.0 } else { 0.0 });
            near = from_fn(|l| if z[l] < near[l] { z[l] } else { near[l] });
            far = from_fn(|l| if held[l] > far[l] { held[l] } else { far[l] });
            sum = from_fn(|l| sum[l] + held[l]);
            count = from_fn(|l| count[l] + one[l]);
        }
        let mean: [f32; L] = from_fn(|l| sum[l] / count[l]);
        from_fn(|l| match count[l] >= 4.0 {
            true if far[l] - near[l] <= ONE_SURFACE * near[l] => mean[l],
            true => {
                let mut cell = self.0.map(|sample| sample[l]);
                sort(&mut cell);
                cell[count[l] as usize / 2]
            }
            false => 0.0,
        })
    }
}

/// Sorts 16 numbers by Batcher's merges of odd and even places (Knuth, The Art of Computer Programming 3, 5.2.2,
/// algorithm M): 63 branch-free comparisons.
#[inline]
fn sort(v: &mut [f32; 16]) {
    const NETWORK: [(usize, usize); 63] = network();
    for (i, j) in NETWORK {
        let (a, b) = (v[i], v[j]);
        v[i] = if b < a { b } else { a };
        v[j] = if a < b { b } else { a };
    }
}

/// The comparisons of [`sort`].
const fn network() -> [(usize, usize); 63] {
    let mut pairs = [(0, 0); 63];
    let mut n = 0;
    let mut p = 8;
    while p > 0 {
        let (mut q, mut r, mut d) = (8, 0, p);
        loop {
            let mut i = 0;
            while i + d < 16 {
                if i & p == r {
                    pairs[n] = (i, i + d);
                    n += 1;
                }
                i += 1;
            }
            if q == p {
                break;
            }
            (d, q, r) = (q - p, q / 2, p);
        }
        p /= 2;
    }
    assert!(n == 63);
    pairs
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(f: impl Fn(usize, usize) -> f32) -> DepthImage {
        let data = (0..24).flat_map(|y| (0..32).map(move |x| (x, y)));
        DepthImage::from_vec(32, 24, data.map(|(x, y)| f(x, y)).collect()).unwrap()
    }

    /// A network that sorts all arrays of zeros and ones sorts all arrays (Knuth, 5.3.4).
    #[test]
    fn sorting_network_sorts_sixteen_values() {
        for bits in 0..1_u32 << 16 {
            let mut v: [f32; 16] = std::array::from_fn(|i| (bits >> i & 1) as f32);
            sort(&mut v);
            assert!(v.is_sorted(), "{bits}: {v:?}");
            assert_eq!(v.iter().sum::<f32>() as u32, bits.count_ones());
        }
    }

    fn by_definition(depth: &DepthImage, cell: usize, x: usize, y: usize) -> f32 {
        let at = |i: usize| (2 * i + 1) * cell / 8;
        let sample = |k: usize| {
            let (row, column) = (y * cell + at(k / 4), x * cell + at(k % 4));
            depth.data()[row * depth.width() + column]
        };
        let mut valid: Vec<f32> = (0..16).map(sample).collect();
        valid.retain(|z| *z > 0.0 && *z < f32::INFINITY);
        if valid.len() < 4 {
            return 0.0;
        }
        let mean = valid.iter().sum::<f32>() / valid.len() as f32;
        valid.sort_by(f32::total_cmp);
        let (near, far) = (valid[0], valid[valid.len() - 1]);
        if far - near <= ONE_SURFACE * near {
            mean
        } else {
            valid[valid.len() / 2]
        }
    }

    #[test]
    fn cells_match_the_definition_bit_for_bit() {
        let mut x = 7_u64;
        let mut next = move || {
            x = x.wrapping_mul(6_364_136_223_846_793_005).wrapping_add(1);
            (x >> 40) as f32 / (1 << 24) as f32
        };
        for (width, height) in [(32, 24), (75, 33), (130, 17), (9, 9)] {
            let data = (0..width * height).map(|i| match next() {
                hole if hole < 0.1 => [0.0, f32::NAN, f32::INFINITY, -1.0][i % 4],
                // Blocks of one surface, with steps between them.
                _ => [1.0, 1.3, 2.0, 4.0][i % width / 11 % 4] * (1.0 + 0.012 * next()),
            });
            let image = DepthImage::from_vec(width, height, data.collect()).unwrap();
            for cell in [4, 5, 8, 12] {
                let coarse = CoarseDepth::new(&image, cell);
                for (i, z) in coarse.data().iter().enumerate() {
                    let (x, y) = (i % coarse.width(), i / coarse.width());
                    let expected = by_definition(&image, cell, x, y);
                    assert_eq!(z.to_bits(), expected.to_bits(), "{cell}: {x} {y}");
                }
            }
        }
    }

    #[test]
    fn cell_depth_takes_one_side_of_an_edge() {
        let coarse = CoarseDepth::new(&image(|x, _| if x < 11 { 1.0 } else { 3.0 }), 8);
        assert_eq!((coarse.width(), coarse.height()), (4, 3));
        assert!(coarse.data().iter().all(|z| *z == 1.0 || *z == 3.0));
        assert_eq!(coarse.get(0, 0), Some(1.0));
        assert_eq!(coarse.get(3, 2), Some(3.0));
        assert_eq!(coarse.get(4, 0), None);
    }

    #[test]
    fn missing_and_invalid_depths_are_ignored() {
        let coarse = CoarseDepth::new(
            &image(|x, y| match (x, y % 4) {
                (0..8, _) => 0.0,
                (_, 0) => f32::NAN,
                (_, 1) => 0.0,
                _ => 2.0,
            }),
            8,
        );
        assert_eq!(coarse.get(0, 1), None);
        assert_eq!(coarse.get(2, 1), Some(2.0));
    }

    #[test]
    fn cell_centre_is_between_its_pixels() {
        let coarse = CoarseDepth::new(&image(|_, _| 1.0), 8);
        // Pixels 0 to 7, 24 to 31 and 16 to 23.
        assert_eq!(coarse.centre(0, 0), [3.5, 3.5]);
        assert_eq!(coarse.centre(3, 2), [27.5, 19.5]);
    }
}
