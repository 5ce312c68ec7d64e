//! Non-maximum suppression.

use super::Candidate;
use std::collections::BTreeMap;
use stillpoint_detection::BoundingBox;

/// Maximum number of boxes that are kept and compared: a network with a confident box in every cell must not take seconds.
const MOST: usize = 1000;

/// The best boxes, best first; equal scores keep their order.
pub(in super::super) fn sorted(boxes: &[Candidate]) -> Vec<Candidate> {
    let mut order: Vec<usize> = (0..boxes.len()).collect();
    let better = |a: &usize, b: &usize| boxes[*b].score.total_cmp(&boxes[*a].score).then(a.cmp(b));
    if order.len() > MOST {
        order.select_nth_unstable_by(MOST, better);
        order.truncate(MOST);
    }
    order.sort_unstable_by(better);
    order.into_iter().map(|i| boxes[i]).collect()
}

/// Non-maximum suppression per class: of boxes that overlap by more than `iou` the best stays. Returns them best first; equal scores keep
/// their order.
pub(in super::super) fn suppress(boxes: &[Candidate], iou: f32) -> Vec<Candidate> {
    let mut of_class: BTreeMap<usize, Vec<BoundingBox>> = BTreeMap::new();
    let mut boxes = sorted(boxes);
    boxes.retain(|candidate| {
        let better = of_class.entry(candidate.class).or_default();
        let hidden = better
            .iter()
            .any(|b| b.iou(&candidate.bounds) > f64::from(iou));
        if !hidden {
            better.push(candidate.bounds);
        }
        !hidden
    });
    boxes
}

#[cfg(test)]
mod tests {
    use super::*;

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
    fn best_box_per_class_and_place_is_kept() {
        let boxes = vec![
            candidate(0, 0.5, 1.0),
            candidate(0, 0.9, 0.0),
            candidate(1, 0.6, 0.0),
            candidate(0, 0.4, 8.0),
        ];
        let kept = suppress(&boxes, 0.45);
        assert_eq!(kept, [boxes[1], boxes[2], boxes[3]]);
        // Suppressed boxes do not suppress others.
        let chain = vec![
            candidate(0, 0.9, 0.0),
            candidate(0, 0.8, 3.0),
            candidate(0, 0.7, 6.0),
        ];
        assert_eq!(suppress(&chain, 0.45), [chain[0], chain[2]]);
    }

    #[test]
    fn only_the_best_thousand_boxes_are_compared() {
        let boxes: Vec<Candidate> = (0..30_000)
            .map(|i| candidate(0, 0.3 + i as f32 * 1e-5, 20.0 * i as f64))
            .collect();
        let kept = suppress(&boxes, 0.45);
        assert_eq!(kept.len(), MOST);
        assert_eq!(kept[0], boxes[29_999]);
    }
}
