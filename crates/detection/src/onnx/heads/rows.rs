//! Rows of x, y, width, height, objectness and classes: YOLOX as it leaves the network (Ge et al., "YOLOX: Exceeding YOLO Series
//! in 2021"), and whatever decodes such rows to pixels itself.

use super::gate::{Gate, best};
use super::{Candidate, Level, Mismatch, Reading, Tensor, shapes};

/// Columns before the classes'.
const BEFORE: usize = 5;

/// The most rows per cell: anchors of a model that decodes itself.
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

/// Rows that are in pixels already.
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

/// Whether most boxes of rows have their centre within two cells of the cell that they belong to, in px, as decoded ones do.
/// Raw ones are offsets, and lie around the upper left corner. Rows are by stride, anchor, line and column.
pub(in super::super) fn boxes_lie_in_their_cells(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> bool {
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
            let off = |at: f32, cell: f64| (f64::from(at) - (cell + 0.5) * stride).abs();
            off(row[0], *x) <= 2.0 * stride && off(row[1], *y) <= 2.0 * stride
        });
    2 * near.count() >= rows.len() / columns
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
    // No class scores above one, so most rows end here.
    if !gate.may_pass(row[BEFORE - 1]) {
        return None;
    }
    let (class, value) = best(row[BEFORE..].iter().copied())?;
    let score = gate.score(row[BEFORE - 1]) * gate.score(value);
    gate.passes(score).then_some((class, score))
}

/// The numbers of the one output, if it has up to `most` rows per cell.
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
