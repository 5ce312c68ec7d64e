//! Heads: each recognises its outputs and decodes boxes from them.

mod anchors;
mod detr;
mod distribution;
mod end_to_end;
mod gate;
mod rows;
mod suppress;

use super::card::{Head, ModelCard};
use super::runtime::Tensor;
use super::size::Size;
pub(super) use detr::misplaced;
pub(super) use rows::{boxes_lie_in_their_cells, boxes_not_in_pixels};
use stillpoint_detection::BoundingBox;
pub(super) use suppress::{sorted, suppress};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Candidate {
    pub(super) class: usize,
    pub(super) score: f32,
    /// In px of the input from its upper left corner.
    pub(super) bounds: BoundingBox,
}

impl Candidate {
    /// `None` for a box without area, or with infinite or NaN values.
    fn new(class: usize, score: f32, bounds: BoundingBox) -> Option<Self> {
        // Neither comparison holds for a NaN.
        let sane = bounds.x0 < bounds.x1 && bounds.y0 < bounds.y1 && bounds.area().is_finite();
        (sane && score.is_finite()).then_some(Self {
            class,
            score: score.min(1.0),
            bounds,
        })
    }

    /// From a centre and half of the size.
    fn around(class: usize, score: f32, centre: [f64; 2], half: [f64; 2]) -> Option<Self> {
        let bounds = BoundingBox {
            x0: centre[0] - half[0],
            y0: centre[1] - half[1],
            x1: centre[0] + half[0],
            y1: centre[1] + half[1],
        };
        Self::new(class, score, bounds)
    }
}

/// Error: outputs do not match the head.
#[derive(Clone, Debug, PartialEq, Eq)]
pub(super) struct Mismatch {
    pub(super) expected: String,
    pub(super) found: String,
}

#[derive(Clone, Copy)]
pub(super) struct Reading<'a> {
    pub(super) card: &'a ModelCard,
    pub(super) size: Size,
    pub(super) threshold: f32,
}

impl Reading<'_> {
    /// The boxes whose score reaches the threshold, in the outputs' order, before suppression.
    ///
    /// # Errors
    /// [`Mismatch`] for outputs of other shapes than the head's.
    pub(super) fn decode(&self, outputs: &[Tensor]) -> Result<Vec<Candidate>, Mismatch> {
        match self.card.head {
            Head::Yolox => rows::decode_raw(self, outputs),
            Head::YoloGrid => rows::decode_grid(self, outputs),
            Head::YoloAnchors => anchors::decode(self, outputs),
            Head::Distribution => distribution::decode(self, outputs),
            Head::EndToEnd => end_to_end::decode(self, outputs),
            Head::Detr => detr::decode(self, outputs),
        }
    }

    /// Range of all values that are scores according to the card; `None` if there are none, as in a head that outputs only its best boxes.
    /// The outputs have been decoded before.
    pub(super) fn score_range(&self, outputs: &[Tensor]) -> Option<(f32, f32)> {
        let classes = self.card.class_count();
        let mut range = (f32::INFINITY, f32::NEG_INFINITY);
        let mut take = |value: f32| range = (range.0.min(value), range.1.max(value));
        match self.card.head {
            Head::Yolox | Head::YoloGrid => rows::scores(classes, outputs).for_each(&mut take),
            Head::YoloAnchors => anchors::each_score(self, outputs, &mut take),
            Head::Distribution => distribution::each_score(self, outputs, &mut take),
            Head::Detr => detr::each_score(self, outputs, &mut take),
            Head::EndToEnd => return None,
        }
        (range.0 <= range.1).then_some(range)
    }

    /// The maps of cells, from fine to coarse. The last cells may extend beyond the input.
    fn levels(&self) -> impl Iterator<Item = Level> {
        let Size { width, height } = self.size;
        self.card.output.strides.iter().map(move |&stride| Level {
            stride,
            columns: width.div_ceil(stride),
            rows: height.div_ceil(stride),
        })
    }

    fn cells(&self) -> usize {
        self.levels().map(|l| l.cells()).sum()
    }
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
struct Level {
    stride: usize,
    columns: usize,
    rows: usize,
}

impl Level {
    fn cells(self) -> usize {
        self.columns * self.rows
    }
}

