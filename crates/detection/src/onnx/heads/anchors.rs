//! YOLOv5 and YOLOv7 as they leave the last convolutions: a map per stride, boxes relative to cells and anchors. With s the
//! sigmoid: xy = (2 s(out) - 0.5 + cell) * stride, wh = (2 s(out))^2 * anchor (Wang et al., "YOLOv7", 2022, and its
//! predecessors' code, which no paper describes).

use super::gate::{Gate, best, sigmoid};
use super::{Candidate, Level, Mismatch, Reading, Tensor, shapes};

/// Columns before the classes'.
const BEFORE: usize = 5;

/// The numbers of one anchor in one map.
struct Map<'a> {
    level: Level,
    /// Width and height of the anchor, px.
    anchor: [f64; 2],
    data: &'a [f32],
    columns: usize,
    /// Whether each column is a plane of its own; else the columns of a cell lie together.
    planes: bool,
}

impl Map<'_> {
    /// The number of a column in a cell.
    fn at(&self, cell: usize, column: usize) -> f32 {
        if self.planes {
            self.data[column * self.level.cells() + cell]
        } else {
            self.data[cell * self.columns + column]
        }
    }
}

/// The boxes of all maps.
pub(super) fn decode(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Result<Vec<Candidate>, Mismatch> {
    let done = reading.card.output.sigmoid;
    let gate = Gate::new(reading.threshold, done);
    let mut found = Vec::new();
    for map in maps(reading, outputs)? {
        let cells = map.level.cells();
        if map.planes && !gate.any(&map.data[(BEFORE - 1) * cells..BEFORE * cells]) {
            continue;
        }
        for cell in 0..cells {
            let objectness = map.at(cell, BEFORE - 1);
            if gate.may_pass(objectness) {
                found.extend(decode_cell(&map, cell, &gate, done));
            }
        }
    }
    Ok(found)
}

fn decode_cell(map: &Map<'_>, cell: usize, gate: &Gate, done: bool) -> Option<Candidate> {
    let (class, value) = best((BEFORE..map.columns).map(|column| map.at(cell, column)))?;
    let score = gate.score(map.at(cell, BEFORE - 1)) * gate.score(value);
    if !gate.passes(score) {
        return None;
    }
    let share = |column| {
        let value = map.at(cell, column);
        if done {
            f64::from(value)
        } else {
            sigmoid(value)
        }
    };
    let (stride, columns) = (map.level.stride as f64, map.level.columns);
    let place = [(cell % columns) as f64, (cell / columns) as f64];
    let centre = [0, 1].map(|i| (2.0 * share(i) - 0.5 + place[i]) * stride);
    let half = [0, 1].map(|i| {
        let side = 2.0 * share(2 + i);
        side * side * map.anchor[i] / 2.0
    });
    Candidate::around(class, score, centre, half)
}

/// Takes all scores and their factors.
pub(super) fn each_score(reading: &Reading<'_>, outputs: &[Tensor], take: &mut impl FnMut(f32)) {
    for map in maps(reading, outputs).unwrap_or_default() {
        for column in BEFORE - 1..map.columns {
            (0..map.level.cells()).for_each(|cell| take(map.at(cell, column)));
        }
    }
}

/// The maps by stride and anchor. Outputs may come in any order, since their sizes tell them apart.
fn maps<'a>(reading: &Reading<'_>, outputs: &'a [Tensor]) -> Result<Vec<Map<'a>>, Mismatch> {
    let card = &reading.card.output;
    let columns = BEFORE + reading.card.class_count();
    let mut maps = Vec::new();
    for (level, anchors) in reading.levels().zip(&card.anchors) {
        let count = anchors.len() / 2;
        let Level {
            columns: w,
            rows: h,
            ..
        } = level;
        let layouts = [
            (true, vec![1, count * columns, h, w]),
            (false, vec![1, count, h, w, columns]),
        ];
        let size = count * columns * level.cells();
        let output = outputs
            .iter()
            .filter(|t| t.data.len() == size)
            .find_map(|t| {
                let layout = layouts.iter().find(|(_, shape)| *shape == t.shape);
                layout.map(|&(planes, _)| (planes, t))
            });
        let Some((planes, output)) = output else {
            return Err(mismatch(reading, outputs));
        };
        let parts = output.data.chunks_exact(columns * level.cells());
        for (data, anchor) in parts.zip(anchors.as_chunks::<2>().0) {
            maps.push(Map {
                level,
                anchor: anchor.map(f64::from),
                data,
                columns,
                planes,
            });
        }
    }
    if outputs.len() == card.strides.len() {
        Ok(maps)
    } else {
        Err(mismatch(reading, outputs))
    }
}

fn mismatch(reading: &Reading<'_>, outputs: &[Tensor]) -> Mismatch {
    let columns = BEFORE + reading.card.class_count();
    let anchors = &reading.card.output.anchors;
    let expected = reading.levels().zip(anchors).map(|(level, anchors)| {
        let depth = anchors.len() / 2 * columns;
        format!("[1, {depth}, {}, {}]", level.rows, level.columns)
    });
    Mismatch {
        expected: format!(
            "a raw map per stride: {}",
            expected.collect::<Vec<_>>().join(", ")
        ),
        found: shapes(outputs),
    }
}
