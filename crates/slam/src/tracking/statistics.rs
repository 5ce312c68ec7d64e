//! How often landmarks were expected, found and seen through since the last keyframe.

use super::matching::Matches;
use super::sight::Sight;
use crate::messages::LandmarkStatistic;
use std::collections::BTreeMap;
use stillpoint_map::LandmarkId;

/// Counts per landmark that was expected at least once.
#[derive(Debug, Default)]
pub(super) struct Statistics(BTreeMap<LandmarkId, LandmarkStatistic>);

impl Statistics {
    /// Notes how a landmark looked that was expected in the frame.
    pub(super) fn expected(&mut self, id: LandmarkId, sight: Sight) {
        let s = self.of(id);
        match sight {
            // Of the landmarks that look hidden most are wrong, at the edge of something near: they must prove themselves
            // like all others.
            Sight::Open | Sight::Hidden => s.visible += 1,
            Sight::Through => s.gone += 1,
        }
    }

    /// Notes the landmarks whose matches agree with the pose.
    pub(super) fn found(&mut self, matches: &Matches) {
        for id in matches.targets.iter().flatten().filter_map(|t| t.landmark) {
            self.of(id).found += 1;
        }
    }

    /// Hands over all counts, by id, and begins anew.
    pub(super) fn take(&mut self) -> Vec<LandmarkStatistic> {
        std::mem::take(&mut self.0).into_values().collect()
    }

    fn of(&mut self, id: LandmarkId) -> &mut LandmarkStatistic {
        self.0.entry(id).or_insert(LandmarkStatistic {
            id,
            visible: 0,
            found: 0,
            gone: 0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn counts_are_by_landmark_and_begin_anew() {
        let mut statistics = Statistics::default();
        for (id, sight) in [
            (7, Sight::Open),
            (3, Sight::Through),
            (7, Sight::Hidden),
            (7, Sight::Through),
        ] {
            statistics.expected(LandmarkId(id), sight);
        }
        let counts = |s: &LandmarkStatistic| (s.id.0, s.visible, s.found, s.gone);
        let taken: Vec<_> = statistics.take().iter().map(counts).collect();
        assert_eq!(taken, [(3, 0, 0, 1), (7, 2, 0, 1)]);
        assert!(statistics.take().is_empty());
    }
}
