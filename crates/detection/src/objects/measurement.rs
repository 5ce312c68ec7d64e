//! What a detection says about an object: the free sides of its box, and the surfaces in it.

use super::depth::{DepthMode, modes};
use super::kalman::{Row, Vec8};
use super::view::{Sides, View};
use crate::Detection;
use stillpoint_imaging::CoarseDepth;

/// A detection in the terms of the filters.
#[derive(Clone, Debug)]
pub(super) struct Measurement {
    pub(super) detection: Detection,
    /// Sides of the box, undistorted px.
    pub(super) sides: Sides,
    /// Which sides are at the border of the image: the object goes on beyond them.
    pub(super) cut: [bool; 4],
    /// Surfaces in the box, nearest first.
    pub(super) modes: Vec<DepthMode>,
}

/// A box this near to the border touches it, as a share of the image's width: networks end their boxes some pixels short of it.
const BORDER: f64 = 0.01;
/// A side is never known better than this, px.
const LEAST_SIGMA: f64 = 1.5;

impl Measurement {
    /// `None` when the box is not one: not finite, or without area in the image.
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
        Some(Self {
            detection: Detection {
                bounds,
                ..*detection
            },
            sides: view.undistorted(&bounds),
            cut: [
                bounds.x0 < margin - 0.5,
                bounds.y0 < margin - 0.5,
                bounds.x1 > w - margin,
                bounds.y1 > h - margin,
            ],
            modes: modes(depth, &bounds),
        })
    }

    /// Width and height, undistorted px.
    pub(super) fn size(&self) -> [f64; 2] {
        [
            (self.sides[2] - self.sides[0]).max(1.0),
            (self.sides[3] - self.sides[1]).max(1.0),
        ]
    }

    /// Rows of the sides: those that are free, and those at the border that the prediction puts inside the image, since the object reaches at least there.
    pub(super) fn side_rows(
        &self,
        predicted: &Sides,
        jacobians: &[Vec8; 4],
        share: f64,
    ) -> Vec<Row> {
        let mut rows = Vec::with_capacity(5);
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
            let axis = i % 2;
            let size = self.size()[axis].max(predicted[axis + 2] - predicted[axis]);
            let sigma = (share * size).max(LEAST_SIGMA);
            rows.push(Row {
                jacobian: jacobians[i],
                residual,
                variance: sigma * sigma,
            });
        }
        rows
    }
}
