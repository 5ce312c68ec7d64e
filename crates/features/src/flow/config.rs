//! What the flow can be told.

use serde::{Deserialize, Serialize};

/// Configuration of [`crate::Flow`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct FlowConfig {
    /// Radius of the square window, px of each level, 2..=7: the side is `2 radius + 1`.
    pub radius: usize,
    /// How many levels of the pyramid are used at most, 1..=16, from level 0 on in steps of `level_step`.
    pub levels: usize,
    /// Distance of the levels used, 1..=8. Three levels of 1.2 are a factor of 1.73, which the window's reach bridges.
    pub level_step: usize,
    /// Steps per level at most, 1..=100.
    pub iterations: usize,
    /// A step shorter than this ends a level, px of the level, above 0.
    pub epsilon: f32,
    /// Largest distance between a point and its return from the current image, px, above 0.
    pub forward_backward: f32,
    /// Largest mean absolute difference of both windows, grey levels, above 0.
    pub max_residual: f32,
    /// Smallest eigenvalue of the window's mean gradient product, (grey levels / px)^2, at least 0. Below, the window has no texture across some
    /// direction, and the position along it would follow the noise.
    pub min_eigenvalue: f32,
    /// How far a guess may be from the truth, px, at least 0. It decides from which level the search starts.
    pub guess_error: f32,
}

impl Default for FlowConfig {
    fn default() -> Self {
        Self {
            radius: 7,
            levels: 4,
            level_step: 4,
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
    /// Every value out of range, as `field: expected, found`; empty when all is well.
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
