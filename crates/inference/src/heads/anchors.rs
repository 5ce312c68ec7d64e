//! Raw outputs of YOLOv5 and YOLOv7: a map per stride, boxes relative to cells and anchors. With s the sigmoid: xy = (2 s(out) - 0.5 +
//! cell) * stride, wh = (2 s(out))^2 * anchor (Wang et al., "YOLOv7", 2022, and its predecessors' code, which no paper describes).

use super::gate::{Gate, best, sigmoid};
use super::{Candidate, Level, Mismatch, Reading, Tensor, shapes};

/// Columns before the classes.
const BEFORE: usize = 5;

/// The values of one anchor in one map.
struct Map<'a> {
    level: Level,
    /// Width and height of the anchor, px.
    anchor: [f64; 2],
    data: &'a [f32],
    columns: usize,
    /// Whether each column is a plane of its own; else the columns of a cell are adjacent.
    planes: bool,
}

impl Map<'_> {
    fn at(&self, cell: usize, column: usize) -> f32 {
        if self.planes {
            self.data[column * self.level.cells() + cell]
        } else {
            self.data[cell * self.columns + column]
        }
    }

    /// Maximum class value of each cell, and its class, computed plane by plane: if many cells pass, walking through all planes for each of
    /// them misses the cache at every step.
    fn best_of_planes(&self) -> (Vec<f32>, Vec<usize>) {
        let cells = self.level.cells();
        let mut planes = self.data.chunks_exact(cells.max(1)).skip(BEFORE);
        let mut values = planes.next().unwrap_or_default().to_vec();
        // NaN never wins a comparison.
        let odd = values.iter_mut().filter(|v| v.is_nan());
        odd.for_each(|v| *v = f32::NEG_INFINITY);
        let mut classes = vec![0; values.len()];
        for (class, plane) in (1..).zip(planes) {
            for ((value, best), &new) in values.iter_mut().zip(&mut classes).zip(plane) {
                let better = new > *value;
                *value = if better { new } else { *value };
                *best = if better { class } else { *best };
            }
        }
        (values, classes)
    }
}

