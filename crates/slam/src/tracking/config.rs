//! How poses are tracked.

use crate::config::Checker;
use serde::{Deserialize, Serialize};

/// How poses are tracked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingConfig {
    /// A pose counts as measured with at least this many inliers. Range: 10 to 1000. Fewer agree by chance.
    pub min_inliers: usize,
    /// A map begins with a frame of at least this many features with depth. Range: 20 to 10000.
    pub min_initial_points: usize,
    /// Radius of the search around the prediction from the last frame, px on level 0. Range: 2 to 100.
    pub motion_radius: f64,
    /// Factor on the radius (2.5 or 4 px) of the search for local landmarks. Range: 0.5 to 10.
    pub local_radius: f64,
}

impl Default for TrackingConfig {
    fn default() -> Self {
        Self {
            min_inliers: 30,
            min_initial_points: 100,
            motion_radius: 15.0,
            local_radius: 2.0,
        }
    }
}

impl TrackingConfig {
    pub(crate) fn check(&self, c: &mut Checker<'_>) {
        c.range("min_inliers", self.min_inliers as f64, 10.0, 1e3);
        c.range(
            "min_initial_points",
            self.min_initial_points as f64,
            20.0,
            1e4,
        );
        c.range("motion_radius", self.motion_radius, 2.0, 100.0);
        c.range("local_radius", self.local_radius, 0.5, 10.0);
    }
}
