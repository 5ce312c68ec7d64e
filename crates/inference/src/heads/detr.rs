//! Real-time forms of DETR (Carion et al., "End-to-End Object Detection with Transformers", 2020): RT-DETR, D-FINE, DEIM and RF-DETR. Each
//! of a fixed number of queries has one box and a score per class; nothing is suppressed.
//!
//! Exporters write the scores of all classes beside boxes as fractions of the input, or only the best pairs of query and class, as labels,
//! boxes and scores. Outputs are identified by name, or else by shape.

use super::gate::Gate;
use super::{Candidate, Mismatch, Reading, Tensor, shapes};
use stillpoint_detection::BoundingBox;

/// Exporters' names of the boxes: D-FINE's, `transformers`' and RF-DETR's.
const BOXES: [&str; 3] = ["boxes", "pred_boxes", "dets"];

#[derive(Clone, Copy)]
enum Outputs<'a> {
    /// A score per query and class, and boxes as centre and size in fractions of the input.
    All { scores: &'a [f32], boxes: &'a [f32] },
    /// The best ones: class, corners in px of the input, and score.
    Best {
        labels: &'a [f32],
        boxes: &'a [f32],
        scores: &'a [f32],
    },
}

/// The boxes whose score reaches the threshold: of all pairs of query and class, the best, at most the number of queries.
pub(super) fn decode(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Result<Vec<Candidate>, Mismatch> {
    match sort(reading, outputs)? {
        Outputs::All { scores, boxes } => Ok(all(reading, scores, boxes)),
        Outputs::Best {
            labels,
            boxes,
            scores,
        } => Ok(best(reading, labels, boxes, scores)),
    }
}

/// All scores as output by the network; none if it outputs only the best ones.
pub(super) fn each_score(reading: &Reading<'_>, outputs: &[Tensor], take: &mut dyn FnMut(f32)) {
    if let Ok(Outputs::All { scores, .. }) = sort(reading, outputs) {
        scores.iter().for_each(|&score| take(score));
    }
}

/// Expected unit and found values, if boxes of a blank image are in the wrong unit.
pub(in super::super) fn misplaced(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Option<(&'static str, String)> {
    let (in_shares, boxes) = match sort(reading, outputs).ok()? {
        Outputs::All { boxes, .. } => (true, boxes),
        Outputs::Best { boxes, .. } => (false, boxes),
    };
    let finite = boxes.iter().filter(|v| v.is_finite());
    let reach = finite.fold(0.0_f32, |most, v| most.max(v.abs()));
    // RF-DETR's may exceed the image slightly, and never are all boxes within two px of the corner.
    let found = format!("values up to {reach:.2} for {} px", reading.size);
    match (in_shares, reach > 2.0) {
        (true, true) => Some(("boxes in shares of the input", found)),
        (false, false) if reach > 0.0 => Some(("boxes in px of the input", found)),
        _ => None,
    }
}

fn all(reading: &Reading<'_>, scores: &[f32], boxes: &[f32]) -> Vec<Candidate> {
    let classes = reading.card.class_count();
    let gate = Gate::new(reading.threshold, reading.card.output.sigmoid);
    let (boxes, _) = boxes.as_chunks::<4>();
    let size = [reading.size.width as f64, reading.size.height as f64];
    let mut found = Vec::new();
    for (row, sides) in scores.chunks_exact(classes).zip(boxes) {
        if !gate.any(row) {
            continue;
        }
        let [x, y, width, height] = sides.map(f64::from);
        let centre = [x * size[0], y * size[1]];
        let half = [width * size[0] / 2.0, height * size[1] / 2.0];
        for (class, &value) in row.iter().enumerate().filter(|(_, v)| gate.may_pass(**v)) {
            let score = gate.score(value);
            if gate.passes(score) {
                found.extend(Candidate::around(class, score, centre, half));
            }
        }
    }
    if found.len() > boxes.len() {
        // Stable: equal scores keep the order of their queries.
        found.sort_by(|a, b| b.score.total_cmp(&a.score));
        found.truncate(boxes.len());
    }
    found
}

fn best(reading: &Reading<'_>, labels: &[f32], boxes: &[f32], scores: &[f32]) -> Vec<Candidate> {
    let classes = reading.card.class_count() as f32;
    let (boxes, _) = boxes.as_chunks::<4>();
    let rows = labels.iter().zip(boxes).zip(scores);
    let found = rows.filter_map(|((&class, &sides), &score)| {
        // No NaN is in the range.
        let known = (-0.5..classes - 0.5).contains(&class) && score >= reading.threshold;
        let [x0, y0, x1, y1] = sides.map(f64::from);
        let bounds = BoundingBox { x0, y0, x1, y1 };
        known.then(|| Candidate::new((class + 0.5) as usize, score, bounds))?
    });
    found.collect()
}

/// The outputs by name, or else by shape.
fn sort<'a>(reading: &Reading<'_>, outputs: &'a [Tensor]) -> Result<Outputs<'a>, Mismatch> {
    let classes = reading.card.class_count();
    let sorted = match outputs {
        [a, b] => pair(a, b).filter(|[scores, _]| scores.shape.last() == Some(&classes)),
        [_, _, _] => return three(outputs).ok_or_else(|| mismatch(classes, outputs)),
        _ => None,
    };
    let Some([scores, boxes]) = sorted else {
        return Err(mismatch(classes, outputs));
    };
    let fits = |queries: usize| has(scores, &[1, queries, classes]) && has(boxes, &[1, queries, 4]);
    match boxes.shape[..] {
        [_, queries, _] if queries > 0 && fits(queries) => Ok(Outputs::All {
            scores: &scores.data,
            boxes: &boxes.data,
        }),
        _ => Err(mismatch(classes, outputs)),
    }
}

/// Scores and boxes of two outputs. With four classes both have the same shape, and only names distinguish them.
fn pair<'a>(a: &'a Tensor, b: &'a Tensor) -> Option<[&'a Tensor; 2]> {
    let named = |t: &Tensor| BOXES.contains(&t.name.as_str());
    let fours = |t: &Tensor| t.shape.last() == Some(&4);
    match (named(a), named(b), fours(a), fours(b)) {
        (false, true, ..) | (false, false, false, true) => Some([a, b]),
        (true, false, ..) | (false, false, true, false) => Some([b, a]),
        _ => None,
    }
}

/// Labels, boxes and scores of three outputs: by all their names, or in this order, in which exporters write them.
fn three(outputs: &[Tensor]) -> Option<Outputs<'_>> {
    let named = |name: &str| outputs.iter().find(|t| t.name == name);
    let by_name = (named("labels"), named("boxes"), named("scores"));
    let (labels, boxes, scores) = match (by_name, outputs) {
        ((Some(labels), Some(boxes), Some(scores)), _) => (labels, boxes, scores),
        ((None, None, None), [labels, boxes, scores]) => (labels, boxes, scores),
        _ => return None,
    };
    let &[_, most, _] = &boxes.shape[..] else {
        return None;
    };
    let fits = has(labels, &[1, most]) && has(boxes, &[1, most, 4]) && has(scores, &[1, most]);
    fits.then_some(Outputs::Best {
        labels: &labels.data,
        boxes: &boxes.data,
        scores: &scores.data,
    })
}

