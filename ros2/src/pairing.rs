//! Pairing of colour and depth images, by the device's stamps.
//!
//! A pair is returned when no later image can be closer: at once if stamps are closer than half the frame interval, else with the next
//! image. Streams may lose images, be late, or restart with another clock.

use std::collections::VecDeque;

/// Maximum number of waiting images per stream.
const WAITING: usize = 10;
/// Intervals for estimating the frame interval.
const INTERVALS: usize = 8;
/// An image this far behind the last pair was not late: the clock was set back, s.
const SET_BACK: f64 = 0.5;

/// One of the two streams.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Stream {
    /// Colour images.
    Colour,
    /// Depth images.
    Depth,
}

/// Two images of one frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Pair<T> {
    /// Stamp (s) and image.
    pub colour: (f64, T),
    /// Stamp (s) and image.
    pub depth: (f64, T),
}

/// Result of adding an image.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Taken {
    /// It waits for its partner, or has found it.
    Kept,
    /// It arrived after a later image that was already used.
    Late,
    /// The clock was set back: waiting images were dropped.
    SetBack,
}

/// Images waiting for their partners.
#[derive(Debug)]
pub struct Pairing<T> {
    max_dt: f64,
    colour: VecDeque<(f64, T)>,
    depth: VecDeque<(f64, T)>,
    /// Of colour images, s.
    intervals: VecDeque<f64>,
    last_colour: Option<f64>,
    last: Option<[f64; 2]>,
    /// Numbers of images without a partner.
    alone: [u64; 2],
}

impl<T> Pairing<T> {
    /// `max_dt`: maximum time difference of a pair, s.
    #[must_use]
    pub fn new(max_dt: f64) -> Self {
        Self {
            max_dt,
            colour: VecDeque::new(),
            depth: VecDeque::new(),
            intervals: VecDeque::new(),
            last_colour: None,
            last: None,
            alone: [0; 2],
        }
    }

    /// Numbers of colour and depth images without a partner.
    #[must_use]
    pub fn alone(&self) -> [u64; 2] {
        self.alone
    }

    /// Adds an image with its stamp, s.
    pub fn take(&mut self, stream: Stream, stamp: f64, image: T) -> Taken {
        let mut taken = Taken::Kept;
        let newest = self.last.map(|[colour, depth]| match stream {
            Stream::Colour => colour,
            Stream::Depth => depth,
        });
        if let Some(newest) = newest
            && stamp <= newest
        {
            if newest - stamp < SET_BACK {
                self.alone[stream as usize] += 1;
                return Taken::Late;
            }
            self.forget();
            taken = Taken::SetBack;
        }
        if stream == Stream::Colour {
            self.note_interval(stamp);
        }
        let (queue, alone) = match stream {
            Stream::Colour => (&mut self.colour, &mut self.alone[0]),
            Stream::Depth => (&mut self.depth, &mut self.alone[1]),
        };
        // Datagrams may arrive out of order.
        let at = queue.partition_point(|(s, _)| *s < stamp);
        if queue.get(at).is_some_and(|(s, _)| *s == stamp) {
            return taken;
        }
        queue.insert(at, (stamp, image));
        if queue.len() > WAITING {
            queue.pop_front();
            *alone += 1;
        }
        taken
    }

    fn note_interval(&mut self, stamp: f64) {
        if let Some(last) = self.last_colour
            && stamp > last
        {
            self.intervals.push_back(stamp - last);
            if self.intervals.len() > INTERVALS {
                self.intervals.pop_front();
            }
        }
        self.last_colour = Some(stamp);
    }

    /// No later image can be closer than this, s; zero while the frame interval is unknown. Slightly above half the median interval, since
    /// stamps jitter, and waiting delays by a frame.
    fn near(&self) -> f64 {
        let mut sorted: Vec<f64> = self.intervals.iter().copied().collect();
        sorted.sort_by(f64::total_cmp);
        0.55 * sorted.get(sorted.len() / 2).copied().unwrap_or(0.0)
    }

