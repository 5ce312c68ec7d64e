//! PicoDet and NanoDet: scores per class, and per side of a box a distribution over its distance from the centre (Li et al.,
//! "Generalized Focal Loss", 2020): distance = stride * sum of i * softmax(out)_i over the bins.

use super::gate::{Gate, best};
use super::{Candidate, Level, Mismatch, Reading, Tensor, shapes};
use crate::BoundingBox;

/// The most bins per side.
const MOST_BINS: usize = 64;

/// The numbers of one map: its scores and its sides in rows per cell.
struct Map<'a> {
    level: Level,
    scores: Rows<'a>,
    sides: Rows<'a>,
}

/// Part of each row of an output.
#[derive(Clone, Copy)]
struct Rows<'a> {
    data: &'a [f32],
    /// From one row to the next.
    step: usize,
    /// Where the part begins in a row, and its length.
    begin: usize,
    length: usize,
}

impl<'a> Rows<'a> {
    fn row(&self, i: usize) -> &'a [f32] {
        &self.data[i * self.step + self.begin..][..self.length]
    }
}

/// The boxes of all maps: the best class of each cell.
pub(super) fn decode(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Result<Vec<Candidate>, Mismatch> {
    let gate = Gate::new(reading.threshold, reading.card.output.sigmoid);
    let mut found = Vec::new();
    for map in maps(reading, outputs)? {
        for cell in 0..map.level.cells() {
            let scores = map.scores.row(cell);
            if gate.any(scores) {
                found.extend(decode_cell(reading, &map, cell, &gate));
            }
        }
    }
    Ok(found)
}

fn decode_cell(
    reading: &Reading<'_>,
    map: &Map<'_>,
    cell: usize,
    gate: &Gate,
) -> Option<Candidate> {
    let (class, value) = best(map.scores.row(cell).iter().copied())?;
    let score = gate.score(value);
    if !gate.passes(score) {
        return None;
    }
    let Level {
        stride, columns, ..
    } = map.level;
    let stride = stride as f64;
    let centre = f64::from(reading.card.output.centre);
    let x = ((cell % columns) as f64 + centre) * stride;
    let y = ((cell / columns) as f64 + centre) * stride;
    let sides = map.sides.row(cell);
    let mut distances = [0.0; 4];
    for (distance, bins) in distances
        .iter_mut()
        .zip(sides.chunks_exact(sides.len() / 4))
    {
        *distance = expectation(bins) * stride;
    }
    let [left, top, right, bottom] = distances;
    let bounds = BoundingBox {
        x0: x - left,
        y0: y - top,
        x1: x + right,
        y1: y + bottom,
    };
    Candidate::new(class, score, bounds)
}

/// The mean of the bins' numbers under the softmax of their values.
fn expectation(bins: &[f32]) -> f64 {
    let highest = bins.iter().copied().fold(f32::NEG_INFINITY, f32::max);
    let (mut sum, mut weighted) = (0.0, 0.0);
    for (i, &value) in bins.iter().enumerate() {
        let weight = libm::exp(f64::from(value) - f64::from(highest));
        sum += weight;
        weighted += i as f64 * weight;
    }
    weighted / sum
}

/// Takes all scores.
pub(super) fn each_score(reading: &Reading<'_>, outputs: &[Tensor], take: &mut impl FnMut(f32)) {
    for map in maps(reading, outputs).unwrap_or_default() {
        for cell in 0..map.level.cells() {
            map.scores.row(cell).iter().for_each(|&v| take(v));
        }
    }
}

/// The maps from fine to coarse.
fn maps<'a>(reading: &Reading<'_>, outputs: &'a [Tensor]) -> Result<Vec<Map<'a>>, Mismatch> {
    let found = match outputs {
        [output] => joined(reading, output),
        _ => parted(reading, outputs),
    };
    found.ok_or_else(|| mismatch(reading, outputs))
}

/// All in one output: classes and sides of a cell in one row, the maps one after another.
fn joined<'a>(reading: &Reading<'_>, output: &'a Tensor) -> Option<Vec<Map<'a>>> {
    let classes = reading.card.class_count();
    let &[1, rows, columns] = &output.shape[..] else {
        return None;
    };
    let sides = columns.checked_sub(classes).filter(|&s| are_sides(s))?;
    if rows != reading.cells() || output.data.len() != rows * columns {
        return None;
    }
    let mut rest = &output.data[..];
    let maps = reading.levels().map(|level| {
        let (data, after) = rest.split_at(level.cells() * columns);
        rest = after;
        let part = |begin, length| Rows {
            data,
            step: columns,
            begin,
            length,
        };
        Map {
            level,
            scores: part(0, classes),
            sides: part(classes, sides),
        }
    });
    Some(maps.collect())
}

/// An output of scores and one of sides per map, in any order. Where their columns do not tell scores from sides, scores come
/// first.
fn parted<'a>(reading: &Reading<'_>, outputs: &'a [Tensor]) -> Option<Vec<Map<'a>>> {
    if outputs.len() != 2 * reading.card.output.strides.len() {
        return None;
    }
    let classes = reading.card.class_count();
    let mut taken = vec![false; outputs.len()];
    let mut take = |rows: usize, wanted: &dyn Fn(usize) -> bool| {
        let place = outputs.iter().zip(&taken).position(|(t, &taken)| {
            let fits = matches!(t.shape[..], [1, r, c] if r == rows && wanted(c));
            fits && !taken && t.data.len() == t.shape.iter().product::<usize>()
        })?;
        taken[place] = true;
        let length = outputs[place].shape[2];
        Some(Rows {
            data: &outputs[place].data,
            step: length,
            begin: 0,
            length,
        })
    };
    let mut maps = Vec::new();
    for level in reading.levels() {
        let scores = take(level.cells(), &|columns| columns == classes)?;
        let sides = take(level.cells(), &are_sides)?;
        maps.push(Map {
            level,
            scores,
            sides,
        });
    }
    Some(maps)
}

/// Whether so many columns are four distributions.
fn are_sides(columns: usize) -> bool {
    columns.is_multiple_of(4) && (2..=MOST_BINS).contains(&(columns / 4))
}

fn mismatch(reading: &Reading<'_>, outputs: &[Tensor]) -> Mismatch {
    let classes = reading.card.class_count();
    let cells: Vec<String> = reading.levels().map(|l| l.cells().to_string()).collect();
    Mismatch {
        expected: format!(
            "scores [1, cells, {classes}] and sides [1, cells, 4 bins] for {} cells, or one output [1, {}, {classes} + 4 bins]",
            cells.join(", "),
            reading.cells()
        ),
        found: shapes(outputs),
    }
}
