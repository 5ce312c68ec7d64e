//! Association of estimated poses with ground truth.

use crate::TimedPose;

/// Maximum difference between the stamps of a pair, s.
pub const DEFAULT_MAX_DT: f64 = 0.02;

/// Pairs of indices `(reference, estimate)`: each pose of the shorter trajectory (the estimate if equal) is paired with the pose of the
/// other one that is nearest in time, if within `max_dt` (s); the earlier of two equally near ones. A pose of the longer trajectory may be
/// used twice. As in evo. Stamps must ascend.
#[must_use]
pub fn associate(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    max_dt: f64,
) -> Vec<(usize, usize)> {
    let match_all = |short: &[TimedPose], long: &[TimedPose]| {
        short
            .iter()
            .enumerate()
            .filter_map(|(i, p)| Some((i, nearest(long, p.stamp, max_dt)?)))
            .collect::<Vec<_>>()
    };
    if estimate.len() > reference.len() {
        match_all(reference, estimate)
    } else {
        let pairs = match_all(estimate, reference);
        pairs.into_iter().map(|(e, r)| (r, e)).collect()
    }
}

/// Index of the pose nearest to `stamp`, the earlier of two, if within `max_dt`.
pub(crate) fn nearest(poses: &[TimedPose], stamp: f64, max_dt: f64) -> Option<usize> {
    let after = poses.partition_point(|p| p.stamp <= stamp);
    let dt = |k: usize| (poses[k].stamp - stamp).abs();
    let best = match (after.checked_sub(1), after < poses.len()) {
        (Some(before), true) if dt(after) < dt(before) => after,
        (Some(before), _) => before,
        (None, true) => after,
        (None, false) => return None,
    };
    (dt(best) <= max_dt).then_some(best)
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;
    use stillpoint_geometry::Se3;

    fn at(stamps: &[f64]) -> Vec<TimedPose> {
        stamps
            .iter()
            .map(|&stamp| TimedPose {
                stamp,
                world_from_camera: Se3::identity(),
            })
            .collect()
    }

    #[test]
    fn association_follows_the_shorter_trajectory() {
        let (r, e) = (at(&[0.0, 0.25, 1.0]), at(&[0.125, 0.25]));
        assert_eq!(associate(&r, &e, 0.2), [(0, 0), (1, 1)]);
        // Equal lengths: the estimate leads, and both its poses may take the same one.
        assert_eq!(
            associate(&at(&[0.0, 5.0]), &at(&[0.01, 0.02]), 0.02),
            [(0, 0), (0, 1)]
        );
        // The estimate is longer: the ground truth leads.
        assert_eq!(associate(&at(&[0.0]), &at(&[-0.02, 0.015]), 0.02), [(0, 1)]);
        assert_eq!(associate(&at(&[]), &at(&[1.0]), 0.02), []);
        assert_eq!(associate(&at(&[2.0]), &at(&[1.0]), 0.02), []);
    }

    proptest! {
        #[test]
        fn nearest_equals_linear_search(stamps in proptest::collection::btree_set(0u32..100, 1..30), t in 0u32..400) {
            let poses = at(&stamps.into_iter().map(f64::from).collect::<Vec<_>>());
            let t = f64::from(t) * 0.25;
            let mut best = 0;
            for (k, p) in poses.iter().enumerate() {
                if (p.stamp - t).abs() < (poses[best].stamp - t).abs() {
                    best = k;
                }
            }
            let expected = ((poses[best].stamp - t).abs() <= 2.0).then_some(best);
            prop_assert_eq!(nearest(&poses, t, 2.0), expected);
        }
    }
}
