//! Alignment of one window at one level: displacement and change of brightness between two images.

use crate::Edge;
use stillpoint_imaging::{GrayImage, Simd};

use super::{
    FlowConfig,
    patch::{DifferenceSums, GradientSums, Template, WindowPlace},
};

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) enum Outcome<T> {
    Found(T),
    /// The search diverged, or its result is rejected: another start may do better.
    Lost,
    /// The window is at the border or has no texture: no start can help.
    Untrackable,
}

impl<T> Outcome<T> {
    pub(crate) fn found(self) -> Option<T> {
        match self {
            Self::Found(value) => Some(value),
            Self::Lost | Self::Untrackable => None,
        }
    }
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Start {
    /// Predicted centre of the window, px of the level.
    pub(crate) position: [f32; 2],
    /// Predicted brightness change, grey levels.
    pub(crate) brightness: f32,
    /// A step shorter than this ends the search, px.
    pub(crate) epsilon: f32,
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Aligned {
    /// Centre of the window, px of the level.
    pub(crate) position: [f32; 2],
    /// Brightness change, grey levels.
    pub(crate) brightness: f32,
    /// Remaining mean absolute difference, grey levels.
    pub(crate) residual: f32,
    /// Of the window of the first image.
    pub(crate) gradients: GradientSums,
}

#[derive(Clone, Debug)]
pub(crate) struct Aligner {
    template: Template,
    iterations: usize,
    min_eigenvalue: f64,
    simd: Simd,
}

impl Aligner {
    pub(crate) fn new(config: &FlowConfig, simd: Simd) -> Self {
        Self {
            template: Template::new(config.radius),
            iterations: config.iterations,
            min_eigenvalue: f64::from(config.min_eigenvalue),
            simd,
        }
    }

    /// The edge in a window with these gradients.
    pub(crate) fn edge(&self, gradients: &GradientSums) -> Edge {
        Edge::of(gradients, self.template.side * self.template.side)
    }

    /// Moves the window of the second image from `start` until it matches that around `point` (px) of the first.
    ///
    /// Gauss-Newton with the constant gradients of the first image, so that a step costs one comparison of both
    /// windows.
    pub(crate) fn align(
        &mut self,
        (first, second): (&GrayImage, &GrayImage),
        point: [f32; 2],
        start: Start,
    ) -> Outcome<Aligned> {
        let side = self.template.side;
        let Some(place) = WindowPlace::new(first, point[0], point[1], side) else {
            return Outcome::Untrackable;
        };
        let sums = self.template.sample(first, place, self.simd);
        let Some(normal) = Normal::new(&sums, side * side, self.min_eigenvalue) else {
            return Outcome::Untrackable;
        };
        let epsilon = f64::from(start.epsilon) * f64::from(start.epsilon);
        let mut position = start.position;
        let mut offset = offset_of(f64::from(start.brightness) * 64.0);
        let mut residual = f32::INFINITY;
        let mut last = [0.0; 2];
        for _ in 0..self.iterations {
            let Some(place) = WindowPlace::new(second, position[0], position[1], side) else {
                return Outcome::Lost;
            };
            let found = self.template.compare(second, place, offset, self.simd);
            let (step, brighter) = normal.step(&found);
            position = [position[0] + step[0] as f32, position[1] + step[1] as f32];
            offset = offset_of(f64::from(offset) + brighter);
            residual = found.abs_e as f32 / (16 * side * side) as f32;
            let length = |v: [f64; 2]| v[0] * v[0] + v[1] * v[1];
            if length(step) < epsilon {
                break;
            }
            // A step that reverses the previous one oscillates: take the middle.
            if length([step[0] + last[0], step[1] + last[1]]) < epsilon {
                position[0] -= 0.5 * step[0] as f32;
                position[1] -= 0.5 * step[1] as f32;
                break;
            }
            last = step;
            let run = [
                position[0] - start.position[0],
                position[1] - start.position[1],
            ];
            // More than a window away, nothing of the start's surroundings is left in view.
            if run[0] * run[0] + run[1] * run[1] > (side * side) as f32 {
                return Outcome::Lost;
            }
        }
        Outcome::Found(Aligned {
            position,
            brightness: f32::from(offset) / 64.0,
            residual,
            gradients: sums,
        })
    }
}

/// A brightness in 1/64 grey level, in the range of the kernels.
fn offset_of(value: f64) -> i16 {
    value.clamp(-16320.0, 16320.0) as i16
}

/// Inverse normal equations of displacement and brightness.
struct Normal {
    /// xx, xy and yy of the inverse, for differences in 1/16 grey level and gradients in 1/8 grey level per px.
    inverse: [f64; 3],
    /// Mean gradient, same unit.
    mean: [f64; 2],
    /// 1 / number of pixels.
    weight: f64,
}

impl Normal {
    /// `None` if the smallest eigenvalue of the mean product of the gradients (less their mean) is not above
    /// `min_eigenvalue`, (grey levels / px)^2.
    fn new(sums: &GradientSums, count: usize, min_eigenvalue: f64) -> Option<Self> {
        let weight = 1.0 / count as f64;
        let (x, y) = (f64::from(sums.x), f64::from(sums.y));
        let [xx, xy, yy] = sums.centred(count);
        let half_spread = 0.5 * ((xx - yy) * (xx - yy) + 4.0 * xy * xy).sqrt();
        let smallest = 0.5 * (xx + yy) - half_spread;
        let determinant = xx * yy - xy * xy;
        // Gradients are in 1/8, so their products in 1/64.
        if smallest * weight <= 64.0 * min_eigenvalue || determinant <= 0.0 {
            return None;
        }
        // A gradient in 1/8 times a step in px is half of a difference in 1/16.
        let factor = 0.5 / determinant;
        Some(Self {
            inverse: [yy * factor, -xy * factor, xx * factor],
            mean: [x * weight, y * weight],
            weight,
        })
    }

    /// The step, px, and the brightness correction, 1/64 grey level.
    fn step(&self, sums: &DifferenceSums) -> ([f64; 2], f64) {
        let e = f64::from(sums.e);
        let bx = f64::from(sums.gx_e) - self.mean[0] * e;
        let by = f64::from(sums.gy_e) - self.mean[1] * e;
        let [xx, xy, yy] = self.inverse;
        let step = [-(xx * bx + xy * by), -(xy * bx + yy * by)];
        let tilt = 2.0 * (self.mean[0] * step[0] + self.mean[1] * step[1]);
        (step, 4.0 * (e * self.weight + tilt))
    }
}
