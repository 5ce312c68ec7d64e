//! Rows of x, y, width, height, objectness and classes: raw YOLOX (Ge et al., "YOLOX: Exceeding YOLO Series in 2021"), and networks that
//! decode such rows to pixels themselves.

use super::gate::{Gate, best};
use super::{Candidate, Head, Level, Mismatch, Reading, Tensor, shapes};

/// Columns before the classes.
const BEFORE: usize = 5;

/// Maximum number of rows per cell: anchors of a model that decodes itself.
const MOST_ANCHORS: usize = 9;

/// YOLOX: xy = (out + cell) * stride, wh = exp(out) * stride.
pub(super) fn decode_raw(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Result<Vec<Candidate>, Mismatch> {
    let columns = BEFORE + reading.card.class_count();
    let rows = rows(reading, outputs, 1)?;
    let gate = Gate::new(reading.threshold, reading.card.output.sigmoid);
    let cells = reading.levels().flat_map(cells);
    let found = rows.chunks_exact(columns).zip(cells);
    let found = found.filter_map(|(row, ([x, y], stride))| {
        let (class, score) = score(row, &gate)?;
        let centre = [
            (f64::from(row[0]) + x) * stride,
            (f64::from(row[1]) + y) * stride,
        ];
        let half = [row[2], row[3]].map(|v| libm::exp(f64::from(v)) * stride / 2.0);
        Candidate::around(class, score, centre, half)
    });
    Ok(found.collect())
}

/// Rows in pixels already.
pub(super) fn decode_grid(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Result<Vec<Candidate>, Mismatch> {
    let columns = BEFORE + reading.card.class_count();
    let rows = rows(reading, outputs, MOST_ANCHORS)?;
    let gate = Gate::new(reading.threshold, reading.card.output.sigmoid);
    let found = rows.chunks_exact(columns).filter_map(|row| {
        let (class, score) = score(row, &gate)?;
        let [x, y, width, height] = [row[0], row[1], row[2], row[3]].map(f64::from);
        Candidate::around(class, score, [x, y], [width / 2.0, height / 2.0])
    });
    Ok(found.collect())
}

/// All scores and their factors.
pub(super) fn scores(classes: usize, outputs: &[Tensor]) -> impl Iterator<Item = f32> {
    let rows = outputs
        .iter()
        .flat_map(move |t| t.data.chunks_exact(BEFORE + classes));
    rows.flat_map(|row| &row[BEFORE - 1..]).copied()
}

/// Whether two of three boxes have their centre within a cell and a half of their cell, in px, as decoded ones do: YOLOv5's and YOLOv7's
/// all, and four of five of YOLOX's. Raw ones are offsets around the upper left corner. Rows are by stride, anchor, line and column.
pub(in super::super) fn boxes_lie_in_their_cells(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> bool {
    lie_in_their_cells(reading, outputs, [1.0, 1.0])
}

/// Maximum x and y of the centres, if boxes should be in px but are not. Boxes of a blank image are spread over the whole input. Rows of
/// YOLOX are offsets unless they lie in their cells as fractions of the input.
pub(in super::super) fn boxes_not_in_pixels(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Option<[f32; 2]> {
    let rows = rows(reading, outputs, MOST_ANCHORS).ok()?;
    let columns = BEFORE + reading.card.class_count();
    let size = [reading.size.width, reading.size.height];
    let mut reach = [0.0_f32; 2];
    for row in rows.chunks_exact(columns) {
        reach = [0, 1].map(|i| match row[i] {
            at if at.is_finite() => reach[i].max(at),
            _ => reach[i],
        });
    }
    let found = match reading.card.head {
        Head::Yolox => lie_in_their_cells(reading, outputs, size.map(|s| s as f64)),
        Head::YoloGrid if rows.len() / columns > reading.cells() => {
            (0..2).all(|i| reach[i] < 0.25 * size[i] as f32)
        }
        // A single row per cell may be YOLOX's, whose offsets are encoded differently.
        Head::YoloGrid => lie_in_their_cells(reading, outputs, size.map(|s| s as f64)),
        _ => false,
    };
    found.then_some(reach)
}

fn lie_in_their_cells(reading: &Reading<'_>, outputs: &[Tensor], scale: [f64; 2]) -> bool {
    let Ok(rows) = rows(reading, outputs, MOST_ANCHORS) else {
        return false;
    };
    let columns = BEFORE + reading.card.class_count();
    let anchors = rows.len() / columns / reading.cells().max(1);
    let cells = reading
        .levels()
        .flat_map(|level| (0..anchors).flat_map(move |_| cells(level)));
    let near = rows
        .chunks_exact(columns)
        .zip(cells)
        .filter(|(row, ([x, y], stride))| {
            let off = |i: usize, cell: f64| {
                (f64::from(row[i]) * scale[i] - (cell + 0.5) * stride).abs() <= 1.5 * stride
            };
            off(0, *x) && off(1, *y)
        });
    3 * near.count() >= 2 * (rows.len() / columns)
}

/// Column and line of each cell of a map, and its size in px.
fn cells(level: Level) -> impl Iterator<Item = ([f64; 2], f64)> {
    (0..level.cells()).map(move |i| {
        let cell = [(i % level.columns) as f64, (i / level.columns) as f64];
        (cell, level.stride as f64)
    })
}

/// Class and score of a row that reaches the threshold.
fn score(row: &[f32], gate: &Gate) -> Option<(usize, f32)> {
    // Class scores are at most one, so most rows end here.
    if !gate.may_pass(row[BEFORE - 1]) {
        return None;
    }
    let (class, value) = best(row[BEFORE..].iter().copied())?;
    let score = gate.score(row[BEFORE - 1]) * gate.score(value);
    gate.passes(score).then_some((class, score))
}

/// The values of the one output, if it has up to `most` rows per cell.
fn rows<'a>(
    reading: &Reading<'_>,
    outputs: &'a [Tensor],
    most: usize,
) -> Result<&'a [f32], Mismatch> {
    let (cells, columns) = (reading.cells(), BEFORE + reading.card.class_count());
    if let [output] = outputs
        && let &[1, rows, found] = &output.shape[..]
        && found == columns
        && rows.is_multiple_of(cells)
        && (1..=most).contains(&(rows / cells))
        && output.data.len() == rows * columns
    {
        return Ok(&output.data);
    }
    let count = match most {
        1 => cells.to_string(),
        _ => format!("anchors x {cells}"),
    };
    Err(Mismatch {
        expected: format!("one output of [1, {count}, {columns}]"),
        found: shapes(outputs),
    })
}

#[cfg(test)]
mod tests {
    use super::super::tests::{reading, tensor};
    use super::*;
    use crate::card::{Head, ModelCard};

    const COLUMNS: usize = 85;

    #[test]
    fn yolox_cell_count_matches_the_known_model() {
        let card = ModelCard::new(Head::Yolox);
        assert_eq!(reading(&card, 416, 416, 0.25).cells(), 3549);
        assert_eq!(reading(&card, 416, 320, 0.25).cells(), 2730);
    }

    /// One row per map is set by hand; its box is at its cell.
    #[test]
    fn row_is_decoded_at_its_cell() {
        let card = ModelCard::new(Head::Yolox);
        // Maps of 8 x 4, 4 x 2 and 2 x 1 cells: row 9 is cell (1, 1) of the first, 32 + 6 is (2, 1) of the second.
        let mut output = tensor(&[1, 42, COLUMNS]);
        for (row, class, x) in [(9, 0, 0.5), (38, 56, 0.25), (41, 79, -1.0)] {
            let row = &mut output.data[row * COLUMNS..][..COLUMNS];
            (row[0], row[1], row[3], row[4], row[5 + class]) =
                (x, 0.5, std::f32::consts::LN_2, 0.5, 0.8);
        }
        let outputs = [output];
        let found = reading(&card, 64, 32, 0.25).decode(&outputs).unwrap();
        let expected = [
            (0, [12.0, 12.0], 8.0),
            (56, [36.0, 24.0], 16.0),
            (79, [0.0, 16.0], 32.0),
        ];
        assert_eq!(found.len(), expected.len());
        for (d, (class, centre, width)) in found.iter().zip(expected) {
            assert_eq!((d.class, d.score, d.bounds.centre()), (class, 0.4, centre));
            assert!((d.bounds.width() - width).abs() < 1e-9, "{d:?}");
            assert!((d.bounds.height() - 2.0 * width).abs() < 1e-5, "{d:?}");
        }
        let strict = reading(&card, 64, 32, 0.41);
        assert!(strict.decode(&outputs).unwrap().is_empty());
        assert!(!boxes_lie_in_their_cells(&strict, &outputs));
        assert_eq!(strict.score_range(&outputs), Some((0.0, 0.8)));
    }

    #[test]
    fn non_finite_values_are_dropped() {
        for head in [Head::Yolox, Head::YoloGrid] {
            let card = ModelCard::new(head);
            let reading = reading(&card, 32, 32, 0.25);
            for column in 0..6 {
                for value in [f32::NAN, f32::INFINITY, f32::NEG_INFINITY, f32::MAX] {
                    let mut outputs = [tensor(&[1, 21, COLUMNS])];
                    let row = &mut outputs[0].data[..COLUMNS];
                    row[..6].copy_from_slice(&[1.0; 6]);
                    assert_eq!(reading.decode(&outputs).unwrap().len(), 1);
                    outputs[0].data[column] = value;
                    for found in reading.decode(&outputs).unwrap() {
                        assert!(found.score <= 1.0 && found.bounds.area().is_finite());
                    }
                }
            }
        }
    }

    #[test]
    fn decoded_rows_are_used_unchanged() {
        let card = ModelCard::new(Head::YoloGrid);
        let reading = reading(&card, 64, 32, 0.25);
        // Three anchors; every box is in the middle of its cell.
        let mut output = tensor(&[1, 3 * 42, COLUMNS]);
        let cells = reading
            .levels()
            .flat_map(|level| (0..3).flat_map(move |_| cells(level)));
        for (row, ([x, y], stride)) in output.data.chunks_exact_mut(COLUMNS).zip(cells) {
            row[0] = ((x + 0.5) * stride) as f32;
            row[1] = ((y + 0.5) * stride) as f32;
        }
        output.data[5 * COLUMNS..][2..6].copy_from_slice(&[10.0, 20.0, 0.9, 0.5]);
        let mut outputs = [output];
        let found = reading.decode(&outputs).unwrap();
        assert_eq!(found.len(), 1);
        assert_eq!((found[0].class, found[0].score), (0, 0.45));
        assert_eq!(found[0].bounds.centre(), [44.0, 4.0]);
        assert_eq!(
            (found[0].bounds.width(), found[0].bounds.height()),
            (10.0, 20.0)
        );
        assert!(boxes_lie_in_their_cells(&reading, &outputs));
        // Landscape coordinates in a portrait input.
        let upright = Reading {
            size: super::super::Size {
                width: 32,
                height: 64,
            },
            ..reading
        };
        assert!(!boxes_lie_in_their_cells(&upright, &outputs));
        assert_eq!(boxes_not_in_pixels(&reading, &outputs), None);
        for row in outputs[0].data.chunks_exact_mut(COLUMNS) {
            (row[0], row[1]) = (row[0] / 64.0, row[1] / 32.0);
        }
        let reach = boxes_not_in_pixels(&reading, &outputs).unwrap();
        assert!(reach.iter().all(|r| (0.5..1.0).contains(r)), "{reach:?}");
        outputs[0].data.iter_mut().for_each(|v| *v = 0.5);
        assert!(!boxes_lie_in_their_cells(&reading, &outputs));
    }

    #[test]
    fn outputs_of_unexpected_shape_are_reported() {
        let card = ModelCard::new(Head::Yolox);
        let reading = reading(&card, 64, 32, 0.25);
        for shapes in [
            &[][..],
            &[&[1_usize, 41, 85][..]],
            &[&[1, 42, 84]],
            &[&[42, 85]],
            &[&[1, 0, 85]],
        ] {
            let outputs: Vec<Tensor> = shapes.iter().map(|s| tensor(s)).collect();
            let mismatch = reading.decode(&outputs).unwrap_err();
            assert_eq!(mismatch.expected, "one output of [1, 42, 85]");
        }
    }
}
