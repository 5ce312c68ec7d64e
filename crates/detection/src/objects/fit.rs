//! Whether a detection may be of an object, and how well it fits.

use super::duplicates::overlap;
use super::kind::may_be_one;
use super::measurement::Measurement;
use super::track::{Body, Expected, Track};
use super::view::View;

/// How well a detection fits a track.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) struct Fit {
    /// Greater is better, about 0 to 2.
    pub(super) benefit: f64,
}

/// 99 % quantiles of chi-square for 0 to 5 degrees of freedom.
pub(super) const CHI2_99: [f64; 6] = [0.0, 6.635, 9.210, 11.345, 13.277, 15.086];
/// Share of the smaller of two boxes in the larger from which one that the border cuts may be the other, come in or gone out at once.
const GROWS: f64 = 0.7;
/// Detections for which what comes in at the border may turn out to be at another depth: what showed first was mostly the background.
const COMES_IN: u32 = 5;
/// Boxes that overlap so much are of one object even when the filter did not expect its change of shape or speed.
const SAME_BOX: f64 = 0.5;
/// The same where the depths agree: arms that stretch, and others who hide a part, change a box at once.
const SAME_BOX_SAME_DEPTH: f64 = 0.3;
/// The same where the depths contradict each other.
const SAME_BOX_OTHER_DEPTH: f64 = 0.6;

impl Track {
    /// How well a detection fits a track that is expected there; `None` when it is not of this object.
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
            _ if contradicts => SAME_BOX_OTHER_DEPTH,
            Some(_) => SAME_BOX_SAME_DEPTH,
            None => SAME_BOX,
        };
        // What another class is said of must be at the very place.
        let comes_in = self.fresh <= COMES_IN && self.cut;
        let at_border = m.cut.contains(&true)
            && (mode.is_some() || comes_in)
            && overlap(&expected.bounds, &m.detection.bounds) >= GROWS;
        let occluded = self.hidden && self.absent == 0;
        let allowed = if same_class {
            // Who is hidden is expected vaguely: a gate that wide takes false alarms for the person.
            iou >= least || at_border || (chi2 <= gate && !contradicts && !occluded)
        } else {
            iou >= SAME_BOX && !contradicts
        };
        let closeness = (1.0 - chi2 / gate.max(1.0)).max(0.0);
        let penalty = if contradicts { 0.5 } else { 0.0 } + if same_class { 0.0 } else { 0.3 };
        allowed.then_some(Fit {
            benefit: iou + 0.5 * closeness - penalty,
        })
    }
}
