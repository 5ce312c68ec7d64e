//! Counts keyframes that agree on a loop: a single motion may be a coincidence, even if it fits the map.

use super::drift::{Drift, distance, loop_covariance};
use crate::covariance::moved;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_map::{KeyframeId, LoopEdge, MapView};

/// 99.9 % quantile of chi-square with 6 degrees of freedom: gate on the distance between two motions of the same place.
const GATE: f64 = 22.457_744_484_825_35;

/// Number of keyframes whose motions agree with `edge`, each counted once, including the edge's own.
pub(super) fn agreeing(
    view: &MapView,
    drift: &Drift<'_>,
    edge: &LoopEdge,
    sightings: &[LoopEdge],
) -> usize {
    let nodes = &drift.nodes;
    let Some((a, b, measured)) = nodes.loop_between(view, edge) else {
        return 0;
    };
    let own = loop_covariance(&edge.information, &measured);
    let mut agree: Vec<KeyframeId> = sightings
        .iter()
        .filter(|s| s.new != edge.new)
        .filter(|s| {
            let Some((old, new, told)) = nodes.loop_between(view, s) else {
                return false;
            };
            let expected = nodes.motion(a, old) * told * nodes.motion(new, b);
            let covariance = combined(drift, (a, old), (new, b), s, &told, &expected);
            covariance.is_some_and(|c| distance(&measured, &expected, &(c + own)) <= GATE)
        })
        .map(|s| s.new)
        .collect();
    agree.sort_unstable();
    agree.dedup();
    agree.len() + 1
}

/// Covariance of the motion that another sighting predicts: of the path between the older keyframes, of the path
/// between the new ones, and of the sighting itself.
fn combined(
    drift: &Drift<'_>,
    (a, old): (u32, u32),
    (new, b): (u32, u32),
    sighting: &LoopEdge,
    told: &Se3,
    expected: &Se3,
) -> Option<Mat6> {
    let of_old = drift.between(a, old)?;
    let a_from_old = drift.motion(a, old);
    let own = moved(&loop_covariance(&sighting.information, told), &a_from_old);
    // Moves the left perturbation of `new_from_b` to the left of the whole chain.
    let a_from_new = *expected * drift.motion(new, b).inverse();
    let of_new = moved(&drift.between(new, b)?, &a_from_new);
    Some(of_old + own + of_new)
}

#[cfg(test)]
mod tests {
    #![allow(clippy::unwrap_used)] // A failed helper is a failed test.
    use super::super::nodes::Nodes;
    use super::super::tests::map;
    use super::*;
    use stillpoint_geometry::{Vec3, Vec6};
    use stillpoint_map::SubmapId;

    /// A sighting that puts the new keyframe `x` m to the right of the old one.
    fn sighting(old: u32, new: u32, x: f64) -> LoopEdge {
        LoopEdge {
            old: KeyframeId(old),
            new: KeyframeId(new),
            old_from_new: Se3::new(Default::default(), Vec3::new(x, 0.0, 0.0)),
            information: Mat6::from_diagonal(&Vec6::repeat(1e8)),
            inliers: 40,
        }
    }

    #[test]
    fn agreeing_keyframes_are_counted_once_each() {
        let map = map(12);
        let view = map.view();
        let nodes = Nodes::new(view, SubmapId(0), SubmapId(0));
        let drift = Drift::new(view, nodes, &[]);
        let count =
            |sightings: &[LoopEdge]| agreeing(view, &drift, &sighting(1, 10, 0.5), sightings);
        assert_eq!(count(&[]), 1);
        // The edge's own keyframe is not counted again.
        assert_eq!(count(&[sighting(1, 10, 0.5)]), 1);
        assert_eq!(count(&[sighting(1, 9, 0.5), sighting(2, 9, 0.5)]), 2);
        assert_eq!(count(&[sighting(1, 9, 0.5), sighting(2, 8, 0.5)]), 3);
        // Controls: another place, and one whose offset is within the uncertainty of the ties (5 cm each).
        assert_eq!(count(&[sighting(1, 9, 3.0), sighting(2, 8, -2.0)]), 1);
        assert_eq!(count(&[sighting(1, 9, 0.6), sighting(2, 8, 0.55)]), 3);
    }
}
