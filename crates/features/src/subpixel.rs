//! Subpixel refinement of corners.

use stillpoint_imaging::GrayImage;

/// Offset (dx, dy) of the peak of a quadratic surface fitted to the nine FAST scores around a local maximum; each
/// within one pixel, and 0 if the surface has no peak.
///
/// On fr1_xyz it reduces the median distance to the epipolar line of matches between frames 0.1 s apart by a third, at
/// all levels; Foerstner's point, Harris responses and the circle's differences do less or harm.
pub(crate) fn refine(scores: &GrayImage, x: usize, y: usize) -> (f32, f32) {
    let line = |y: usize| [-1, 0, 1].map(|dx| f32::from(scores.at(x.wrapping_add_signed(dx), y)));
    let grid = [line(y - 1), line(y), line(y + 1)];
    let column = |i: usize| grid[0][i] + grid[1][i] + grid[2][i];
    let row = |i: usize| grid[i][0] + grid[i][1] + grid[i][2];
    // Gradient and Hessian of the fitted surface at the centre.
    let (gx, gy) = ((column(2) - column(0)) / 6.0, (row(2) - row(0)) / 6.0);
    let hxx = (column(0) - 2.0 * column(1) + column(2)) / 3.0;
    let hyy = (row(0) - 2.0 * row(1) + row(2)) / 3.0;
    let hxy = (grid[0][0] + grid[2][2] - grid[0][2] - grid[2][0]) / 4.0;
    let determinant = hxx * hyy - hxy * hxy;
    if determinant <= 0.0 || hxx >= 0.0 {
        return (0.0, 0.0);
    }
    let dx = (hxy * gy - hyy * gx) / determinant;
    let dy = (hxy * gx - hxx * gy) / determinant;
    (dx.clamp(-1.0, 1.0), dy.clamp(-1.0, 1.0))
}

#[cfg(test)]
mod tests {
    use super::*;

    fn scores(value: impl Fn(f32, f32) -> f32) -> GrayImage {
        let data = (0..9)
            .map(|i| value((i % 3) as f32 - 1.0, (i / 3) as f32 - 1.0).round() as u8)
            .collect();
        GrayImage::from_vec(3, 3, data).unwrap()
    }

    #[test]
    fn quadratic_peak_is_found() {
        for (px, py) in [(0.0, 0.0), (0.3, -0.2), (-0.45, 0.4)] {
            let image = scores(|x, y| {
                let (u, v) = (x - px, y - py);
                200.0 - 30.0 * u * u - 20.0 * v * v + 10.0 * u * v
            });
            let (dx, dy) = refine(&image, 1, 1);
            assert!(
                (dx - px).abs() < 0.03 && (dy - py).abs() < 0.03,
                "({dx}, {dy})"
            );
        }
    }

    #[test]
    fn plateau_and_saddle_are_not_moved() {
        assert_eq!(refine(&scores(|_, _| 50.0), 1, 1), (0.0, 0.0));
        assert_eq!(
            refine(&scores(|x, y| 50.0 + 9.0 * x * x - 9.0 * y * y), 1, 1),
            (0.0, 0.0)
        );
    }

    #[test]
    fn refinement_is_limited_to_one_pixel() {
        let (dx, dy) = refine(&scores(|x, _| 100.0 + 50.0 * x - x * x), 1, 1);
        assert!(dx.abs() <= 1.0 && dy.abs() <= 1.0, "({dx}, {dy})");
    }
}
