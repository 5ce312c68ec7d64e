//! Image edges: along an edge a position is less certain than across it.

use crate::flow::patch::GradientSums;

/// How fast the deviation of a position along an edge grows with the ratio of the gradients across and along it.
/// Measured on matches and on flow by their distance from a static scene: about 0.6 with the cameras of fr1_xyz and of
/// the kitchen, up to 1.6 in sharp rendered images (tartanair_office), where the steps of the pixel grid move along an
/// edge (decision 56). Chosen near the real cameras.
const ALONG: f64 = 0.7;
/// Length of the stored vector on a straight line, in units of a signed byte: by definition its largest number.
const UNIT: f64 = 127.0;

/// The edge that a window of an image shows. Its [vector](Edge::vector) is the direction along the edge, with a squared
/// length of 1 less the standard deviation of a position across the edge divided by that along it: zero at an ideal
/// corner, nearly 1 on a straight line.
///
/// The ratio of the variances is `1 + ALONG^2 (l1 / l2 - 1)` with the eigenvalues `l1 >= l2` of the window's structure
/// tensor, less its mean gradient. For Lucas-Kanade flow with white noise it would be `l1 / l2`.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Edge([i8; 2]);

impl Edge {
    /// From the gradients of a window of `pixels` px.
    pub(crate) fn of(sums: &GradientSums, pixels: usize) -> Self {
        let [xx, xy, yy] = sums.centred(pixels);
        let (mean, half) = (0.5 * (xx + yy), 0.5 * (xx - yy));
        let spread = (half * half + xy * xy).sqrt();
        let (largest, smallest) = (mean + spread, (mean - spread).max(0.0));
        // The direction across the edge: the eigenvector of the largest eigenvalue.
        let (x, y) = if half >= 0.0 {
            (spread + half, xy)
        } else {
            (xy, spread - half)
        };
        let norm = (x * x + y * y).sqrt();
        if norm <= 0.0 {
            return Self::default();
        }
        let across_by_along = (smallest / (smallest + ALONG * ALONG * (largest - smallest))).sqrt();
        let scale = UNIT * (1.0 - across_by_along).sqrt() / norm;
        // Towards zero, so that the length stays at most 1.
        Self([-y, x].map(|v| (v * scale) as i8))
    }

    /// From the bytes of a map file.
    #[must_use]
    pub fn from_bytes(bytes: [u8; 2]) -> Self {
        Self(bytes.map(|b| i8::from_le_bytes([b])))
    }

    /// For a map file.
    #[must_use]
    pub fn to_bytes(self) -> [u8; 2] {
        self.0.map(|v| v.to_le_bytes()[0])
    }

    /// The direction along the edge; its squared length is 1 less the ratio of the deviations.
    #[must_use]
    pub fn vector(self) -> [f64; 2] {
        self.0.map(|v| f64::from(v) / UNIT)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    /// Sums of a window of one pixel with eigenvalues `l1 >= l2`, where the edge runs at this angle, rad.
    fn sums(angle: f64, [l1, l2]: [f64; 2]) -> GradientSums {
        let (s, c) = libm::sincos(angle);
        let number = |v: f64| v.round() as i32;
        GradientSums {
            xx: number(l1 * s * s + l2 * c * c),
            xy: number((l2 - l1) * s * c),
            yy: number(l1 * c * c + l2 * s * s),
            x: 0,
            y: 0,
        }
    }

    proptest! {
        /// The vector is parallel to the edge, and its length follows the law.
        #[test]
        fn vector_lies_along_the_edge(angle in 0.0..3.1_f64, l2 in 1.0e5..1.0e6_f64, ratio in 1.5..500.0_f64) {
            let e = Edge::of(&sums(angle, [l2 * ratio, l2]), 1).vector();
            let along = 1.0 / (1.0 + ALONG * ALONG * (ratio - 1.0)).sqrt();
            prop_assert!((e[0] * e[0] + e[1] * e[1] - (1.0 - along)).abs() < 0.03, "{e:?} {along}");
            let (s, c) = libm::sincos(angle);
            prop_assert!((e[0] * s - e[1] * c).abs() < 0.01, "{e:?}");
        }
    }

    #[test]
    fn corner_and_blank_window_have_no_edge() {
        assert_eq!(Edge::of(&sums(0.3, [1e5, 1e5]), 1), Edge::default());
        assert_eq!(Edge::of(&GradientSums::default(), 225), Edge::default());
    }

    #[test]
    fn straight_line_is_uncertain_along_itself_alone() {
        let e = Edge::of(&sums(0.0, [1e6, 0.0]), 1).vector();
        assert_eq!(e.map(f64::abs), [1.0, 0.0]);
    }

    #[test]
    fn mean_gradient_is_no_edge() {
        // A ramp: the same gradient in all of four pixels.
        let ramp = GradientSums {
            xx: 400,
            xy: 0,
            yy: 0,
            x: 40,
            y: 0,
        };
        assert_eq!(Edge::of(&ramp, 4), Edge::default());
    }

    #[test]
    fn bytes_round_trip() {
        for bytes in [[0, 0], [127, 129], [3, 255]] {
            assert_eq!(Edge::from_bytes(bytes).to_bytes(), bytes);
        }
    }
}
