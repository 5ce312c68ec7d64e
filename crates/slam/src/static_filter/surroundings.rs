//! Neighbourhood statistics of each cell, for the free-space test.

/// Statistics of the 3x3 cells around each inner cell, so that most places need a single comparison.
#[derive(Clone, Debug, Default)]
pub(super) struct Surroundings {
    /// Minimum depth, m; infinite if none.
    pub(super) nearest: Vec<f32>,
    /// Maximum depth of static cells, m; 0 if none.
    pub(super) farthest_still: Vec<f32>,
    pub(super) valid: Vec<u8>,
}

impl Surroundings {
    /// From the depths of a frame, in rows of `width` cells, and its moving cells.
    #[cfg(test)]
    pub(super) fn new(width: usize, depth: &[f32], moving: &[bool]) -> Self {
        let mut around = Self::default();
        around.rebuild(width, depth, moving);
        around
    }

    pub(super) fn rebuild(&mut self, width: usize, depth: &[f32], moving: &[bool]) {
        let near = |i: usize| match depth[i] {
            z if z > 0.0 => z,
            _ => f32::INFINITY,
        };
        let still = |i: usize| if moving[i] { 0.0 } else { depth[i] };
        let valid = |i: usize| u8::from(depth[i] > 0.0);
        let size = [width, depth.len()];
        over_three_by_three(
            size,
            near,
            |a, b| if b < a { b } else { a },
            &mut self.nearest,
        );
        over_three_by_three(
            size,
            still,
            |a, b| if b > a { b } else { a },
            &mut self.farthest_still,
        );
        over_three_by_three(size, valid, |a, b| a + b, &mut self.valid);
    }
}

/// Folds the 3x3 values around each inner cell; border values are copied.
fn over_three_by_three<T: Copy>(
    [width, count]: [usize; 2],
    value: impl Fn(usize) -> T,
    fold: impl Fn(T, T) -> T,
    out: &mut Vec<T>,
) {
    out.clear();
    out.extend((0..count).map(&value));
    let height = count.checked_div(width).unwrap_or(0);
    if width < 3 || height < 3 {
        return;
    }
    for y in 1..height - 1 {
        let row = y * width;
        let column = |x: usize| {
            let i = row + x;
            fold(fold(value(i - width), value(i)), value(i + width))
        };
        let (mut left, mut here) = (column(0), column(1));
        for (x, out) in out[row + 1..row + width - 1].iter_mut().enumerate() {
            let right = column(x + 2);
            *out = fold(fold(left, here), right);
            (left, here) = (here, right);
        }
    }
}
