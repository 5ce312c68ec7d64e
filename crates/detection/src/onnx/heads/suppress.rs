//! Suppression of boxes that say the same.

use super::Candidate;

/// The most boxes that are compared with each other: a network that is sure of a box in every cell must not take seconds.
const MOST: usize = 1000;

/// Sorts boxes best first; equal scores keep their order.
pub(in super::super) fn sorted(mut boxes: Vec<Candidate>) -> Vec<Candidate> {
    boxes.sort_by(|a, b| b.score.total_cmp(&a.score));
    boxes
}

/// Non-maximum suppression per class: of boxes that overlap by more than `iou` the best stays. Returns them best first; equal
/// scores keep their order.
pub(in super::super) fn suppress(boxes: Vec<Candidate>, iou: f32) -> Vec<Candidate> {
    let mut boxes = sorted(boxes);
    boxes.truncate(MOST);
    let mut kept: Vec<Candidate> = Vec::new();
    for candidate in boxes {
        let hides = |better: &Candidate| {
            better.class == candidate.class && better.bounds.iou(&candidate.bounds) > f64::from(iou)
        };
        if !kept.iter().any(hides) {
            kept.push(candidate);
        }
    }
    kept
}
