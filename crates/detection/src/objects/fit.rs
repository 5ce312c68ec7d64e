//! Gates and benefits of pairs of tracks and detections.

use super::common::{HALF, LOOKS, SAME_BOX};
use super::duplicates::overlap;
use super::expected::Expected;
use super::kind::may_be_one;
use super::measurement::Measurement;
use super::track::{Body, Track};
use super::view::View;

#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Higher is better, about 0 to 2.
    pub(super) benefit: f64,
}

/// 99 % quantiles of chi-square for 0 to 5 degrees of freedom.
pub(super) const CHI2_99: [f64; 6] = [0.0, 6.635, 9.210, 11.345, 13.277, 15.086];
/// Like [`SAME_BOX`] where the depths agree, a share: stretched arms and partial occlusion change a box at once.
/// Measured: 0.4, with 0.5 where they contradict, loses real people (IDF1 0.04 less).
const SAME_BOX_SAME_DEPTH: f64 = 0.3;

impl Track {
    /// Agreement of a detection with the prediction of this track; `None` when a gate fails.
    pub(super) fn fit(
        &self,
        view: &View,
        expected: &Expected,
        m: &Measurement,
        share: f64,
    ) -> Option<Fit> {
        let same_class = m.detection.class == self.class;
        if !may_be_one(m.detection.class, self.class) {
            return None;
        }
        let (chi2, rows, mode) = match &self.body {
            Body::Spatial(s) => {
                let p = expected.projection.as_ref()?;
                let mode = s.own_mode(p, &m.modes);
                let rows = s.rows(p, m, mode, share);
                (s.state.distance(&rows), rows, mode)
            }
            Body::Planar(p) => {
                let rows = p.rows(view, m, share);
                (p.state.distance(&rows), rows, None)
            }
        };
        let iou = expected.bounds.iou(&m.detection.bounds);
        let gate = CHI2_99[rows.len().min(5)];
        let contradicts =
            matches!(self.body, Body::Spatial(_)) && !m.modes.is_empty() && mode.is_none();
        let least = match mode {
            _ if contradicts => SAME_BOX,
            Some(_) => SAME_BOX_SAME_DEPTH,
            None => HALF,
        };
        // At first, the image border hides most of a person who enters, and the box shows background.
        let comes_in = self.fresh < 2 * LOOKS && self.cut;
        let (own, new) = (&expected.bounds, &m.detection.bounds);
        // Uncut boxes do not shrink at once, even if their sides are uncertain because they were cut before.
        let kept =
            |axis: usize, own: f64, new: f64| m.cut[axis] || m.cut[axis + 2] || new >= HALF * own;
        let kept = kept(0, own.width(), new.width()) && kept(1, own.height(), new.height());
        let inside = overlap(own, new);
        let at_border =
            m.cut.contains(&true) && kept && (mode.is_some() || comes_in) && inside >= SAME_BOX;
        // Detections with an unusually low score must match the predicted position: gates widen while detections are
        // missing, and would accept false alarms. At the image border low scores are normal.
        let doubtful = !m.at_border && self.votes.surer_than(f64::from(m.detection.score));
        let occluded = self.hidden && self.absent == 0;
        let allowed = if same_class {
            // The prediction of a hidden person is uncertain: wide gates would accept false alarms.
            iou >= least
                || at_border
                || (kept
                    && !doubtful
                    && chi2 <= gate
                    && !contradicts
                    && (!occluded || (mode.is_some() && inside >= HALF)))
        } else {
            // Detections of another class must match the position closely.
            iou >= HALF && !contradicts
        };
        let closeness = (1.0 - chi2 / gate.max(1.0)).max(0.0);
        let penalty = if contradicts { 0.5 } else { 0.0 } + if same_class { 0.0 } else { 0.3 };
        allowed.then_some(Fit {
            benefit: iou + 0.5 * closeness - penalty,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::super::ObjectId;
    use super::*;
    use crate::{BoundingBox, ClassId, Detection};
    use proptest::prelude::*;
    use stillpoint_geometry::Camera;
    use stillpoint_imaging::{CoarseDepth, DepthImage};

    fn detection([x0, y0, w, h]: [f64; 4]) -> Detection {
        Detection {
            class: ClassId::PERSON,
            score: 0.8,
            bounds: BoundingBox {
                x0,
                y0,
                x1: x0 + w,
                y1: y0 + h,
            },
        }
    }

    fn boxes() -> impl Strategy<Value = [f64; 4]> {
        let side = || 8.0..200.0_f64;
        (0.0..600.0_f64, 0.0..440.0_f64, side(), side()).prop_map(|(x, y, w, h)| [x, y, w, h])
    }

    proptest! {
        #![proptest_config(ProptestConfig::with_cases(2000))]

        /// Pairs rejected by the cheap test fail all gates, also at the image border and without depth.
        #[test]
        fn distant_boxes_fail_all_gates(a in boxes(), b in boxes(), has_depth in prop::bool::ANY, seconds in 0.0..1.0_f64) {
            let camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
            let view = View::ahead(&camera);
            let z = if has_depth { 2.0 } else { 0.0 };
            let depth = DepthImage::from_vec(640, 480, vec![z; 640 * 480]).unwrap();
            let depth = CoarseDepth::new(&depth, 8);
            let measured = |b| Measurement::new(&view, &detection(b), &depth);
            if let (Some(first), Some(m)) = (measured(a), measured(b)) {
                let mut track = Track::new(ObjectId(0), &view, &first, 0.0, 0.1);
                track.propagate(seconds, 1.0);
                let expected = track.expected(&view);
                if expected.is_far_from(&m, 0.1) {
                    prop_assert!(track.fit(&view, &expected, &m, 0.1).is_none());
                }
            }
        }
    }

    /// Whether a box of a person matches a track that was cut at the left border twice, with a box of `width` px from
    /// there.
    fn fits_after_border(width: f64, new: [f64; 4]) -> bool {
        let camera = Camera::pinhole(640, 480, [517.3, 516.5, 318.6, 255.3]);
        let view = View::ahead(&camera);
        let depth = DepthImage::from_vec(640, 480, vec![1.0; 640 * 480]).unwrap();
        let depth = CoarseDepth::new(&depth, 8);
        let measured = |b| Measurement::new(&view, &detection(b), &depth).unwrap();
        let mut track = Track::new(
            ObjectId(0),
            &view,
            &measured([0.0, 0.0, width, 480.0]),
            0.0,
            0.1,
        );
        track.absorb(&view, &measured([0.0, 0.0, width, 480.0]), 0.03, 0.1);
        track.propagate(0.5, 3.0);
        track
            .fit(&view, &track.expected(&view), &measured(new), 0.1)
            .is_some()
    }

    /// Sides cut by the border are uncertain, but a person does not shrink to a sliver in the middle of the image.
    #[test]
    fn person_does_not_shrink_below_half_unless_cut() {
        assert!(fits_after_border(300.0, [10.0, 0.0, 270.0, 480.0]));
        assert!(!fits_after_border(300.0, [140.0, 0.0, 20.0, 480.0]));
        assert!(
            fits_after_border(300.0, [0.0, 0.0, 130.0, 480.0]),
            "cut it may"
        );
    }
}