    /// Drops waiting images: the camera restarted.
    pub fn forget(&mut self) {
        self.alone[0] += self.colour.len() as u64;
        self.alone[1] += self.depth.len() as u64;
        self.colour.clear();
        self.depth.clear();
        self.intervals.clear();
        self.last_colour = None;
        self.last = None;
    }

    /// The next pair, if it is final.
    pub fn next_pair(&mut self) -> Option<Pair<T>> {
        loop {
            let c = self.colour.front()?.0;
            let mut near: Vec<usize> = (0..self.depth.len()).collect();
            near.sort_by(|a, b| self.gap(c, *a).total_cmp(&self.gap(c, *b)));
            let nearest = *near.first()?;
            if self.gap(c, nearest) > self.max_dt {
                self.give_up(c, nearest);
                continue;
            }
            near.retain(|at| self.gap(c, *at) <= self.max_dt && !self.is_the_next_ones(c, *at));
            let Some(at) = near.first().copied() else {
                self.colour.pop_front();
                self.alone[0] += 1;
                continue;
            };
            if !self.is_decided(c, at) {
                return None;
            }
            return self.give(at);
        }
    }

    fn gap(&self, colour: f64, depth: usize) -> f64 {
        (self.depth[depth].0 - colour).abs()
    }

    /// Whether a depth image is closer to the next colour image than to this one.
    fn is_the_next_ones(&self, colour: f64, depth: usize) -> bool {
        let next = self.colour.get(1);
        next.is_some_and(|next| self.gap(next.0, depth) < self.gap(colour, depth))
    }

    /// Whether no later image can be closer to either.
    fn is_decided(&self, colour: f64, at: usize) -> bool {
        let depth = self.depth[at].0;
        self.gap(colour, at) <= self.near()
            || (depth < colour && self.depth.len() > at + 1)
            || (colour < depth && self.colour.len() > 1)
    }

    /// Drops the older of two images that are too far apart.
    fn give_up(&mut self, colour: f64, depth: usize) {
        if self.depth[depth].0 < colour {
            self.depth.drain(..=depth);
            self.alone[1] += depth as u64 + 1;
        } else {
            self.colour.pop_front();
            self.alone[0] += 1;
        }
    }