/// The outputs that a head expects, in one line.
pub(super) fn expectation(head: Head) -> &'static str {
    match head {
        Head::Yolox => {
            "one output [1, cells, 5 + classes]: x, y, width, height as offsets and logarithms, objectness, classes"
        }
        Head::YoloAnchors => {
            "per stride a raw map [1, anchors (5 + classes), h, w] or [1, anchors, h, w, 5 + classes]"
        }
        Head::YoloGrid => {
            "one output [1, anchors x cells, 5 + classes]: x, y, width, height in px, objectness, classes"
        }
        Head::Distribution => {
            "per stride scores [1, cells, classes] and sides [1, cells, 4 bins], or one output [1, cells, classes + 4 bins]"
        }
        Head::EndToEnd => {
            "one output [boxes, 7] or [1, boxes, 6], whose columns the card names, or four: count, boxes, scores, classes"
        }
        Head::Detr => {
            "scores [1, queries, classes] and boxes [1, queries, 4] in shares, or labels, boxes and scores (D-FINE)"
        }
    }
}

fn shapes(outputs: &[Tensor]) -> String {
    const SHOWN: usize = 8;
    let shown: Vec<String> = outputs
        .iter()
        .take(SHOWN)
        .map(|t| format!("{:?}", t.shape))
        .collect();
    let more = outputs.len().saturating_sub(SHOWN);
    match (shown.is_empty(), more) {
        (true, _) => "no output".to_owned(),
        (_, 0) => shown.join(", "),
        _ => format!("{} and {more} more", shown.join(", ")),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    pub(super) fn tensor(shape: &[usize]) -> Tensor {
        Tensor {
            name: String::new(),
            data: vec![0.0; shape.iter().product()],
            shape: shape.to_vec(),
        }
    }

    pub(super) fn reading(
        card: &ModelCard,
        width: usize,
        height: usize,
        threshold: f32,
    ) -> Reading<'_> {
        Reading {
            card,
            size: Size { width, height },
            threshold,
        }
    }

    pub(super) fn noise(tensor: &mut Tensor, seed: u64) {
        let mut state = seed;
        for value in &mut tensor.data {
            state = state
                .wrapping_mul(6_364_136_223_846_793_005)
                .wrapping_add(1_442_695_040_888_963_407);
            *value = (state >> 40) as f32 / 16_777_216.0 * 8.0 - 4.0;
        }
    }

    /// Decoding any values gives finite boxes.
    #[test]
    fn malicious_values_give_finite_boxes_or_none() {
        let shapes: [(Head, Vec<Vec<usize>>); 7] = [
            (Head::Yolox, vec![vec![1, 21, 85]]),
            (Head::YoloGrid, vec![vec![1, 63, 85]]),
            (
                Head::YoloAnchors,
                vec![vec![1, 255, 4, 4], vec![1, 255, 2, 2], vec![1, 255, 1, 1]],
            ),
            (Head::Distribution, vec![vec![1, 22, 112]]),
            (Head::EndToEnd, vec![vec![9, 7]]),
            (Head::Detr, vec![vec![1, 9, 80], vec![1, 9, 4]]),
            (Head::Detr, vec![vec![1, 9], vec![1, 9, 4], vec![1, 9]]),
        ];
        let malicious = [
            f32::NAN,
            f32::INFINITY,
            f32::NEG_INFINITY,
            f32::MAX,
            f32::MIN,
            1e9,
            -1.0,
            0.5,
        ];
        for (head, shapes) in shapes {
            let card = ModelCard::new(head);
            let reading = reading(&card, 32, 32, 0.25);
            let mut sane = 0;
            // Values below the limit become malicious: most of -4 to 4, some, none.
            for (seed, limit) in (0..50).flat_map(|seed| [(seed, 3.0), (seed, -3.5), (seed, -5.0)])
            {
                let mut outputs: Vec<Tensor> = shapes.iter().map(|s| tensor(s)).collect();
                for (i, output) in outputs.iter_mut().enumerate() {
                    noise(output, seed + 1000 * i as u64);
                    for value in &mut output.data {
                        if *value < limit {
                            *value = malicious[(value.to_bits() >> 8) as usize % malicious.len()];
                        }
                    }
                    if head == Head::EndToEnd {
                        // All in the first image.
                        output.data.iter_mut().step_by(7).for_each(|v| *v = 0.0);
                    }
                }
                let boxes = reading.decode(&outputs).unwrap();
                sane += if limit < -4.0 { boxes.len() } else { 0 };
                for found in boxes {
                    let BoundingBox { x0, y0, x1, y1 } = found.bounds;
                    assert!(
                        x0 < x1 && y0 < y1 && found.bounds.area().is_finite(),
                        "{found:?}"
                    );
                    assert!((0.25..=1.0).contains(&found.score), "{found:?}");
                    assert!(found.class < 80);
                }
            }
            assert!(sane > 10, "{head} found {sane} boxes");
        }
    }

    #[test]
    fn messages_list_some_shapes_and_count_the_rest() {
        assert_eq!(shapes(&[]), "no output");
        let outputs = vec![tensor(&[1, 2]); 10];
        assert!(shapes(&outputs).ends_with("[1, 2] and 2 more"));
    }
}
