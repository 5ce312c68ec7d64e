//! How often landmarks were expected, found and seen through since the last keyframe.

use super::sight::Sight;
use crate::association::Matches;
use crate::messages::LandmarkStatistic;
use crate::recycle::Lists;
use stillpoint_map::LandmarkId;

/// Counts per landmark that was expected at least once.
#[derive(Debug, Default)]
pub(super) struct Statistics {
    counts: Vec<LandmarkStatistic>,
    /// Per landmark, the number of its place in `counts`, from 1; 0 for none.
    places: Vec<u32>,
}

/// What was seen of landmarks in one frame, from a pose that may still be refused.
#[derive(Clone, Debug, Default)]
pub(super) struct Sightings(Vec<Sighting>);

/// What was seen of one landmark.
pub(super) type Sighting = (LandmarkId, Seen);

/// What was seen of a landmark.
#[derive(Clone, Copy, Debug)]
pub(super) enum Seen {
    Expected(Sight),
    Found,
}

impl Sightings {
    /// None yet, in the memory of a list.
    pub(super) fn new(memory: &mut Lists<Sighting>) -> Self {
        Self(memory.take())
    }

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
    /// Counts what was seen from a pose that is taken, in a frame of this [`worth`]. Gives back the memory of the list.
    pub(super) fn count(&mut self, sightings: Sightings, worth: f32) -> Vec<Sighting> {
        for &(id, seen) in &sightings.0 {
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
        sightings.0
    }

    /// Hands over all counts, by id, and starts over.
    pub(super) fn take(&mut self) -> Vec<LandmarkStatistic> {
        for s in &self.counts {
            self.places[s.id.index()] = 0;
        }
        let mut counts = self.counts.clone();
        self.counts.clear();
        counts.sort_unstable_by_key(|s| s.id);
        counts
    }

    fn of(&mut self, id: LandmarkId) -> &mut LandmarkStatistic {
        if self.places.len() <= id.index() {
            self.places.resize(id.index() + 1, 0);
        }
        let place = &mut self.places[id.index()];
        if *place == 0 {
            self.counts.push(LandmarkStatistic {
                id,
                visible: 0,
                found: 0,
                gone: 0,
                found_worth: 0.0,
                gone_worth: 0.0,
            });
            *place = self.counts.len() as u32;
        }
        &mut self.counts[*place as usize - 1]
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
                sightings.expected(LandmarkId::new(1), Sight::Through);
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
            sightings.expected(LandmarkId::new(id), sight);
            statistics.count(sightings, 1.0);
        }
        let counts = |s: &LandmarkStatistic| (s.id.number(), s.visible, s.found, s.gone);
        let taken: Vec<_> = statistics.take().iter().map(counts).collect();
        assert_eq!(taken, [(3, 0, 0, 1), (7, 2, 0, 1)]);
        assert!(statistics.take().is_empty());
    }
}
