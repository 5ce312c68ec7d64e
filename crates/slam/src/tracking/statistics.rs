//! Counts how often landmarks were predicted, found and seen through since the last keyframe.

use super::sight::Sight;
use crate::association::Matches;
use crate::messages::LandmarkStatistic;
use crate::recycle::Lists;
use stillpoint_map::LandmarkId;

/// Counts per landmark that was predicted at least once.
#[derive(Debug, Default)]
pub(super) struct Statistics {
    counts: Vec<LandmarkStatistic>,
    /// Hash table with linear probing of indices into `counts`, from 1; 0 if free. Its size, a power of two and at
    /// least twice that of `counts`, depends only on the landmarks seen between two keyframes.
    places: Vec<u32>,
}

/// Observations of landmarks in one frame, from a pose that may still be rejected.
#[derive(Clone, Debug, Default)]
pub(super) struct Sightings(Vec<Sighting>);

pub(super) type Sighting = (LandmarkId, Seen);

#[derive(Clone, Copy, Debug)]
pub(super) enum Seen {
    Expected(Sight),
    Found,
}

impl Sightings {
    /// An empty list in recycled memory.
    pub(super) fn new(memory: &mut Lists<Sighting>) -> Self {
        Self(memory.take())
    }

    /// Whether there are no observations: the map does not confirm the pose.
    pub(super) fn is_empty(&self) -> bool {
        self.0.is_empty()
    }

    /// Adds the visibility of a predicted landmark.
    pub(super) fn expected(&mut self, id: LandmarkId, sight: Sight) {
        self.0.push((id, Seen::Expected(sight)));
    }

    /// Adds the landmarks of inlier matches.
    pub(super) fn found(&mut self, matches: &Matches) {
        let ids = matches.targets.iter().flatten().filter_map(|t| t.landmark);
        self.0.extend(ids.map(|id| (id, Seen::Found)));
    }
}

impl Statistics {
    /// Counts observations from an accepted pose, in a frame of weight [`worth`]. Returns the list's memory.
    pub(super) fn count(&mut self, sightings: Sightings, worth: f32) -> Vec<Sighting> {
        for &(id, seen) in &sightings.0 {
            let s = self.of(id);
            match seen {
                // Landmarks that appear occluded are mostly wrong ones near foreground edges: they are not exempt.
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

    /// Returns all counts, sorted by id, and resets.
    pub(super) fn take(&mut self) -> Vec<LandmarkStatistic> {
        self.places.fill(0);
        let mut counts = self.counts.clone();
        self.counts.clear();
        counts.sort_unstable_by_key(|s| s.id);
        counts
    }

    fn of(&mut self, id: LandmarkId) -> &mut LandmarkStatistic {
        if 2 * self.counts.len() >= self.places.len() {
            self.make_room();
        }
        let at = self.find(id);
        if self.places[at] == 0 {
            self.counts.push(LandmarkStatistic {
                id,
                visible: 0,
                found: 0,
                gone: 0,
                found_worth: 0.0,
                gone_worth: 0.0,
            });
            self.places[at] = self.counts.len() as u32;
        }
        &mut self.counts[self.places[at] as usize - 1]
    }

    /// Slot of a landmark, or the free slot for it: half of all are free.
    fn find(&self, id: LandmarkId) -> usize {
        let mut at = self.home(id);
        while let Some(count) = self.places[at].checked_sub(1)
            && self.counts[count as usize].id != id
        {
            at = (at + 1) % self.places.len();
        }
        at
    }

    /// First slot to probe: scatters consecutive ids (Knuth, TAOCP 3, 6.4).
    fn home(&self, id: LandmarkId) -> usize {
        let scattered = id.number().wrapping_mul(0x9e37_79b1);
        ((u64::from(scattered) * self.places.len() as u64) >> 32) as usize
    }

    fn make_room(&mut self) {
        let count = (2 * self.places.len()).max(512);
        self.places.clear();
        self.places.resize(count, 0);
        for i in 0..self.counts.len() {
            let at = self.find(self.counts[i].id);
            self.places[at] = i as u32 + 1;
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::pace::worth;

    #[test]
    fn weighted_counts_are_independent_of_frame_rate() {
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
    fn many_landmarks_are_counted_separately() {
        let mut statistics = Statistics::default();
        for round in 0..3 {
            // Neighbouring ids, and ids with the same first slot.
            let id = |i: u32| LandmarkId::new(if i.is_multiple_of(2) { i } else { i << 20 | i });
            let count = 3000 * (round + 1);
            for i in (0..count).chain(0..count / 2) {
                let mut sightings = Sightings::default();
                sightings.expected(id(i), Sight::Open);
                statistics.count(sightings, 1.0);
            }
            let taken = statistics.take();
            assert_eq!(taken.len(), count as usize);
            assert!(taken.windows(2).all(|w| w[0].id < w[1].id));
            for i in 0..count {
                let at = taken.binary_search_by_key(&id(i), |s| s.id).unwrap();
                assert_eq!(taken[at].visible, 1 + u32::from(i < count / 2));
            }
        }
    }

    #[test]
    fn counts_are_per_landmark_and_reset_when_taken() {
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
