//! Searches the features of an image in the last one.

use crate::static_filter::FlowPair;
use stillpoint_features::{Flow, FlowConfig, FlowMatch, Keypoint};
use stillpoint_geometry::{Camera, Vec2};
use stillpoint_imaging::{Pyramid, Simd};

/// Every n-th feature is searched at all scales. Chosen: a median of 100 is as steady as one of 125, and more take more
/// time (decision 55).
const SCOUT: usize = 10;

/// A feature index and its predicted raw pixel.
pub(super) type Guess = (usize, [f32; 2]);

/// Two images, and the features of the newer one.
pub(super) struct FlowImages<'a> {
    pub(super) camera: &'a Camera,
    pub(super) keypoints: &'a [Keypoint],
    /// Undistorted pixels of `keypoints`.
    pub(super) undistorted: &'a [Vec2],
    pub(super) now: &'a Pyramid,
    pub(super) before: &'a Pyramid,
}

/// Optical flow, with its memory.
pub(super) struct FlowSearch {
    flow: Flow,
    sought: Vec<Guess>,
    points: Vec<[f32; 2]>,
    expected: Vec<[f32; 2]>,
    found: Vec<Option<FlowMatch>>,
    off: Vec<f32>,
}

#[derive(Clone, Copy)]
enum Reach {
    /// All scales.
    Far,
    /// Finest scale only: within half a window.
    Near,
}

impl FlowSearch {
    pub(super) fn new(simd: Simd) -> Self {
        Self {
            flow: Flow::new(FlowConfig::default(), simd),
            sought: Vec::new(),
            points: Vec::new(),
            expected: Vec::new(),
            found: Vec::new(),
            off: Vec::new(),
        }
    }

    /// Searches features in the last image. A hand accelerates, so all static predictions are off by about the same.
    /// Every [`SCOUT`]th feature is searched at all scales to measure that offset; the others are searched near their
    /// predictions, with and without it.
    pub(super) fn search(
        &mut self,
        images: &FlowImages<'_>,
        guesses: &[Guess],
        pairs: &mut [Option<FlowPair>],
    ) {
        let _span = tracing::info_span!("flow").entered();
        self.sought.clear();
        self.sought.extend(guesses.iter().step_by(SCOUT));
        self.find(images, Reach::Far, pairs);
        let [x, y] = self.median_offset();
        let others = guesses.chunks(SCOUT).flat_map(|guesses| &guesses[1..]);
        self.sought.clear();
        let corrected = others.clone().map(|(i, at)| (*i, [at[0] + x, at[1] + y]));
        self.sought.extend(corrected);
        self.find(images, Reach::Near, pairs);
        self.sought.clear();
        let lost = others.filter(|(i, _)| pairs[*i].is_none());
        self.sought.extend(lost);
        self.find(images, Reach::Near, pairs);
    }

    /// Searches the pending features and stores the pairs found.
    fn find(&mut self, images: &FlowImages<'_>, reach: Reach, pairs: &mut [Option<FlowPair>]) {
        self.look_up(images, reach);
        for ((i, _), found) in self.sought.iter().zip(&self.found) {
            pairs[*i] = found.map(|f| pair(images, *i, &f));
        }
    }

    /// Searches the pending features in the last image.
    fn look_up(&mut self, images: &FlowImages<'_>, reach: Reach) {
        let point = |(i, _): &Guess| [images.keypoints[*i].x, images.keypoints[*i].y];
        self.points.clear();
        self.points.extend(self.sought.iter().map(point));
        self.expected.clear();
        self.expected.extend(self.sought.iter().map(|(_, at)| *at));
        let (now, before) = (images.now, images.before);
        let (points, expected, found) = (&self.points, &self.expected, &mut self.found);
        match reach {
            Reach::Far => self.flow.track(now, before, points, Some(expected), found),
            Reach::Near => self.flow.look(now, before, points, expected, found),
        }
    }

    /// Median offset of found features from their predictions, px; zero if none was found.
    fn median_offset(&mut self) -> [f32; 2] {
        [0, 1].map(|k| {
            let found = self.expected.iter().zip(&self.found);
            let off = found.filter_map(|(at, found)| Some(found.as_ref()?.position[k] - at[k]));
            self.off.clear();
            self.off.extend(off);
            let middle = self.off.len() / 2;
            if self.off.is_empty() {
                return 0.0;
            }
            *self.off.select_nth_unstable_by(middle, f32::total_cmp).1
        })
    }
}

/// The pair of a feature, with both ends as exposed.
fn pair(images: &FlowImages<'_>, feature: usize, found: &FlowMatch) -> FlowPair {
    let before = images
        .camera
        .undistort(found.position.map(f64::from).into());
    FlowPair {
        before_raw: found.position,
        before_exposed: before,
        before,
        now: images.undistorted[feature],
        flow_sigma: flow_sigma(f64::from(found.forward_backward)),
        shutter_sigma: 0.0,
        edge: found.edge.vector().into(),
    }
}

/// Standard deviation of a flow vector, px, from its forward-backward error. In blurred images, with few gradients,
/// both grow alike.
fn flow_sigma(forward_backward: f64) -> f64 {
    0.08 + 0.85 * libm::sqrt(forward_backward)
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_features::Edge;

    #[test]
    fn predictions_are_corrected_by_the_median_offset() {
        let found = |x| {
            Some(FlowMatch {
                position: [x, -1.0],
                residual: 0.0,
                forward_backward: 0.0,
                edge: Edge::default(),
            })
        };
        let mut search = FlowSearch::new(Simd::Scalar);
        search.expected = vec![[10.0, 0.0]; 5];
        // One feature lies on a walking person; one is not found.
        search.found = vec![found(12.0), None, found(12.5), found(40.0), found(11.5)];
        assert_eq!(search.median_offset(), [2.5, -1.0]);
        search.found.clear();
        assert_eq!(search.median_offset(), [0.0; 2]);
    }
}
