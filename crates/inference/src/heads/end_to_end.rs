//! Networks with built-in suppression: a table whose columns the card names, or the four outputs of exporters for TensorRT (count, boxes,
//! scores, classes).

use super::super::card::Column;
use super::{Candidate, Mismatch, Reading, Tensor, shapes};
use stillpoint_detection::BoundingBox;

/// The boxes whose score reaches the threshold.
pub(super) fn decode(
    reading: &Reading<'_>,
    outputs: &[Tensor],
) -> Result<Vec<Candidate>, Mismatch> {
    let classes = reading.card.class_count();
    let take = |[x0, y0, x1, y1]: [f32; 4], score: f32, class: f32| {
        let bounds = BoundingBox {
            x0: f64::from(x0),
            y0: f64::from(y0),
            x1: f64::from(x1),
            y1: f64::from(y1),
        };
        // No NaN is in the range.
        let known = (-0.5..classes as f32 - 0.5).contains(&class) && score >= reading.threshold;
        // Padding rows have class -1 or no area.
        known.then(|| Candidate::new((class + 0.5) as usize, score, bounds))?
    };
    let columns = &reading.card.output.columns;
    match outputs {
        [table] if columns.len() >= 6 && is_table(table, columns.len()) => {
            let place = |column| columns.iter().position(|&c| c == column).unwrap_or(0);
            let sides = [Column::X0, Column::Y0, Column::X1, Column::Y1].map(place);
            let (score, class) = (place(Column::Score), place(Column::Class));
            let batch = columns.iter().position(|&c| c == Column::Batch);
            let rows = table.data.chunks_exact(columns.len());
            let first = rows.filter(|row| batch.is_none_or(|b| row[b] == 0.0));
            let found = first.filter_map(|row| take(sides.map(|i| row[i]), row[score], row[class]));
            Ok(found.collect())
        }
        [count, boxes, scores, numbers] => {
            let Some(rows) = four(count, boxes, scores, numbers) else {
                return Err(mismatch(reading, outputs));
            };
            let (sides, _) = boxes.data.as_chunks::<4>();
            let rows = sides.iter().zip(&scores.data).zip(&numbers.data).take(rows);
            Ok(rows
                .filter_map(|((&sides, &score), &class)| take(sides, score, class))
                .collect())
        }
        _ => Err(mismatch(reading, outputs)),
    }
}

/// Whether an output is [boxes, columns] or [1, boxes, columns].
fn is_table(output: &Tensor, columns: usize) -> bool {
    let rows = match output.shape[..] {
        [rows, found] | [1, rows, found] if found == columns => rows,
        _ => return false,
    };
    output.data.len() == rows * columns
}

/// Number of boxes of four outputs [1, 1], [1, n, 4], [1, n] and [1, n].
fn four(count: &Tensor, boxes: &Tensor, scores: &Tensor, numbers: &Tensor) -> Option<usize> {
    let &[1, most, 4] = &boxes.shape[..] else {
        return None;
    };
    let whole = |t: &Tensor, expected: usize| {
        t.data.len() == expected && t.shape.iter().product::<usize>() == expected
    };
    let fits =
        whole(count, 1) && whole(boxes, 4 * most) && whole(scores, most) && whole(numbers, most);
    // NaN or a negative count becomes zero.
    fits.then(|| (count.data[0] as usize).min(most))
}

fn mismatch(reading: &Reading<'_>, outputs: &[Tensor]) -> Mismatch {
    let columns = reading.card.output.columns.len();
    Mismatch {
        expected: format!(
            "one output [boxes, {columns}] or [1, boxes, {columns}] with the card's columns, or four: count [1, 1], boxes [1, n, 4], scores [1, n], classes [1, n]"
        ),
        found: shapes(outputs),
    }
}

#[cfg(test)]
mod tests {
    use super::super::tests::{reading, tensor};
    use super::*;
    use crate::card::{Head, ModelCard};

