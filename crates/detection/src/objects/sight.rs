//! Decides whether an undetected object is hidden, gone, or only missed.

use super::common::{HALF, PART};
use super::duplicates::SAME_DEPTH;
use super::profile::LEAST_CELLS;
use super::track::{Body, Track};
use super::view::View;
use crate::BoundingBox;
use stillpoint_imaging::CoarseDepth;

/// Maximum time for which an object is tracked behind others, s: the time that two people need to pass (section 14 of
/// docs/algorithm.md). Afterwards it is expected where it disappeared.
const HIDDEN_SECONDS: f64 = 1.0;

impl Track {
    /// Evaluates the depth image for an undetected object: absent if its position is visible and shows something else.
    /// Positions with little depth are undecided.
    pub(super) fn look(&mut self, view: &View, depth: &CoarseDepth) {
        let seen = match &self.body {
            Body::Spatial(s) => s.project(view).and_then(|p| {
                let bounds = view.raw(&p.sides);
                self.leaves = view.inside(&p.sides) < PART;
                let sigma = s.depth_variance(&p).max(0.0).sqrt().min(0.5);
                let margin = SAME_DEPTH + sigma;
                let range = [p.z - self.reach[0] - margin, p.z + self.reach[1] + margin];
                support(depth, &bounds, range)
            }),
            Body::Planar(_) => None,
        };
        match seen {
            Some([_, own, behind]) if own < PART && behind >= HALF => {
                self.absent += 1;
                self.hidden = true;
            }
            Some([_, own, _]) => {
                self.absent = 0;
                self.hidden = own < PART;
            }
            None => {}
        }
        self.shows = seen.is_some_and(|[_, own, _]| own >= HALF);
    }

    /// Whether it is out of sight: hidden, or gone from its position.
    pub(super) fn out_of_sight(&self, stamp: f64) -> bool {
        self.hidden && stamp - self.last_seen > HIDDEN_SECONDS
    }
}

/// Shares of the cells with depth, in the middle of a box, before, in and behind a depth range (m); `None` if there are
/// few.
fn support(depth: &CoarseDepth, bounds: &BoundingBox, [near, far]: [f64; 2]) -> Option<[f64; 3]> {
    let found = super::depth::central_depths(depth, bounds);
    let share = |test: &dyn Fn(f64) -> bool| {
        found.iter().filter(|z| test(**z)).count() as f64 / found.len() as f64
    };
    let (before, behind) = (share(&|z| z < near), share(&|z| z > far));
    (found.len() >= LEAST_CELLS).then_some([before, 1.0 - before - behind, behind])
}
