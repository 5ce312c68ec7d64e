//! Refines the outline of a rough mask to image edges, and smooths it.
//!
//! First, sides are settled in samples of several pixels ([`settle`]). Then a fast guided filter (He, Sun, Tang: Guided
//! Image Filtering, TPAMI 2013; He, Sun: Fast Guided Filter, 2015) upsamples them: around each sample the mask is
//! fitted as a linear function of brightness, and these functions are averaged. Near an image edge the outline follows
//! it; elsewhere it is the contour of the blurred samples, a smooth curve. Simpler than alternatives (joint bilateral
//! upsampling, graph cuts): box means with constant cost per pixel.

use super::sides::{Sample, settle};
use std::ops::Range;
use stillpoint_imaging::GrayImage;

/// Side of a sample, px: half of a cell (`CELL_PX`).
pub(super) const STEP: usize = 4;
/// Radius of the fitting windows, samples: 20 px in all, so that a surface's edge is within reach of its cells' edge,
/// and little else. Chosen: a cell to each side.
const REACH: usize = 2;
/// Variance of brightness (0 to 1) below which it counts as noise: that of steps of 20 grey levels of 255, (20 / 255)^2
/// / 4, chosen.
const NOISE: f32 = 0.0016;
/// Radius of the final smoothing, px, chosen: objects are not thinner than half of that.
const SMOOTH: usize = 2;

/// A rectangle of the image, in whole samples.
#[derive(Clone, Debug)]
pub(super) struct Window {
    pub(super) columns: Range<usize>,
    pub(super) rows: Range<usize>,
}

impl Window {
    fn width(&self) -> usize {
        self.columns.len()
    }

    /// Columns and rows of samples, including a partial one at the end.
    pub(super) fn samples(&self) -> [usize; 2] {
        [&self.columns, &self.rows].map(|r| r.len().div_ceil(STEP))
    }
}

/// The refined mask of a window, row by row, from its samples `rough`.
pub(super) fn refine(gray: &GrayImage, window: &Window, mut rough: Vec<Sample>) -> Vec<bool> {
    let [w, h] = window.samples();
    let brightness = brightness(gray, window);
    settle(&mut rough, &brightness, w, (STEP * STEP) as f32);
    let mut lines = box_sums(&fit(&brightness, &rough, w), w, REACH);
    for [slope, offset, count] in &mut lines {
        (*slope, *offset) = (*slope / *count, *offset / *count - 0.5);
    }
    let clear = clear(&lines, w);
    let width = window.width();
    let columns: Vec<_> = (0..width).map(|i| between(i, w)).collect();
    let mut line = vec![[0.0; 3]; w];
    let mut answer = vec![0.0; width * window.rows.len()];
    for (j, y) in window.rows.clone().enumerate() {
        let (above, below, share) = between(j, h);
        let [above, below] = [above, below].map(|j| &lines[j * w..][..w]);
        for (line, (above, below)) in line.iter_mut().zip(above.iter().zip(below)) {
            *line = mix(above, below, share);
        }
        let row = gray.row(y)[window.columns.clone()].chunks(STEP);
        let answer = answer[j * width..][..width].chunks_mut(STEP);
        let clear = &clear[j / STEP * w..];
        for (((answer, row), columns), clear) in
            answer.zip(row).zip(columns.chunks(STEP)).zip(clear)
        {
            if let Some(side) = clear {
                answer.fill(*side);
                continue;
            }
            for ((answer, grey), (left, right, across)) in answer.iter_mut().zip(row).zip(columns) {
                let [slope, offset, _] = mix(&line[*left], &line[*right], *across);
                let value = slope * (f32::from(*grey) / 255.0) + offset;
                *answer = value.clamp(-0.5, 0.5);
            }
        }
    }
    smoothed(&answer, width, &clear, w)
}

/// Samples around which all fits agree regardless of brightness: 0.5 if inside, -0.5 if outside.
fn clear(lines: &[[f32; 3]], width: usize) -> Vec<Option<f32>> {
    let side = |[slope, offset, _]: &[f32; 3]| {
        let sure = slope.abs() < 0.01 && offset.abs() > 0.49;
        [if sure { offset.signum() } else { 0.0 }]
    };
    let sides: Vec<[f32; 1]> = lines.iter().map(side).collect();
    let alone = vec![[1.0]; lines.len()];
    let sums = box_sums(&sides, width, 1)
        .into_iter()
        .zip(box_sums(&alone, width, 1));
    sums.map(|([sum], [all])| (sum.abs() >= all).then(|| 0.5 * sum.signum()))
        .collect()
}