    fn table(rows: &[[f32; 7]]) -> Tensor {
        Tensor {
            name: String::new(),
            shape: vec![rows.len(), 7],
            data: rows.concat(),
        }
    }

    #[test]
    fn table_rows_become_boxes() {
        let card = ModelCard::new(Head::EndToEnd);
        let reading = reading(&card, 640, 640, 0.25);
        let outputs = [table(&[
            [0.0, 1.0, 2.0, 30.0, 40.0, 56.0, 0.9],
            [1.0, 1.0, 2.0, 30.0, 40.0, 56.0, 0.9],
            [0.0, 1.0, 2.0, 30.0, 40.0, 56.0, 0.2],
            [0.0, 30.0, 2.0, 1.0, 40.0, 56.0, 0.9],
            [0.0, 1.0, 2.0, 30.0, 40.0, 80.0, 0.9],
            [0.0, 1.0, 2.0, 30.0, 40.0, -1.0, 0.9],
            [0.0, 1.0, 2.0, 30.0, 40.0, f32::NAN, 0.9],
            [0.0, -5.0, 2.0, 30.0, 40.0, 0.0, 0.25],
        ])];
        let found = reading.decode(&outputs).unwrap();
        let expected = [(56, 0.9, 1.0), (0, 0.25, -5.0)];
        assert_eq!(found.len(), expected.len());
        for (d, (class, score, x0)) in found.iter().zip(expected) {
            assert_eq!((d.class, d.score, d.bounds.x0), (class, score, x0));
            assert_eq!((d.bounds.y0, d.bounds.x1, d.bounds.y1), (2.0, 30.0, 40.0));
        }
        assert_eq!(reading.decode(&[table(&[])]), Ok(vec![]));
        assert!(reading.decode(&[tensor(&[5, 6])]).is_err());
        assert_eq!(reading.score_range(&outputs), None);
    }

    #[test]
    fn columns_follow_the_card() {
        use Column::{Class, Ignored, Score, X0, X1, Y0, Y1};
        let mut card = ModelCard::new(Head::EndToEnd);
        card.output.columns = vec![Score, Ignored, Class, Y0, X0, Y1, X1];
        let mut output = tensor(&[1, 1, 7]);
        output.data = vec![0.5, 99.0, 3.0, 20.0, 10.0, 40.0, 30.0];
        let found = reading(&card, 640, 640, 0.25).decode(&[output]).unwrap();
        let b = found[0].bounds;
        assert_eq!((found[0].class, found[0].score), (3, 0.5));
        assert_eq!([b.x0, b.y0, b.x1, b.y1], [10.0, 20.0, 30.0, 40.0]);
    }

    #[test]
    fn four_outputs_become_boxes() {
        let card = ModelCard::new(Head::EndToEnd);
        let reading = reading(&card, 640, 640, 0.25);
        let mut outputs = [&[1, 1][..], &[1, 3, 4], &[1, 3], &[1, 3]].map(tensor);
        outputs[0].data[0] = 2.0;
        for row in outputs[1].data.chunks_mut(4) {
            row.copy_from_slice(&[1.0, 2.0, 3.0, 4.0]);
        }
        outputs[2].data = vec![0.9, 0.1, 0.9];
        outputs[3].data = vec![7.0, 7.0, 7.0];
        let found = reading.decode(&outputs).unwrap();
        assert_eq!(
            found.len(),
            1,
            "one has a low score, one is beyond the count"
        );
        assert_eq!((found[0].class, found[0].bounds.x1), (7, 3.0));
        for count in [f32::NAN, -1.0] {
            outputs[0].data[0] = count;
            assert_eq!(reading.decode(&outputs), Ok(vec![]));
        }
        outputs[0].data[0] = 1e30;
        assert_eq!(reading.decode(&outputs).unwrap().len(), 2);
        outputs[3].data.pop();
        assert!(reading.decode(&outputs).is_err());
    }
}
