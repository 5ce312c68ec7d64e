//! What surrounds each cell of a frame, for the test of free space.

/// What is in the 3x3 cells around each inner cell of a frame, so that most places are compared with it at one look.
#[derive(Clone, Debug, Default)]
pub(super) struct Surroundings {
    /// The least depth, m; infinite where there is none.
    pub(super) nearest: Vec<f32>,
    /// The greatest depth of what was not found to move, m; 0 where there is none.
    pub(super) farthest_still: Vec<f32>,
    /// How many of them have a depth.
    pub(super) valid: Vec<u8>,
}

impl Surroundings {
    /// Of a frame with these depths, in rows of `width` cells, and what was found to move.
    pub(super) fn new(width: usize, depth: &[f32], moving: &[bool]) -> Self {
        let near: Vec<f32> = depth
            .iter()
            .map(|z| if *z > 0.0 { *z } else { f32::INFINITY })
            .collect();
        let still = depth.iter().zip(moving);
        let still: Vec<f32> = still.map(|(z, m)| if *m { 0.0 } else { *z }).collect();
        let valid: Vec<u8> = depth.iter().map(|z| u8::from(*z > 0.0)).collect();
        Self {
            nearest: over_three_by_three(width, &near, |a, b| if b < a { b } else { a }),
            farthest_still: over_three_by_three(width, &still, |a, b| if b > a { b } else { a }),
            valid: over_three_by_three(width, &valid, |a, b| a + b),
        }
    }
}

/// Folds the 3x3 values around each inner one; those at the border stay as they are.
fn over_three_by_three<T: Copy>(width: usize, values: &[T], fold: impl Fn(T, T) -> T) -> Vec<T> {
    let mut out = values.to_vec();
    let height = values.len().checked_div(width).unwrap_or(0);
    if width < 3 || height < 3 {
        return out;
    }
    for y in 1..height - 1 {
        let row = |y: usize| &values[y * width..(y + 1) * width];
        let (above, here, below) = (row(y - 1), row(y), row(y + 1));
        let three = above.iter().zip(here).zip(below);
        let columns: Vec<T> = three.map(|((a, b), c)| fold(fold(*a, *b), *c)).collect();
        let inner = &mut out[y * width + 1..(y + 1) * width - 1];
        for (out, three) in inner.iter_mut().zip(columns.windows(3)) {
            *out = fold(fold(three[0], three[1]), three[2]);
        }
    }
    out
}
