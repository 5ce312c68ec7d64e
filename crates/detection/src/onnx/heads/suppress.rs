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

#[cfg(test)]
mod tests {
    use super::*;
    use crate::BoundingBox;

    fn candidate(class: usize, score: f32, x0: f64) -> Candidate {
        let bounds = BoundingBox {
            x0,
            y0: 0.0,
            x1: x0 + 10.0,
            y1: 10.0,
        };
        Candidate {
            class,
            score,
            bounds,
        }
    }

    #[test]
    fn only_the_best_of_a_class_stays_at_a_place() {
        let boxes = vec![
            candidate(0, 0.5, 1.0),
            candidate(0, 0.9, 0.0),
            candidate(1, 0.6, 0.0),
            candidate(0, 0.4, 8.0),
        ];
        let kept = suppress(boxes.clone(), 0.45);
        assert_eq!(kept, [boxes[1], boxes[2], boxes[3]]);
        // What a suppressed box would have hidden stays.
        let chain = vec![
            candidate(0, 0.9, 0.0),
            candidate(0, 0.8, 3.0),
            candidate(0, 0.7, 6.0),
        ];
        assert_eq!(suppress(chain.clone(), 0.45), [chain[0], chain[2]]);
    }

    #[test]
    fn the_best_thousand_are_compared() {
        let boxes: Vec<Candidate> = (0..30_000)
            .map(|i| candidate(0, 0.3 + i as f32 * 1e-5, 20.0 * i as f64))
            .collect();
        let kept = suppress(boxes.clone(), 0.45);
        assert_eq!(kept.len(), MOST);
        assert_eq!(kept[0], boxes[29_999]);
    }
}
