//! Evidence in two or three images that time has passed: change, noise and content.

use crate::{DepthImage, GrayImage, RgbdFrame};

/// Side of the blocks whose means are compared, px, and stride within them and between rows tested for noise: 16 values
/// per block average noise to a quarter.
const BLOCK: usize = 8;
const STRIDE: usize = 2;
/// Minimum change of a block's grey level relative to the mean change, grey levels: twice the residual of noise of 8
/// levels, which is that of dim rooms.
const CHANGED: f32 = 4.0;
/// Minimum share of changed blocks when the camera, or a person at the far end of a room, moved.
const MOVED: f32 = 0.01;
/// Minimum ratio of the last depth step to the one before, during which the colour image still changed, as a share, to
/// infer a moving camera: a hand does not stop between two images.
const GOES_ON_AS_BEFORE: f32 = 0.7;
/// Tolerances of noise-free depth: the middle of three neighbours is where the others predict it, within its rounding
/// (at most this, m) and this share of it.
const ROUNDING: f32 = 0.001;
const SMOOTH: f32 = 3e-4;
/// Minimum share of rough pixels for noise: rendered depth has up to 0.15, structured light, stereo and time of flight
/// 0.35 and more.
const NOISY: f32 = 0.25;
/// Minimum change of depth between neighbouring pixels at an edge, as a share, and pixels per edge pixel required.
const EDGE: f32 = 0.1;
const EDGES: usize = 2000;
/// Minimum content of an image, as the inverse share of pixels that differ from the simplest image (one grey level, no
/// depth): a covered lens repeats itself legitimately.
const CONTENT: usize = 100;

pub(super) fn has_depth(depth: &DepthImage) -> bool {
    let data = depth.data();
    data.iter().filter(|z| **z > 0.0).count() * CONTENT > data.len()
}

/// Whether enough pixels differ from the first one.
pub(super) fn has_contrast(gray: &GrayImage) -> bool {
    let data = gray.data();
    let first = data.first().copied().unwrap_or_default();
    data.iter().filter(|v| **v != first).count() * CONTENT > data.len()
}

/// Whether something moved between two images, regardless of brightness changes.
pub(super) fn has_changed(a: &GrayImage, b: &GrayImage) -> bool {
    let means = |image: &GrayImage| blocks(image.width(), image.data(), |v| Some(f32::from(*v)));
    let differences = means(a).into_iter().zip(means(b));
    let differences: Vec<f32> = differences.filter_map(|(a, b)| Some(b? - a?)).collect();
    let count = differences.len().max(1) as f32;
    let mean = differences.iter().sum::<f32>() / count;
    let changed = differences.iter().filter(|d| (*d - mean).abs() > CHANGED);
    changed.count() as f32 > MOVED * count
}

/// Whether depth continues to change like it did when the colour image still changed.
pub(super) fn goes_on_as_before(earlier: &RgbdFrame, before: &RgbdFrame, last: &RgbdFrame) -> bool {
    if !has_changed(&earlier.gray, &before.gray) {
        return false;
    }
    let [_, step] = steps([&earlier.depth, &before.depth, &last.depth]);
    let [_, step_before] = steps([&last.depth, &earlier.depth, &before.depth]);
    step > GOES_ON_AS_BEFORE * step_before
}

/// Relative change of depth from the first to the last image, and from the previous to the last, summed over all
/// blocks.
pub(super) fn steps(images: [&DepthImage; 3]) -> [f32; 2] {
    let measured = |z: &f32| (*z > 0.0).then_some(*z);
    let [first, before, last] = images.map(|i| blocks(i.width(), i.data(), measured));
    let (mut all, mut step) = (0.0, 0.0);
    for ((first, before), last) in first.into_iter().zip(before).zip(last) {
        if let (Some(first), Some(before), Some(last)) = (first, before, last) {
            all += (last - first).abs() / last;
            step += (last - before).abs() / last;
        }
    }
    [all, step]
}

/// Whether the depth image has edges: a camera moving along a plane measures the same.
pub(super) fn has_edges(depth: &DepthImage) -> bool {
    let pairs = depth.data().windows(2).step_by(STRIDE);
    let ends = pairs.filter(|w| w[0] > 0.0 && w[1] > 0.0 && (w[0] - w[1]).abs() > EDGE * w[0]);
    ends.count() * EDGES > depth.data().len()
}

/// Whether depth is rougher than surfaces are.
pub(super) fn has_noise(depth: &DepthImage) -> bool {
    let rows = || depth.data().chunks(depth.width().max(1)).step_by(STRIDE);
    let near = |a: f32, c: f32| a > 0.0 && c > 0.0 && (a - c).abs() < 0.05 * a;
    let differences = rows().flat_map(|row| row.windows(2).map(|w| (w[0] - w[1]).abs()));
    let step = differences.filter(|d| *d > 0.0).fold(ROUNDING, f32::min);
    let (mut rough, mut count) = (0_u32, 0_u32);
    for w in rows().flat_map(|row| row.windows(3)) {
        let [a, b, c] = [w[0], w[1], w[2]];
        if b <= 0.0 || !near(a, c) {
            continue;
        }
        // On a plane the inverse depth is linear.
        let off = (1.0 / a - 2.0 / b + 1.0 / c).abs() * b * b;
        count += 1;
        rough += u32::from(off > (1.1 * step).max(SMOOTH * b));
    }
    rough as f32 > NOISY * count.max(1) as f32
}

/// Means of blocks over the valid values; `None` for blocks without any.
fn blocks<T>(width: usize, data: &[T], value: impl Fn(&T) -> Option<f32>) -> Vec<Option<f32>> {
    let columns = width.div_ceil(BLOCK);
    let mut means = Vec::new();
    for rows in data.chunks((BLOCK * width).max(1)) {
        let mut sums = vec![(0.0_f32, 0_u32); columns];
        for row in rows.chunks(width.max(1)).step_by(STRIDE) {
            for (cell, sum) in row.chunks(BLOCK).zip(&mut sums) {
                for v in cell.iter().step_by(STRIDE).filter_map(&value) {
                    *sum = (sum.0 + v, sum.1 + 1);
                }
            }
        }
        means.extend(
            sums.iter()
                .map(|(sum, n)| (*n > 0).then(|| sum / *n as f32)),
        );
    }
    means
}
