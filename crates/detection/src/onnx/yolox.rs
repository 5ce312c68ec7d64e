//! The head of YOLOX: what its raw output means (Ge et al., "YOLOX: Exceeding YOLO Series in 2021").

use super::OnnxOptions;
use crate::{BoundingBox, ClassId, Detection};

/// Cells of the three output maps, px of the input.
const STRIDES: [usize; 3] = [8, 16, 32];

/// Columns of the output: x, y, width, height, objectness, and the classes.
pub(super) const COLUMNS: usize = 5 + ClassId::COUNT;

/// Number of rows that the output has for an input of this size, px: one per cell.
pub(super) fn rows(width: usize, height: usize) -> usize {
    STRIDES.iter().map(|s| (width / s) * (height / s)).sum()
}

/// Whether an input size goes into whole cells and is not absurd.
pub(super) fn fits(width: usize, height: usize) -> bool {
    let whole = |size: usize| (1..=4096).contains(&size) && size.is_multiple_of(STRIDES[2]);
    whole(width) && whole(height)
}

/// Whether boxes of an output are in pixels already. Raw boxes are offsets in cells, around one; decoded ones hold the
/// cells' own coordinates.
pub(super) fn is_decoded(output: &[f32]) -> bool {
    let rows = output.chunks_exact(COLUMNS);
    let (count, sum) = (
        rows.len().max(1),
        rows.map(|row| f64::from(row[0])).sum::<f64>(),
    );
    sum / count as f64 > 16.0
}

/// The boxes of a raw output of `rows(width, height)` x [`COLUMNS`] whose score (objectness times best class) reaches the
/// threshold, in px of the input measured from its upper left corner; not yet suppressed.
pub(super) fn decode(
    output: &[f32],
    width: usize,
    height: usize,
    threshold: f32,
) -> Vec<Detection> {
    let cells = STRIDES.iter().flat_map(|&stride| {
        let columns = width / stride;
        (0..columns * (height / stride)).map(move |i| (i % columns, i / columns, stride as f64))
    });
    output
        .chunks_exact(COLUMNS)
        .zip(cells)
        .filter_map(|(row, cell)| decode_row(row, cell, threshold))
        .collect()
}

fn decode_row(
    row: &[f32],
    (column, line, stride): (usize, usize, f64),
    threshold: f32,
) -> Option<Detection> {
    // No class scores above one, so most rows end here.
    if row[4] < threshold {
        return None;
    }
    let (mut class, mut best) = (0, row[5]);
    for (i, &score) in row[5..].iter().enumerate() {
        if score > best {
            (class, best) = (i, score);
        }
    }
    let score = row[4] * best;
    let x = (f64::from(row[0]) + column as f64) * stride;
    let y = (f64::from(row[1]) + line as f64) * stride;
    let half_width = libm::exp(f64::from(row[2])) * stride / 2.0;
    let half_height = libm::exp(f64::from(row[3])) * stride / 2.0;
    let bounds = BoundingBox {
        x0: x - half_width,
        y0: y - half_height,
        x1: x + half_width,
        y1: y + half_height,
    };
    // Neither holds for a NaN.
    let finite = bounds.x0 < bounds.x1 && bounds.y0 < bounds.y1 && bounds.area().is_finite();
    (finite && score >= threshold).then_some(Detection {
        class: ClassId(class as u8),
        score,
        bounds,
    })
}

/// Non-maximum suppression per class: of boxes that overlap by more than the threshold the best stays. Returns them best
/// first; equal scores keep the order of the output's rows.
pub(super) fn suppress(mut boxes: Vec<Detection>, options: &OnnxOptions) -> Vec<Detection> {
    boxes.sort_by(|a, b| b.score.total_cmp(&a.score));
    let mut kept: Vec<Detection> = Vec::new();
    for candidate in boxes {
        let hides = |better: &Detection| {
            better.class == candidate.class
                && better.bounds.iou(&candidate.bounds) > f64::from(options.iou_threshold)
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

    fn detection(class: u8, score: f32, x0: f64) -> Detection {
        let bounds = BoundingBox {
            x0,
            y0: 0.0,
            x1: x0 + 10.0,
            y1: 10.0,
        };
        Detection {
            class: ClassId(class),
            score,
            bounds,
        }
    }

    #[test]
    fn rows_of_the_known_model() {
        assert_eq!(rows(416, 416), 3549);
        assert!(fits(416, 416) && fits(640, 480) && !fits(416, 400) && !fits(0, 32));
    }

    /// One row per map is set by hand; its box is where its cell is.
    #[test]
    fn a_row_is_decoded_by_its_cell() {
        let mut output = vec![0.0; rows(64, 32) * COLUMNS];
        // Maps of 8 x 4, 4 x 2 and 2 x 1 cells: row 9 is cell (1, 1) of the first, 32 + 6 is (2, 1) of the second.
        for (row, class, x) in [(9, 0, 0.5), (38, 56, 0.25), (41, 79, -1.0)] {
            let row = &mut output[row * COLUMNS..][..COLUMNS];
            (row[0], row[1], row[3], row[4], row[5 + class]) =
                (x, 0.5, std::f32::consts::LN_2, 0.5, 0.8);
        }
        let found = decode(&output, 64, 32, 0.25);
        let expected = [
            (0, [12.0, 12.0], 8.0),
            (56, [36.0, 24.0], 16.0),
            (79, [0.0, 16.0], 32.0),
        ];
        assert_eq!(found.len(), expected.len());
        for (d, (class, centre, width)) in found.iter().zip(expected) {
            assert_eq!(
                (d.class, d.score, d.bounds.centre()),
                (ClassId(class), 0.4, centre)
            );
            assert!((d.bounds.width() - width).abs() < 1e-9, "{d:?}");
            assert!((d.bounds.height() - 2.0 * width).abs() < 1e-5, "{d:?}");
        }
        assert!(decode(&output, 64, 32, 0.41).is_empty());
        assert!(!is_decoded(&output));
    }

    #[test]
    fn rows_that_are_no_numbers_are_left_out() {
        for column in 0..5 {
            let mut output = vec![0.0; rows(32, 32) * COLUMNS];
            (output[4], output[5]) = (1.0, 1.0);
            assert_eq!(decode(&output, 32, 32, 0.25).len(), 1);
            output[column] = f32::NAN;
            assert!(decode(&output, 32, 32, 0.25).is_empty(), "column {column}");
            output[column] = f32::INFINITY;
            assert!(
                column == 4 || decode(&output, 32, 32, 0.25).is_empty(),
                "column {column}"
            );
        }
    }

    #[test]
    fn only_the_best_of_a_class_stays_at_a_place() {
        let options = OnnxOptions::default();
        let boxes = vec![
            detection(0, 0.5, 1.0),
            detection(0, 0.9, 0.0),
            detection(1, 0.6, 0.0),
            detection(0, 0.4, 8.0),
        ];
        let kept = suppress(boxes.clone(), &options);
        assert_eq!(kept, [boxes[1], boxes[2], boxes[3]]);
        // What a suppressed box would have hidden stays.
        let chain = vec![
            detection(0, 0.9, 0.0),
            detection(0, 0.8, 3.0),
            detection(0, 0.7, 6.0),
        ];
        assert_eq!(suppress(chain.clone(), &options), [chain[0], chain[2]]);
    }

    #[test]
    fn decoded_outputs_are_noticed() {
        let mut output = vec![0.0; rows(416, 416) * COLUMNS];
        for (i, row) in output.chunks_exact_mut(COLUMNS).enumerate() {
            row[0] = (8 * (i % 52)) as f32;
        }
        assert!(is_decoded(&output));
    }
}