/// Whether the mean of the values around each pixel is positive; samples that are clear keep their side.
fn smoothed(answer: &[f32], width: usize, clear: &[Option<f32>], samples: usize) -> Vec<bool> {
    let height = answer.len() / width.max(1);
    let range = |v: usize, end: usize| v.saturating_sub(SMOOTH)..(v + SMOOTH + 1).min(end);
    let mut inside = vec![false; answer.len()];
    // Column sums are shared by the pixels of a row; padding is zero.
    let mut sums = vec![0.0; width + 2 * SMOOTH];
    for (y, inside) in inside.chunks_exact_mut(width.max(1)).enumerate() {
        let clear = &clear[y / STEP * samples..][..samples];
        if clear.iter().any(Option::is_none) {
            sums.fill(0.0);
            for row in range(y, height).map(|y| &answer[y * width..][..width]) {
                let sums = sums[SMOOTH..].iter_mut().zip(row);
                sums.for_each(|(sum, a)| *sum += a);
            }
        }
        for ((i, inside), clear) in inside.chunks_mut(STEP).enumerate().zip(clear) {
            if let Some(side) = clear {
                inside.fill(*side > 0.0);
                continue;
            }
            let near = sums[i * STEP..].windows(2 * SMOOTH + 1);
            for (inside, near) in inside.iter_mut().zip(near) {
                *inside = near.iter().sum::<f32>() > 0.0;
            }
        }
    }
    inside
}

fn brightness(gray: &GrayImage, window: &Window) -> Vec<f32> {
    let [w, h] = window.samples();
    let mut means = Vec::with_capacity(w * h);
    let mut columns = vec![0_u16; window.width()];
    let rows: Vec<usize> = window.rows.clone().collect();
    for rows in rows.chunks(STEP) {
        columns.fill(0);
        for y in rows {
            let row = &gray.row(*y)[window.columns.clone()];
            let columns = columns.iter_mut().zip(row);
            columns.for_each(|(sum, grey)| *sum += u16::from(*grey));
        }
        means.extend(columns.chunks(STEP).map(|columns| {
            let sum: u16 = columns.iter().sum();
            f32::from(sum) / (255 * rows.len() * columns.len()) as f32
        }));
    }
    means
}

/// The linear fit of each sample: slope, offset, and 1 for counting in sums.
fn fit(brightness: &[f32], rough: &[Sample], width: usize) -> Vec<[f32; 3]> {
    let moments = brightness.iter().zip(rough).map(|(grey, s)| {
        let weighed = s.weight * grey;
        [s.weight, weighed, s.inside, weighed * grey, s.inside * grey]
    });
    let sums = box_sums(&moments.collect::<Vec<_>>(), width, REACH);
    let line = |[weight, grey, inside, square, product]: [f32; 5]| {
        let [grey, inside, square, product] =
            [grey, inside, square, product].map(|sum| sum / weight);
        let slope = (product - grey * inside) / ((square - grey * grey).max(0.0) + NOISE);
        [slope, inside - slope * grey, 1.0]
    };
    sums.into_iter().map(line).collect()
}

/// The two samples around a pixel, of `count`, and the weight of the second.
fn between(pixel: usize, count: usize) -> (usize, usize, f32) {
    let place = (pixel as f32 + 0.5) / STEP as f32 - 0.5;
    let first = place.max(0.0) as usize;
    let second = (first + 1).min(count - 1);
    (
        first.min(count - 1),
        second,
        (place - first as f32).max(0.0),
    )
}

fn mix(a: &[f32; 3], b: &[f32; 3], share: f32) -> [f32; 3] {
    std::array::from_fn(|k| a[k] + share * (b[k] - a[k]))
}

/// Sums over the squares of radius `reach` around each value, cut at the borders.
fn box_sums<const N: usize>(values: &[[f32; N]], width: usize, reach: usize) -> Vec<[f32; N]> {
    let rows: Vec<&[[f32; N]]> = values.chunks_exact(width.max(1)).collect();
    let mut columns = vec![[0.0; N]; width];
    let mut sums = Vec::with_capacity(values.len());
    for row in rows.iter().take(reach) {
        add(&mut columns, row, 1.0);
    }
    for y in 0..rows.len() {
        if let Some(next) = rows.get(y + reach) {
            add(&mut columns, next, 1.0);
        }
        if let Some(last) = y.checked_sub(reach + 1) {
            add(&mut columns, rows[last], -1.0);
        }
        let mut sum = [[0.0; N]];
        columns
            .iter()
            .take(reach)
            .for_each(|c| add(&mut sum, &[*c], 1.0));
        for x in 0..width {
            if let Some(next) = columns.get(x + reach) {
                add(&mut sum, &[*next], 1.0);
            }
            if let Some(last) = x.checked_sub(reach + 1) {
                add(&mut sum, &[columns[last]], -1.0);
            }
            sums.push(sum[0]);
        }
    }
    sums
}

#[inline]
fn add<const N: usize>(sums: &mut [[f32; N]], values: &[[f32; N]], times: f32) {
    for (sum, value) in sums.iter_mut().zip(values) {
        for (sum, value) in sum.iter_mut().zip(value) {
            *sum += times * value;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn box_sums_match_direct_sums() {
        let (w, h) = (7, 5);
        let values: Vec<[f32; 1]> = (0..w * h).map(|i| [((i * i) % 11) as f32]).collect();
        for reach in [0, 1, 3, 9] {
            let found = box_sums(&values, w, reach);
            for (i, [sum]) in found.iter().enumerate() {
                let near = |a: usize, b: usize| a.abs_diff(b) <= reach;
                let square = (0..w * h).filter(|j| near(i % w, j % w) && near(i / w, j / w));
                let expected: f32 = square.map(|j| values[j][0]).sum();
                assert!(
                    (sum - expected).abs() < 1e-3,
                    "{reach} {i}: {sum} {expected}"
                );
            }
        }
    }
}