    fn give(&mut self, at: usize) -> Option<Pair<T>> {
        self.alone[1] += at as u64;
        self.depth.drain(..at);
        let pair = Pair {
            colour: self.colour.pop_front()?,
            depth: self.depth.pop_front()?,
        };
        self.last = Some([pair.colour.0, pair.depth.0]);
        Some(pair)
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use Stream::{Colour, Depth};
    use proptest::prelude::*;

    /// The pairs of images in order of arrival, each (stream, stamp in ms).
    fn pairs(max_dt: f64, images: &[(Stream, i32)]) -> Vec<(i32, i32)> {
        let mut pairing = Pairing::new(max_dt);
        let mut found = Vec::new();
        for (stream, ms) in images {
            pairing.take(*stream, f64::from(*ms) / 1e3, *ms);
            while let Some(pair) = pairing.next_pair() {
                found.push((pair.colour.1, pair.depth.1));
            }
        }
        found
    }

    #[test]
    fn equal_stamps_are_paired_at_once() {
        let images = [(Colour, 0), (Depth, 0), (Depth, 33), (Colour, 33)];
        assert_eq!(pairs(0.02, &images), [(0, 0), (33, 33)]);
    }

    #[test]
    fn nearest_image_becomes_the_partner() {
        // Depth lags by 12 ms of 33.
        let images = [
            (Colour, 0),
            (Depth, 12),
            (Colour, 33),
            (Depth, 45),
            (Colour, 66),
            (Depth, 78),
        ];
        assert_eq!(pairs(0.02, &images), [(0, 12), (33, 45), (66, 78)]);
        // Depth at 20 belongs to colour at 33, which decides at its arrival.
        let images = [
            (Colour, 0),
            (Depth, 20),
            (Colour, 33),
            (Depth, 53),
            (Colour, 66),
        ];
        assert_eq!(pairs(0.02, &images), [(33, 20), (66, 53)]);
        let images = [
            (Colour, 0),
            (Depth, 16),
            (Colour, 33),
            (Depth, 49),
            (Colour, 66),
        ];
        assert_eq!(pairs(0.01, &images), []);
    }

    #[test]
    fn next_nearest_image_is_paired_if_the_nearest_is_taken() {
        // From freiburg1_xyz: depth is irregular, and its second image is closer to the third colour image.
        let images = [
            (Colour, 975),
            (Depth, 962),
            (Depth, 994),
            (Colour, 1011),
            (Depth, 1028),
            (Colour, 1043),
            (Depth, 1062),
            (Colour, 1075),
        ];
        assert_eq!(
            pairs(0.02, &images),
            [(975, 962), (1011, 994), (1043, 1028), (1075, 1062)]
        );
    }

    #[test]
    fn bad_images_cost_only_their_own_frame() {
        let images = [
            (Colour, 0),
            (Depth, 0),
            (Colour, 33),
            (Colour, 66),
            (Depth, 66),
            (Depth, 33),
            (Colour, 66),
            (Colour, 100),
            (Depth, 133),
            (Colour, 133),
        ];
        assert_eq!(pairs(0.02, &images), [(0, 0), (66, 66), (133, 133)]);
    }

    #[test]
    fn clock_reset_restarts_the_pairing() {
        let mut pairing = Pairing::new(0.02);
        for stream in [Colour, Depth] {
            assert_eq!(pairing.take(stream, 1000.0, ()), Taken::Kept);
        }
        assert!(pairing.next_pair().is_some());
        assert_eq!(pairing.take(Colour, 999.9, ()), Taken::Late);
        assert_eq!(pairing.take(Colour, 5.0, ()), Taken::SetBack);
        assert_eq!(pairing.take(Depth, 5.0, ()), Taken::Kept);
        assert_eq!(pairing.next_pair().map(|p| p.colour.0), Some(5.0));
    }

    proptest! {
        #[test]
        fn pairs_are_unique_and_close_in_time(images in prop::collection::vec((any::<bool>(), 0..2000_i32), 0..200)) {
            let images: Vec<(Stream, i32)> = images.into_iter().map(|(c, ms)| (if c { Colour } else { Depth }, ms)).collect();
            let mut pairing = Pairing::new(0.02);
            let (mut taken, mut given) = (0, 0);
            let mut last: Option<(f64, f64)> = None;
            for (stream, ms) in &images {
                let became = pairing.take(*stream, f64::from(*ms) / 1e3, ());
                taken += 1;
                if became == Taken::SetBack {
                    last = None;
                }
                while let Some(pair) = pairing.next_pair() {
                    let (c, d) = (pair.colour.0, pair.depth.0);
                    prop_assert!((c - d).abs() <= 0.02 + 1e-12);
                    prop_assert!(last.is_none_or(|(lc, ld)| c > lc && d > ld));
                    last = Some((c, d));
                    given += 1;
                }
                prop_assert!(pairing.colour.len() <= WAITING && pairing.depth.len() <= WAITING);
            }
            prop_assert!(2 * given <= taken);
        }

        #[test]
        fn equal_rate_streams_give_every_frame(lag in -13..=13_i32, jitter in prop::collection::vec(-1..=1_i32, 60)) {
            let mut images: Vec<(Stream, i32)> = (0..30).map(|i| (Colour, 1000 + 33 * i + jitter[i as usize])).collect();
            images.extend((0..30).map(|i| (Depth, 1000 + 33 * i + lag + jitter[30 + i as usize])));
            images.sort_by_key(|i| i.1);
            let found = pairs(0.02, &images);
            // The last image waits for one that never comes.
            prop_assert!(found.len() >= 29, "{found:?}");
            for (c, d) in found {
                prop_assert!((d - c - lag).abs() <= 2);
            }
        }
    }
}
