//! PicoDet and NanoDet: scores per class, and per side of a box a distribution over its distance from the centre (Li et al., "Generalized
//! Focal Loss", 2020): distance = stride * sum of i * softmax(out)_i over the bins.

use super::gate::{Gate, best};
use super::{Candidate, Level, Mismatch, Reading, Tensor, shapes};
use stillpoint_detection::BoundingBox;

const MOST_BINS: usize = 64;

/// The values of one map: scores and sides in rows per cell.
struct Map<'a> {
    level: Level,
    scores: Rows<'a>,
    sides: Rows<'a>,
}

/// A range of columns of an output's rows.
#[derive(Clone, Copy)]
struct Rows<'a> {
    data: &'a [f32],
    step: usize,
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

/// Mean bin index under the softmax of the values.
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

pub(super) fn each_score(reading: &Reading<'_>, outputs: &[Tensor], take: &mut impl FnMut(f32)) {
    for map in maps(reading, outputs).unwrap_or_default() {
        for cell in 0..map.level.cells() {
            map.scores.row(cell).iter().for_each(|&v| take(v));
        }
    }
}

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

/// An output of scores and one of sides per map, in any order. If their columns do not distinguish scores from sides, scores come first.
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

/// Whether this number of columns gives four distributions.
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

#[cfg(test)]
mod tests {
    use super::super::tests::{noise, reading, tensor};
    use super::*;
    use crate::card::{Head, ModelCard};

    /// For 416 x 320: maps of 52 x 40, 26 x 20, 13 x 10 and 7 x 5 cells.
    const CELLS: [usize; 4] = [2080, 520, 130, 35];

    fn outputs() -> Vec<Tensor> {
        let scores = CELLS.map(|n| tensor(&[1, n, 80]));
        let sides = CELLS.map(|n| tensor(&[1, n, 32]));
        [scores, sides].concat()
    }

    /// One cell per map is set by hand: all of a side's weight is on one bin, or on two.
    #[test]
    fn distribution_box_is_decoded_at_its_cell() {
        let card = ModelCard::new(Head::Distribution);
        let reading = reading(&card, 416, 320, 0.25);
        let mut outputs = outputs();
        for (level, cell) in [(0, 53), (3, 8)] {
            outputs[level].data[80 * cell + 56] = 0.75;
            let sides = &mut outputs[4 + level].data[32 * cell..][..32];
            for (side, bin) in [1, 2, 3, 7].into_iter().enumerate() {
                sides[8 * side + bin] = 200.0;
            }
            // The right side has half of its weight on bin four.
            sides[8 * 2 + 4] = 200.0;
        }
        let found = reading.decode(&outputs).unwrap();
        assert_eq!(found.len(), 2);
        // Column 1 and line 1 of both.
        for (d, stride) in found.iter().zip([8.0, 64.0]) {
            let b = d.bounds;
            assert_eq!((d.class, d.score), (56, 0.75));
            let cells = [b.x0, b.y0, b.x1, b.y1].map(|v| v / stride);
            assert_eq!(cells, [0.5, -0.5, 5.0, 8.5]);
        }
    }

    /// The layout with one output gives the same.
    #[test]
    fn all_distribution_layouts_agree() {
        let card = ModelCard::new(Head::Distribution);
        let reading = reading(&card, 416, 320, 0.9);
        let mut parted = outputs();
        for (i, output) in parted.iter_mut().enumerate() {
            noise(output, i as u64);
            if i < 4 {
                output.data.iter_mut().for_each(|v| *v = *v / 8.0 + 0.499);
            }
        }
        let mut joined = tensor(&[1, 2765, 112]);
        let rows = parted[..4]
            .iter()
            .zip(&parted[4..])
            .flat_map(|(scores, sides)| scores.data.chunks(80).zip(sides.data.chunks(32)));
        for (row, (scores, sides)) in joined.data.chunks_mut(112).zip(rows) {
            row[..80].copy_from_slice(scores);
            row[80..].copy_from_slice(sides);
        }
        let found = reading.decode(&parted).unwrap();
        assert!(found.len() > 100);
        assert_eq!(reading.decode(&[joined]).unwrap(), found);
        assert_eq!(
            reading.score_range(&parted).map(|(low, _)| low < 0.1),
            Some(true)
        );
        // Scores and sides of a map in turn.
        let turns: Vec<Tensor> = (0..8)
            .map(|i| parted[i / 2 + 4 * (i % 2)].clone())
            .collect();
        assert_eq!(reading.decode(&turns).unwrap(), found);
        assert!(reading.decode(&parted[1..]).is_err());
        parted[7].shape[2] = 31;
        assert!(reading.decode(&parted).is_err());
    }

    #[test]
    fn expectation_matches_the_softmax() {
        assert!((expectation(&[0.0; 8]) - 3.5).abs() < 1e-12);
        let p = libm::exp(1.0) / (1.0 + libm::exp(1.0));
        assert!((expectation(&[0.0, 1.0]) - p).abs() < 1e-12);
        assert!(
            (expectation(&[500.0, 501.0]) - p).abs() < 1e-12,
            "large values do not overflow"
        );
        assert!(expectation(&[f32::NAN; 8]).is_nan());
    }
}
