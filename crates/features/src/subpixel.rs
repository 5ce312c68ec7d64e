//! Position of a corner to a fraction of a pixel.

use stillpoint_imaging::GrayImage;

/// Offset (dx, dy) of the vertex of the parabolas through the scores left and right of, and above and below, a local maximum; within half a pixel.
pub(crate) fn refine(scores: &GrayImage, x: usize, y: usize) -> (f32, f32) {
    let at = |x: usize, y: usize| f32::from(scores.at(x, y));
    let centre = at(x, y);
    (
        vertex(at(x - 1, y), centre, at(x + 1, y)),
        vertex(at(x, y - 1), centre, at(x, y + 1)),
    )
}

fn vertex(before: f32, centre: f32, after: f32) -> f32 {
    let curvature = 2.0 * centre - before - after;
    if curvature > 0.0 {
        (0.5 * (after - before) / curvature).clamp(-0.5, 0.5)
    } else {
        0.0
    }
}
