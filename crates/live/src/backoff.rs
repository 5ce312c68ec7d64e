//! Limits the detector's share of the time when tracking does not keep up with the camera.

/// Number of consecutive frames that must be tracked before the detector's share is raised. Under constant overload, about one frame in
/// twice as many is dropped.
const CALM: u32 = 60;
/// Minimum share of the time for the detector: one part in this many.
const MOST_RARELY: u64 = 4;

/// Halves the detector's share of the time when a frame was dropped, and doubles it after a period without drops.
#[derive(Clone, Debug)]
pub(crate) struct Backoff {
    rarer: u64,
    calm: u32,
}

impl Default for Backoff {
    fn default() -> Self {
        Self { rarer: 1, calm: 0 }
    }
}

impl Backoff {
    /// Updates the share at each tracked frame, given whether others were dropped before it. Returns its reciprocal.
    pub(crate) fn observe(&mut self, dropped: bool) -> u64 {
        self.calm += 1;
        if dropped {
            self.rarer = (2 * self.rarer).min(MOST_RARELY);
            self.calm = 0;
        } else if self.calm == CALM {
            self.rarer = (self.rarer / 2).max(1);
            self.calm = 0;
        }
        self.rarer
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn backoff_rises_at_once_and_falls_slowly() {
        let mut backoff = Backoff::default();
        let rarer = [false, true, false, true, true].map(|dropped| backoff.observe(dropped));
        assert_eq!(rarer, [1, 2, 2, 4, MOST_RARELY]);
        let calm: Vec<u64> = (0..3 * CALM).map(|_| backoff.observe(false)).collect();
        let after = |times: u32| calm[(times * CALM) as usize - 1];
        assert_eq!([1, 2, 3].map(after), [2, 1, 1]);
        assert_eq!(calm[CALM as usize - 2], MOST_RARELY);
    }

    #[test]
    fn persistent_overload_drops_few_frames() {
        let mut backoff = Backoff::default();
        let (mut rarer, mut drops) = (1, 0);
        for _ in 0..100 * CALM {
            let dropped = rarer < MOST_RARELY;
            drops += u32::from(dropped);
            rarer = backoff.observe(dropped);
        }
        assert!((95..=105).contains(&drops), "{drops}");
    }
}
