//! How often landmarks were expected, found and seen through since the last keyframe.

use super::sight::Sight;
use crate::association::Matches;
use crate::messages::LandmarkStatistic;
use std::collections::BTreeMap;
use stillpoint_map::LandmarkId;

/// Counts per landmark that was expected at least once.
#[derive(Debug, Default)]
pub(super) struct Statistics {
    counts: BTreeMap<LandmarkId, LandmarkStatistic>,
}

/// What was seen of landmarks in one frame, from a pose that may still be refused.
#[derive(Clone, Debug, Default)]
pub(super) struct Sightings(Vec<(LandmarkId, Seen)>);

/// What was seen of a landmark.
#[derive(Clone, Copy, Debug)]
enum Seen {
    Expected(Sight),
    Found,
}

impl Sightings {
    /// Whether nothing was seen of any landmark: the map does not bear the pose out.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Notes how a landmark looked that was expected in the frame.
    pub(super) fn expected(&mut self, id: LandmarkId, sight: Sight) {
        self.0.push((id, Seen::Expected(sight)));
    }

    /// Notes the landmarks whose matches agree with the pose.
    pub(super) fn found(&mut self, matches: &Matches) {
        let ids = matches.targets.iter().flatten().filter_map(|t| t.landmark);
        self.0.extend(ids.map(|id| (id, Seen::Found)));
    }
}

impl Statistics {
    /// Counts what was seen from a pose that is taken, in a frame of this [`worth`].
    pub(super) fn count(&mut self, sightings: Sightings, worth: f32) {
        for (id, seen) in sightings.0 {
            let s = self.of(id);
            match seen {
                // Of the landmarks that look hidden most are wrong, at the edge of something near: they must prove themselves
                // like all others.
                Seen::Expected(Sight::Open | Sight::Hidden) => s.visible += 1,
                Seen::Expected(Sight::Through) => {
                    s.gone += 1;
                    s.gone_worth += worth;
                }
                Seen::Found => {
                    s.found += 1;
                    s.found_worth += worth;
                }
            }
        }
    }

    /// Hands over all counts, by id, and starts over.
    pub(super) fn take(&mut self) -> Vec<LandmarkStatistic> {
        std::mem::take(&mut self.counts).into_values().collect()
    }

    fn of(&mut self, id: LandmarkId) -> &mut LandmarkStatistic {
        self.counts.entry(id).or_insert(LandmarkStatistic {
            id,
            visible: 0,
            found: 0,
            gone: 0,
            found_worth: 0.0,
            gone_worth: 0.0,
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pace::worth;

    #[test]
    fn a_second_of_looking_is_a_second_at_any_rate() {
        for rate in [10.0, 15.0, 30.0, 60.0, 120.0, 200.0] {
            let mut statistics = Statistics::default();
            for _ in 0..rate as usize {
                let mut sightings = Sightings::default();
                sightings.expected(LandmarkId(1), Sight::Through);
                statistics.count(sightings, worth(Some(1.0 / rate)));
            }
            let seen = statistics.take()[0];
            assert_eq!(seen.gone, rate as u32);
            assert!((seen.gone_worth - 30.0).abs() < 1e-3, "{rate} Hz");
        }
    }

    #[test]
    fn counts_are_by_landmark_and_start_over() {
        let mut statistics = Statistics::default();
        for (id, sight) in [
            (7, Sight::Open),
            (3, Sight::Through),
            (7, Sight::Hidden),
            (7, Sight::Through),
        ] {
            let mut sightings = Sightings::default();
            sightings.expected(LandmarkId(id), sight);
            statistics.count(sightings, 1.0);
        }
        let counts = |s: &LandmarkStatistic| (s.id.0, s.visible, s.found, s.gone);
        let taken: Vec<_> = statistics.take().iter().map(counts).collect();
        assert_eq!(taken, [(3, 0, 0, 1), (7, 2, 0, 1)]);
        assert!(statistics.take().is_empty());
    }
}