pub(super) fn decode(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Result<Vec<Candidate>, Mismatch> {
    let done = reading.card.output.sigmoid;
    let gate = Gate::new(reading.threshold, done);
    let mut found = Vec::new();
    for map in maps(reading, outputs)? {
        let cells = map.level.cells();
        let objectness = |&cell: &usize| gate.may_pass(map.at(cell, BEFORE - 1));
        let passing: Vec<usize> = (0..cells).filter(objectness).collect();
        if map.planes && 16 * passing.len() > cells {
            let (values, classes) = map.best_of_planes();
            let best = |cell: usize| (classes[cell], values[cell]);
            let boxes = passing.into_iter().map(|cell| (cell, best(cell)));
            found.extend(
                boxes.filter_map(|(cell, best)| decode_cell(&map, cell, best, &gate, done)),
            );
        } else {
            found.extend(passing.into_iter().filter_map(|cell| {
                let best = best((BEFORE..map.columns).map(|column| map.at(cell, column)))?;
                decode_cell(&map, cell, best, &gate, done)
            }));
        }
    }
    Ok(found)
}

fn decode_cell(
    map: &Map<'_>,
    cell: usize,
    (class, value): (usize, f32),
    gate: &Gate,
    done: bool,
) -> Option<Candidate> {
    if !gate.may_pass(value) {
        return None;
    }
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

/// Passes all scores and their factors to `take`.
pub(super) fn each_score(reading: &Reading<'_>, outputs: &[Tensor], take: &mut impl FnMut(f32)) {
    for map in maps(reading, outputs).unwrap_or_default() {
        for column in BEFORE - 1..map.columns {
            (0..map.level.cells()).for_each(|cell| take(map.at(cell, column)));
        }
    }
}

/// The maps by stride and anchor. Outputs may come in any order, since their sizes identify them.
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

#[cfg(test)]
mod tests {
    use super::super::tests::{noise, reading, tensor};
    use super::*;
    use crate::card::{Head, ModelCard};

    /// The formula of the module's documentation, cell by cell, in the order of strides, anchors and cells.
    fn reference(
        outputs: &[Tensor],
        width: usize,
        height: usize,
        threshold: f64,
    ) -> Vec<(usize, f64, [f64; 4])> {
        let anchors = [
            (8, [[12, 16], [19, 36], [40, 28]]),
            (16, [[36, 75], [76, 55], [72, 146]]),
            (32, [[142, 110], [192, 243], [459, 401]]),
        ];
        let s = |x: f32| 1.0 / (1.0 + libm::exp(-f64::from(x)));
        let mut found = Vec::new();
        for ((stride, anchors), output) in anchors.into_iter().zip(outputs) {
            let (w, h) = (width / stride, height / stride);
            for (a, anchor) in anchors.into_iter().enumerate() {
                for (y, x) in (0..h).flat_map(|y| (0..w).map(move |x| (y, x))) {
                    let at = |k: usize| s(output.data[((a * 85 + k) * h + y) * w + x]);
                    let (mut class, mut best) = (0, 0.0);
                    for c in 0..80 {
                        if at(5 + c) > best {
                            (class, best) = (c, at(5 + c));
                        }
                    }
                    let score = at(4) * best;
                    if score < threshold {
                        continue;
                    }
                    let cx = (2.0 * at(0) - 0.5 + x as f64) * stride as f64;
                    let cy = (2.0 * at(1) - 0.5 + y as f64) * stride as f64;
                    let bw = libm::pow(2.0 * at(2), 2.0) * f64::from(anchor[0]);
                    let bh = libm::pow(2.0 * at(3), 2.0) * f64::from(anchor[1]);
                    let sides = [cx - bw / 2.0, cy - bh / 2.0, cx + bw / 2.0, cy + bh / 2.0];
                    found.push((class, score, sides));
                }
            }
        }
        found
    }

    fn random(width: usize, height: usize) -> Vec<Tensor> {
        let maps = [8, 16, 32].into_iter().enumerate().map(|(i, stride)| {
            let mut map = tensor(&[1, 255, height / stride, width / stride]);
            noise(&mut map, 7 + i as u64);
            map
        });
        maps.collect()
    }

    /// The same numbers with the columns of a cell adjacent.
    fn by_cells(map: &Tensor) -> Tensor {
        let (h, w) = (map.shape[2], map.shape[3]);
        let mut other = tensor(&[1, 3, h, w, 85]);
        for (i, value) in other.data.iter_mut().enumerate() {
            let (column, cell, anchor) = (i % 85, i / 85 % (h * w), i / 85 / (h * w));
            *value = map.data[(anchor * 85 + column) * h * w + cell];
        }
        other
    }

    #[test]
    fn random_maps_match_the_formula_in_both_layouts() {
        let card = ModelCard::new(Head::YoloAnchors);
        for (width, height, threshold) in [(64, 96, 0.9), (128, 64, 0.25), (128, 128, 0.97)] {
            let reading = reading(&card, width, height, threshold);
            let mut maps = random(width, height);
            if threshold > 0.95 {
                // Few cells pass, so they are read one by one.
                for map in &mut maps {
                    map.data.iter_mut().for_each(|v| *v *= 2.0);
                    let cells = map.shape[2] * map.shape[3];
                    for anchor in map.data.chunks_exact_mut(85 * cells) {
                        let objectness = anchor[4 * cells..5 * cells].iter_mut().enumerate();
                        objectness.for_each(|(i, v)| *v = if i % 20 == 0 { 8.0 } else { -8.0 });
                    }
                }
            }
            let expected = reference(&maps, width, height, f64::from(threshold));
            assert!(expected.len() > 20);
            let mut cells: Vec<Tensor> = maps.iter().map(by_cells).collect();
            // Output sizes identify the maps.
            cells.reverse();
            for outputs in [maps, cells] {
                let found = reading.decode(&outputs).unwrap();
                assert_eq!(found.len(), expected.len());
                for (d, (class, score, sides)) in found.iter().zip(&expected) {
                    let b = d.bounds;
                    assert_eq!(d.class, *class);
                    assert!((f64::from(d.score) - score).abs() < 1e-6);
                    for (side, expected) in [b.x0, b.y0, b.x1, b.y1].iter().zip(sides) {
                        assert!((side - expected).abs() < 1e-9, "{d:?} {sides:?}");
                    }
                }
            }
        }
    }

    #[test]
    fn maps_after_sigmoid_give_the_same_boxes() {
        let mut card = ModelCard::new(Head::YoloAnchors);
        let mut maps = random(64, 64);
        let raw = reading(&card, 64, 64, 0.5).decode(&maps).unwrap();
        let range = reading(&card, 64, 64, 0.5).score_range(&maps).unwrap();
        assert!(range.0 < -3.9 && range.1 > 3.9);
        maps.iter_mut()
            .flat_map(|m| &mut m.data)
            .for_each(|v| *v = sigmoid(*v) as f32);
        card.output.sigmoid = true;
        let done = reading(&card, 64, 64, 0.5).decode(&maps).unwrap();
        assert_eq!(done.len(), raw.len());
        for (a, b) in done.iter().zip(&raw) {
            assert!(a.class == b.class && (a.score - b.score).abs() < 1e-5);
            assert!((a.bounds.x0 - b.bounds.x0).abs() < 1e-2);
        }
    }

    /// With both searches for the best class.
    #[test]
    fn nan_scores_do_not_hide_other_classes() {
        let card = ModelCard::new(Head::YoloAnchors);
        for dense in [true, false] {
            let mut maps = random(64, 64);
            maps.iter_mut()
                .flat_map(|m| &mut m.data)
                .for_each(|v| *v = -8.0);
            let data = &mut maps[0].data;
            let cells = if dense { 64 } else { 1 };
            data[4 * 64..][..cells].fill(8.0);
            data[5 * 64..][..cells].fill(f32::NAN);
            data[(5 + 56) * 64..][..cells].fill(8.0);
            let found = reading(&card, 64, 64, 0.5).decode(&maps).unwrap();
            assert_eq!(found.len(), cells);
            assert!(found.iter().all(|d| d.class == 56));
        }
    }

    #[test]
    fn unexpected_maps_are_reported() {
        let card = ModelCard::new(Head::YoloAnchors);
        let reading = reading(&card, 64, 32, 0.25);
        let mut maps = random(64, 32);
        assert!(reading.decode(&maps).is_ok());
        maps.push(tensor(&[1, 255, 4, 8]));
        assert!(reading.decode(&maps).is_err());
        let mismatch = reading.decode(&maps[..2]).unwrap_err();
        assert!(
            mismatch
                .expected
                .ends_with("[1, 255, 4, 8], [1, 255, 2, 4], [1, 255, 1, 2]")
        );
        assert_eq!(mismatch.found, "[1, 255, 4, 8], [1, 255, 2, 4]");
    }
}
