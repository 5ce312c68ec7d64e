//! Configuration of the object tracker.

use serde::{Deserialize, Serialize};

/// Configuration of [`crate::ObjectTracker`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectsConfig {
    /// How long a confirmed object lives on without a detection, s, 0.1..=10. Small networks miss a walking person for up to 25 frames of 30 per
    /// second; beyond 1.5 s the prediction says little.
    pub coast_seconds: f64,
    /// How long an object is kept that was seen only once, s, 0..=10, and for two missed detections at least. A tenth of a second keeps a walker who is
    /// found in every third frame of 30 per second, and lets a false alarm mask no longer; a little less leaves room for the frames' jitter.
    pub tentative_seconds: f64,
    /// Acceleration that objects are expected to have, m/s^2, 0.05..=20: what a velocity changes by in a second. 1 is a person who walks, turns and stops.
    pub acceleration: f64,
    /// Standard deviation of a side of a detected box as a share of the box's size, 0.005..=0.5. Boxes of small networks jitter by some hundredths,
    /// and limbs swing: of 0.06, 0.1 and 0.15, 0.1 confuses simulated and real walkers least.
    pub side_sigma: f64,
    /// Share of an object's features that must agree with a static scene for it to count as standing still, above 0.6 up to 1. The rigid test accepts 95 % of
    /// static features; some of the box is background.
    pub parked_share: f64,
    /// How long an object must stand still to be parked, s, 0.1..=60. A walker who turns round stands still for about a second.
    pub parked_seconds: f64,
}

impl Default for ObjectsConfig {
    fn default() -> Self {
        Self {
            coast_seconds: 1.5,
            tentative_seconds: 0.09,
            acceleration: 1.0,
            side_sigma: 0.1,
            parked_share: 0.8,
            parked_seconds: 2.0,
        }
    }
}

impl ObjectsConfig {
    /// Every value out of range, as `field: expected, found`; empty when all is well.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        let mut problems = Vec::new();
        let mut check = |field: &str, value: f64, low: f64, high: f64| {
            if !(low..=high).contains(&value) {
                problems.push(format!("{field}: expected {low} to {high}, found {value}"));
            }
        };
        check("coast_seconds", self.coast_seconds, 0.1, 10.0);
        check("tentative_seconds", self.tentative_seconds, 0.0, 10.0);
        check("acceleration", self.acceleration, 0.05, 20.0);
        check("side_sigma", self.side_sigma, 0.005, 0.5);
        check("parked_share", self.parked_share, 0.6, 1.0);
        check("parked_seconds", self.parked_seconds, 0.1, 60.0);
        problems
    }
}
