//! Configuration of the flow.

use serde::{Deserialize, Serialize};

/// Configuration of [`crate::Flow`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FlowConfig {
    /// Radius of the square window, px of each scale, 2..=7: the side is `2 radius + 1`. On real frames 7 finds 3 %
    /// more points than 5, with a third fewer errors above a pixel, and a row still fits a vector.
    pub radius: usize,
    /// Number of scales, 1..=16. Four reach motions of about 20 px.
    pub levels: usize,
    /// The scales are every `level_step`-th level of the pyramid, 1..=8; beyond its end, halves of the last one follow.
    /// Two levels of 1.45 make about a half, which the window bridges.
    pub level_step: usize,
    /// Maximum number of steps per scale, 1..=100. Three to five are usual; above ten the search oscillates.
    pub iterations: usize,
    /// A step shorter than this ends the search at level 0, px, above 0. Below 0.02 px noise dominates.
    pub epsilon: f32,
    /// Maximum distance between a point and its return from the current image, px, above 0. Halving it costs 2 % of the
    /// points and hardly improves the rest.
    pub forward_backward: f32,
    /// Maximum mean absolute difference of both windows, grey levels, above 0. On real frames 12 loses 4 % more points
    /// than 18, mainly in motion blur, and 30 keeps 1 % more, worse ones.
    pub max_residual: f32,
    /// Minimum eigenvalue of the window's mean gradient product, (grey levels / px)^2, at least 0. Below it, the window
    /// has no texture in some direction, and the position along it follows the noise: with noise of 2 grey levels a
    /// value of 1 leaves 0.13 px.
    pub min_eigenvalue: f32,
    /// Maximum error of a guess, px, at least 0: the search starts at the finest scale on which that is half a radius.
    /// Up to 3.5 px that is level 0, which takes less than half of the time. Points that this misses fall back to all
    /// scales.
    pub guess_error: f32,
}

impl Default for FlowConfig {
    fn default() -> Self {
        Self {
            radius: 7,
            levels: 4,
            level_step: 2,
            iterations: 10,
            epsilon: 0.02,
            forward_backward: 0.5,
            max_residual: 18.0,
            min_eigenvalue: 1.0,
            guess_error: 3.0,
        }
    }
}

impl FlowConfig {
    /// Every value out of range, as `field: expected, found`.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let mut count = |value: usize, field: &str, low: usize, high: usize| {
            if !(low..=high).contains(&value) {
                problems.push(format!("{field}: expected {low} to {high}, found {value}"));
            }
        };
        count(self.radius, "radius", 2, 7);
        count(self.levels, "levels", 1, 16);
        count(self.level_step, "level_step", 1, 8);
        count(self.iterations, "iterations", 1, 100);
        let mut positive = |value: f32, field: &str, zero: bool| {
            if !(value > 0.0 || zero && value == 0.0) {
                let expected = if zero { "at least 0" } else { "above 0" };
                problems.push(format!("{field}: expected {expected}, found {value}"));
            }
        };
        positive(self.epsilon, "epsilon", false);
        positive(self.forward_backward, "forward_backward", false);
        positive(self.max_residual, "max_residual", false);
        positive(self.min_eigenvalue, "min_eigenvalue", true);
        positive(self.guess_error, "guess_error", true);
        problems
    }
}
