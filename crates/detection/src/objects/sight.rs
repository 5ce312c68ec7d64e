//! Whether an object that was not detected is hidden, gone, or only missed.

use super::track::{Body, Track};
use super::view::View;
use crate::BoundingBox;
use stillpoint_imaging::CoarseDepth;

/// Share of the middle of a box that an object covers at least where it is.
const LEAST_SUPPORT: f64 = 0.2;
/// Share of it that must lie behind for the object to be gone and not hidden.
const SEEN_THROUGH: f64 = 0.5;
/// Fewer cells with depth say nothing.
const LEAST_CELLS: usize = 6;
/// Share of a box within the image below which what is left of it is out of sight: it is about to leave, or has left.
const IN_VIEW: f64 = 0.3;
/// How long an object is followed behind others, s: the time that two people need to pass. After that it is looked for where it went in.
const HIDDEN_SECONDS: f64 = 1.0;

impl Track {
    /// What the depth image says of an object that was not detected: absent where its place is seen and something else is there. Of a place with little depth
    /// nothing is known.
    pub(super) fn look(&mut self, view: &View, depth: &CoarseDepth) {
        let seen = match &self.body {
            Body::Spatial(s) => s.project(view).and_then(|p| {
                let bounds = view.raw(&p.sides);
                self.leaves = view.inside(&p.sides) < IN_VIEW;
                let sigma = s.depth_variance(&p).max(0.0).sqrt().min(0.5);
                let margin = 0.25 + sigma;
                let range = [p.z - self.reach[0] - margin, p.z + self.reach[1] + margin];
                support(depth, &bounds, range)
            }),
            Body::Planar(_) => None,
        };
        match seen {
            Some([_, own, behind]) if own < LEAST_SUPPORT && behind >= SEEN_THROUGH => {
                self.absent += 1;
                self.hidden = true;
            }
            Some([_, own, _]) => {
                self.absent = 0;
                self.hidden = own < LEAST_SUPPORT;
            }
            None => {}
        }
    }

    /// Whether it is out of sight: hidden, or gone from where it was.
    pub(super) fn out_of_sight(&self, stamp: f64) -> bool {
        self.hidden && stamp - self.last_seen > HIDDEN_SECONDS
    }
}

/// Shares of the cells with depth, in the middle of a box, that lie before, in and behind a range of depth (m); `None` where few have one.
fn support(depth: &CoarseDepth, bounds: &BoundingBox, [near, far]: [f64; 2]) -> Option<[f64; 3]> {
    let found = super::depth::central_depths(depth, bounds);
    let share = |test: &dyn Fn(f64) -> bool| {
        found.iter().filter(|z| test(**z)).count() as f64 / found.len() as f64
    };
    let (before, behind) = (share(&|z| z < near), share(&|z| z > far));
    (found.len() >= LEAST_CELLS).then_some([before, 1.0 - before - behind, behind])
}