fn has(tensor: &Tensor, shape: &[usize]) -> bool {
    tensor.shape == shape && tensor.data.len() == shape.iter().product::<usize>()
}

fn mismatch(classes: usize, outputs: &[Tensor]) -> Mismatch {
    let names = outputs.iter().map(|t| t.name.as_str());
    let names: Vec<&str> = names.filter(|n| !n.is_empty()).take(3).collect();
    let named = match names[..] {
        [] => String::new(),
        _ => format!(" ({})", names.join(", ")),
    };
    Mismatch {
        expected: format!(
            "scores [1, n, {classes}] and boxes [1, n, 4] (called boxes, pred_boxes or dets where there are 4 classes), or labels [1, n], boxes [1, n, 4], scores [1, n]"
        ),
        found: format!("{}{named}", shapes(outputs)),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{reading, tensor};
    use super::*;
    use crate::card::{Classes, Head, ModelCard};
    use stillpoint_detection::ClassId;

    fn named(name: &str, shape: &[usize], data: &[f32]) -> Tensor {
        Tensor {
            name: name.to_owned(),
            shape: shape.to_vec(),
            data: data.to_vec(),
        }
    }

    fn card(classes: usize) -> ModelCard {
        let mut card = ModelCard::new(Head::Detr);
        card.classes = Classes::Listed(vec![Some(ClassId::PERSON); classes]);
        card
    }

    /// Two queries and three classes. The sigmoid of ln 3 is 3/4, that of 0 is 1/2, that of -ln 3 is 1/4.
    fn two_queries() -> [Tensor; 2] {
        let ln3 = libm::logf(3.0);
        let scores = [ln3, 0.0, -9.0, -9.0, -ln3, 9.0];
        let boxes = [0.5, 0.25, 0.5, 0.25, 0.125, 0.5, 0.25, 1.0];
        [
            named("logits", &[1, 2, 3], &scores),
            named("pred_boxes", &[1, 2, 4], &boxes),
        ]
    }

    #[test]
    fn best_query_class_pairs_become_boxes() {
        let card = card(3);
        let found = reading(&card, 64, 32, 0.3).decode(&two_queries()).unwrap();
        // Three pairs reach the threshold, and one per query remains: 1/2 of the first query's second class is dropped.
        let expected = [
            (2, 0.999_876_6, [0.0, 0.0, 16.0, 32.0]),
            (0, 0.75, [16.0, 4.0, 48.0, 12.0]),
        ];
        assert_eq!(found.len(), expected.len());
        for (found, (class, score, sides)) in found.iter().zip(expected) {
            let b = found.bounds;
            assert_eq!(found.class, class);
            assert!((found.score - score).abs() < 1e-6, "{found:?}");
            assert_eq!([b.x0, b.y0, b.x1, b.y1], sides);
        }
    }

    #[test]
    fn query_may_have_two_classes_and_sigmoid_scores() {
        let mut card = card(3);
        card.output.sigmoid = true;
        let scores = named("logits", &[1, 2, 3], &[0.5, 0.5, 0.0, 0.0, 0.0, 0.1]);
        let [_, boxes] = two_queries();
        let found = reading(&card, 64, 32, 0.3)
            .decode(&[scores, boxes])
            .unwrap();
        let classes: Vec<usize> = found.iter().map(|d| d.class).collect();
        assert_eq!(classes, [0, 1]);
        assert_eq!(found[0].bounds, found[1].bounds);
    }

    #[test]
    fn outputs_are_identified_by_name_or_shape() {
        let three = card(3);
        let three = reading(&three, 64, 32, 0.3);
        let [scores, boxes] = two_queries();
        let expected = three.decode(&[scores.clone(), boxes.clone()]).unwrap();
        for (a, b) in [("labels", "dets"), ("", ""), ("x", "y")] {
            let (mut scores, mut boxes) = (scores.clone(), boxes.clone());
            (scores.name, boxes.name) = (a.to_owned(), b.to_owned());
            for outputs in [[scores.clone(), boxes.clone()], [boxes, scores]] {
                assert_eq!(three.decode(&outputs).as_ref(), Ok(&expected), "{a} {b}");
            }
        }
        // Four classes: the shapes are ambiguous.
        let four = card(4);
        let four = reading(&four, 64, 32, 0.3);
        let scores = named("labels", &[1, 1, 4], &[-9.0, 9.0, -9.0, -9.0]);
        let boxes = named("dets", &[1, 1, 4], &[0.5, 0.5, 1.0, 1.0]);
        let found = four.decode(&[boxes.clone(), scores.clone()]).unwrap();
        assert_eq!((found.len(), found[0].class), (1, 1));
        let unnamed = [scores, boxes].map(|t| named("", &t.shape, &t.data));
        let refused = four.decode(&unnamed).unwrap_err();
        assert!(
            refused
                .expected
                .contains("called boxes, pred_boxes or dets"),
            "{refused:?}"
        );
    }

    #[test]
    fn labels_boxes_and_scores_outputs_are_decoded() {
        let card = ModelCard::new(Head::Detr);
        let reading = reading(&card, 640, 640, 0.25);
        let labels = named("labels", &[1, 4], &[0.0, 56.0, 80.0, 7.0]);
        let sides = [10.0, 20.0, 30.0, 60.0].repeat(4);
        let boxes = named("boxes", &[1, 4, 4], &sides);
        let scores = named("scores", &[1, 4], &[0.9, 0.25, 0.9, 0.2]);
        let outputs = [labels, boxes, scores];
        let found = reading.decode(&outputs).unwrap();
        let seen: Vec<_> = found.iter().map(|d| (d.class, d.score)).collect();
        assert_eq!(seen, [(0, 0.9), (56, 0.25)]);
        let b = found[1].bounds;
        assert_eq!([b.x0, b.y0, b.x1, b.y1], [10.0, 20.0, 30.0, 60.0]);
        assert_eq!(reading.score_range(&outputs), None);
        let [labels, boxes, scores] = outputs;
        let turned = [scores, labels, boxes];
        assert_eq!(reading.decode(&turned), Ok(found.clone()));
        // Without names the order counts; with some names nothing is recognised.
        let [scores, labels, boxes] = turned;
        let unnamed = [labels, boxes, scores].map(|t| named("", &t.shape, &t.data));
        assert_eq!(reading.decode(&unnamed), Ok(found));
        let mut half = unnamed;
        half[0].name = "scores".to_owned();
        assert!(reading.decode(&half).is_err());
    }

    #[test]
    fn unexpected_outputs_are_refused_with_names_and_shapes() {
        let card = ModelCard::new(Head::Detr);
        let reading = reading(&card, 64, 64, 0.25);
        for shapes in [
            &[&[1, 9, 81][..], &[1, 9, 4]][..],
            &[&[1, 9, 80], &[1, 8, 4]],
            &[&[2, 9, 80], &[2, 9, 4]],
            &[&[1, 9, 80]],
            &[&[1, 0, 80], &[1, 0, 4]],
            &[&[1, 9], &[1, 9, 4], &[1, 8]],
        ] {
            let outputs: Vec<Tensor> = shapes.iter().map(|s| tensor(s)).collect();
            assert!(reading.decode(&outputs).is_err(), "{shapes:?}");
        }
        let outputs = [
            named("logits", &[1, 1, 2], &[0.0; 2]),
            named("pred_boxes", &[1, 1, 4], &[0.0; 4]),
        ];
        let refused = reading.decode(&outputs).unwrap_err();
        assert_eq!(refused.found, "[1, 1, 2], [1, 1, 4] (logits, pred_boxes)");
        assert!(refused.expected.starts_with("scores [1, n, 80] and boxes"));
    }

    #[test]
    fn boxes_in_wrong_units_are_detected() {
        let card = card(3);
        let reading = reading(&card, 64, 32, 0.3);
        let mut outputs = two_queries();
        assert_eq!(misplaced(&reading, &outputs), None);
        outputs[1].data[2] = 33.0;
        let (expected, found) = misplaced(&reading, &outputs).unwrap();
        assert_eq!(expected, "boxes in shares of the input");
        assert_eq!(found, "values up to 33.00 for 64x32 px");
        let mut best = [
            named("labels", &[1, 1], &[0.0]),
            named("boxes", &[1, 1, 4], &[0.1, 0.1, 0.9, 0.8]),
            named("scores", &[1, 1], &[0.5]),
        ];
        let (expected, _) = misplaced(&reading, &best).unwrap();
        assert_eq!(expected, "boxes in px of the input");
        best[1].data[3] = 31.0;
        assert_eq!(misplaced(&reading, &best), None);
    }
}
