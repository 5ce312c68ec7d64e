//! Which pixels move.

use stillpoint_imaging::RgbdFrame;
use stillpoint_slam::Segments;

/// The pixels of what moves, with all cells around: where a region ends, a camera mixes what moves with what is behind it.
pub(crate) fn spread(segments: &Segments, frame: &RgbdFrame, moving: &mut Vec<bool>) {
    moving.clear();
    let (w, h, side) = (segments.width, segments.height, segments.cell_px);
    if side == 0 || w == 0 || h == 0 || segments.labels.iter().all(|l| *l == 0) {
        return;
    }
    let labelled = |x: usize, y: usize| segments.labels.get(y * w + x).is_some_and(|l| *l > 0);
    let around = |v: usize, end: usize| v.saturating_sub(1)..(v + 2).min(end);
    let near: Vec<bool> = (0..w * h)
        .map(|i| around(i / w, h).any(|y| around(i % w, w).any(|x| labelled(x, y))))
        .collect();
    let (width, height) = (frame.depth.width(), frame.depth.height());
    // What is left beyond the last whole cell belongs to it.
    moving.extend((0..width * height).map(|i| {
        let (x, y) = ((i % width / side).min(w - 1), (i / width / side).min(h - 1));
        near[y * w + x]
    }));
}
