//! Measurements of a detection: the free sides of its box, and the surfaces in it.

use super::depth::{DepthMode, modes};
use super::kalman::{Row, Vec8};
use super::view::{Sides, View};
use crate::Detection;
use stillpoint_geometry::Vec2;
use stillpoint_imaging::CoarseDepth;

#[derive(Clone, Debug)]
pub(super) struct Measurement {
    pub(super) detection: Detection,
    /// Sides of the box, undistorted px.
    pub(super) sides: Sides,
    /// Sides at the image border, or where a person in front hides the object: it extends beyond them.
    pub(super) cut: [bool; 4],
    /// Whether any side is at the image border.
    pub(super) at_border: bool,
    pub(super) modes: Vec<DepthMode>,
    /// Through the middle of the object's own surface, if its whole width is visible.
    pub(super) middle: Option<Plumb>,
}

/// The image of a vertical line, undistorted px.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Plumb {
    pub(super) through: Vec2,
    /// Shift to the right per pixel down.
    pub(super) lean: f64,
}

/// Maximum distance from the border of a box that touches it, as a share of the image's width: networks end their boxes
/// some pixels short of it (section 14 of docs/algorithm.md).
const BORDER: f64 = 0.01;
/// Standard deviation of the middle of a person's surface as a share of the box's width: the trunk sways less than arms
/// and legs swing. Measured: 0.05 is no different.
const MIDDLE_SIGMA: f64 = 0.04;
/// Minimum standard deviation of a side, px: a pixel of the 416 that a small network sees is 1.5 of 640.
const LEAST_SIGMA: f64 = 1.5;

impl Measurement {
    /// `None` when the box is not finite or has no area in the image.
    pub(super) fn new(view: &View, detection: &Detection, depth: &CoarseDepth) -> Option<Self> {
        let (width, height) = (view.camera.width as usize, view.camera.height as usize);
        let b = detection.bounds;
        if ![b.x0, b.y0, b.x1, b.y1].iter().all(|x| x.is_finite()) {
            return None;
        }
        let bounds = b.clipped(width, height);
        if bounds.width() < 1.0 || bounds.height() < 1.0 {
            return None;
        }
        let margin = BORDER * width as f64;
        let (w, h) = (width as f64 - 0.5, height as f64 - 0.5);
        let cut = [
            bounds.x0 < margin - 0.5,
            bounds.y0 < margin - 0.5,
            bounds.x1 > w - margin,
            bounds.y1 > h - margin,
        ];
        Some(Self {
            detection: Detection {
                bounds,
                ..*detection
            },
            sides: view.undistorted(&bounds),
            cut,
            at_border: cut.contains(&true),
            modes: modes(depth, &bounds),
            middle: None,
        })
    }

    /// Width and height, undistorted px.
    pub(super) fn size(&self) -> [f64; 2] {
        [
            (self.sides[2] - self.sides[0]).max(1.0),
            (self.sides[3] - self.sides[1]).max(1.0),
        ]
    }

    /// Measurement rows of the free sides, and of sides at the border that are predicted inside the image, since the
    /// object extends at least to the border.
    pub(super) fn side_rows(
        &self,
        predicted: &Sides,
        jacobians: &[Vec8; 4],
        share: f64,
    ) -> Vec<Row> {
        let mut rows = Vec::with_capacity(6);
        for i in 0..4 {
            let residual = self.sides[i] - predicted[i];
            let inside = if i < 2 {
                residual < 0.0
            } else {
                residual > 0.0
            };
            if self.cut[i] && !inside {
                continue;
            }
            rows.push(Row {
                jacobian: jacobians[i],
                residual,
                variance: self.side_variance(i % 2, predicted, share),
            });
        }
        if let Some(Plumb { through, lean }) = self.middle {
            let sigma = (MIDDLE_SIGMA * (predicted[2] - predicted[0])).max(LEAST_SIGMA);
            let middle = |axis: usize| (predicted[axis] + predicted[axis + 2]) * 0.5;
            let jacobian = |axis: usize| (jacobians[axis] + jacobians[axis + 2]) * 0.5;
            rows.push(Row {
                jacobian: jacobian(0) - jacobian(1) * lean,
                residual: through.x + lean * (middle(1) - through.y) - middle(0),
                variance: sigma * sigma,
            });
        }
        rows
    }

    /// Variance of the sides along an axis of the image (0: left and right, 1: top and bottom), px^2.
    pub(super) fn side_variance(&self, axis: usize, predicted: &Sides, share: f64) -> f64 {
        let size = self.size()[axis].max(predicted[axis + 2] - predicted[axis]);
        let sigma = (share * size).max(LEAST_SIGMA);
        sigma * sigma
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::{BoundingBox, ClassId};
    use stillpoint_geometry::Camera;

    fn measure([x0, y0, x1, y1]: [f64; 4]) -> Option<Measurement> {
        let camera = Camera::pinhole(640, 480, [500.0, 500.0, 319.5, 239.5]);
        let view = View::ahead(&camera);
        let detection = Detection {
            class: ClassId::PERSON,
            score: 0.5,
            bounds: BoundingBox { x0, y0, x1, y1 },
        };
        Measurement::new(&view, &detection, &CoarseDepth::default())
    }

    #[test]
    fn invalid_boxes_give_no_measurement() {
        assert!(measure([f64::NAN, 0.0, 10.0, 10.0]).is_none());
        assert!(measure([0.0, 0.0, f64::INFINITY, 10.0]).is_none());
        assert!(measure([20.0, 0.0, 10.0, 10.0]).is_none());
        assert!(measure([-50.0, 0.0, -10.0, 10.0]).is_none());
        assert!(measure([10.0, 10.0, 50.0, 90.0]).is_some());
    }

    #[test]
    fn sides_at_the_image_border_constrain_one_direction() {
        let rows = |m: &Measurement, predicted: Sides| {
            m.side_rows(&predicted, &[Vec8::zeros(); 4], 0.1)
                .iter()
                .map(|r| r.residual)
                .collect::<Vec<_>>()
        };
        let free = measure([100.0, 100.0, 200.0, 300.0]).unwrap();
        assert_eq!(free.cut, [false; 4]);
        assert_eq!(
            rows(&free, [90.0, 90.0, 210.0, 310.0]),
            [10.0, 10.0, -10.0, -10.0]
        );
        let cut = measure([-5.0, 100.0, 200.0, 478.0]).unwrap();
        assert_eq!(cut.cut, [true, false, false, true]);
        assert_eq!(rows(&cut, [-60.0, 100.0, 200.0, 600.0]), [0.0, 0.0]);
        let pulled = rows(&cut, [20.5, 100.0, 200.0, 400.0]);
        assert_eq!(pulled, [-21.0, 0.0, 0.0, 78.0]);
    }

    #[test]
    fn box_noise_grows_with_its_size() {
        let variance = |b| {
            let m = measure(b).unwrap();
            m.side_rows(&m.sides, &[Vec8::zeros(); 4], 0.1)[0].variance
        };
        assert!((variance([100.0, 100.0, 200.0, 300.0]) - 100.0).abs() < 1e-9);
        assert!((variance([100.0, 100.0, 102.0, 300.0]) - LEAST_SIGMA * LEAST_SIGMA).abs() < 1e-9);
    }
}
