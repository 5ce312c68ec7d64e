//! Configuration of the object tracker.

use serde::{Deserialize, Serialize};

/// Configuration of [`crate::ObjectTracker`].
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields, default)]
pub struct ObjectsConfig {
    /// Time for which a confirmed object is kept without a detection, s, 0.1..=10. Small networks miss a walking person
    /// for up to 25 frames of 30 per second; beyond 1.5 s the prediction says little.
    pub coast_seconds: f64,
    /// Time for which an object detected only once is kept, s, 0..=10, and for at least two missed detections. A tenth
    /// of a second keeps a walker detected in every third frame of 30 per second, and does not prolong masks of false
    /// alarms; slightly less allows for the frames' jitter.
    pub tentative_seconds: f64,
    /// Expected acceleration of objects, m/s^2, 0.05..=20: the change of velocity in a second. 1 is a person who walks,
    /// turns and stops.
    pub acceleration: f64,
    /// Standard deviation of a side of a detected box as a share of the box's size, 0.005..=0.5. Boxes of small
    /// networks jitter by some hundredths, and limbs swing: of 0.06, 0.1 and 0.15, 0.1 confuses simulated and real
    /// walkers least.
    pub side_sigma: f64,
    /// Minimum share of an object's features that agree with a static scene for it to count as static, above 0.6 up
    /// to 1. The rigid test accepts 95 % of static features; some of the box is background.
    pub parked_share: f64,
    /// Time for which an object must be static to be parked, s, 0.1..=60. A walker who turns round is static for about
    /// a second.
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
    /// All values out of range, as `field: expected, found`; empty if there are none.
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
