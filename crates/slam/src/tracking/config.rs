//! How poses are tracked.

use crate::validation::Checker;
use serde::{Deserialize, Serialize};

/// How poses are tracked.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(default, deny_unknown_fields)]
pub struct TrackingConfig {
    /// A pose counts as measured with at least this many inliers. Range: 10 to 1000. Fewer agree by chance.
    pub min_inliers: usize,
    /// A map begins with a frame of at least this many features with depth. Range: 20 to 10000.
    pub min_initial_points: usize,
    /// A camera that was lost is found again with at least this many inliers. Range: 10 to 1000. More than for tracking, as nothing
    /// else is known.
    pub min_relocalisation_inliers: usize,
    /// A new piece of map is begun after so many frames that show enough and nothing that is known. Range: 1 to 100000. Frames of
    /// a covered lens do not count.
    pub new_piece_after: u32,
    /// Radius of the search around the prediction from the last frame, px on level 0. Range: 2 to 100.
    pub motion_radius: f64,
    /// Factor on the radius (2.5 or 4 px) of the search for local landmarks. Range: 0.5 to 10.
    pub local_radius: f64,
}

impl Default for TrackingConfig {
    fn default() -> Self {
        // The numbers of inliers and the radius around the prediction are those of ORB-SLAM2 (Mur-Artal, Tardos 2017).
        Self {
            min_inliers: 30,
            min_initial_points: 100,
            min_relocalisation_inliers: 50,
            new_piece_after: 30,
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
        c.range(
            "min_relocalisation_inliers",
            self.min_relocalisation_inliers as f64,
            10.0,
            1e3,
        );
        c.range("new_piece_after", f64::from(self.new_piece_after), 1.0, 1e5);
        c.range("motion_radius", self.motion_radius, 2.0, 100.0);
        c.range("local_radius", self.local_radius, 0.5, 10.0);
    }
}
