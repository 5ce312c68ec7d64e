//! Joins separate samples of gyroscope and accelerometer into one sensor's.

use crate::library::Motion;
use std::collections::VecDeque;
use stillpoint_imaging::ImuSample;

/// Maximum wait of a rate for a later force, microseconds: after that the accelerometer has failed.
const PATIENCE_US: i64 = 50_000;
/// Maximum number of waiting samples: a second of the fastest.
const MOST: usize = 512;

#[derive(Debug, Default)]
pub(crate) struct Joined {
    rates: VecDeque<Motion>,
    forces: VecDeque<Motion>,
}

impl Joined {
    /// Adds a sample. Late ones are dropped.
    pub(crate) fn take(&mut self, motion: Motion) {
        let list = if motion.is_rate {
            &mut self.rates
        } else {
            &mut self.forces
        };
        if list
            .back()
            .is_some_and(|last| motion.stamp_us <= last.stamp_us)
        {
            return;
        }
        list.push_back(motion);
        if list.len() > MOST {
            list.pop_front();
        }
    }

    /// Rates with the forces at their times.
    pub(crate) fn joined(&mut self) -> Vec<ImuSample> {
        let mut all = Vec::new();
        let newest = self.rates.back().map_or(0, |m| m.stamp_us);
        while let Some(rate) = self.rates.front().copied() {
            let is_known = self
                .forces
                .back()
                .is_some_and(|f| f.stamp_us >= rate.stamp_us);
            if !is_known && newest - rate.stamp_us < PATIENCE_US {
                break;
            }
            self.rates.pop_front();
            // Keep the last force before the rate: the next rate may precede the next force.
            while self
                .forces
                .get(1)
                .is_some_and(|f| f.stamp_us <= rate.stamp_us)
            {
                self.forces.pop_front();
            }
            all.push(ImuSample {
                stamp: crate::source::seconds(rate.stamp_us),
                angular_rate: rate.value.map(f64::from),
                specific_force: self.force_at(rate.stamp_us),
            });
        }
        all
    }

    /// Interpolated force at a time; outside the range the nearest one, and zero if there is none.
    fn force_at(&self, stamp_us: i64) -> [f64; 3] {
        let Some(before) = self.forces.front() else {
            return [0.0; 3];
        };
        let Some(after) = self.forces.get(1) else {
            return before.value.map(f64::from);
        };
        let share = (stamp_us - before.stamp_us) as f64 / (after.stamp_us - before.stamp_us) as f64;
        let share = share.clamp(0.0, 1.0);
        std::array::from_fn(|i| {
            let (a, b) = (f64::from(before.value[i]), f64::from(after.value[i]));
            a + (b - a) * share
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn motion(is_rate: bool, stamp_us: i64, x: f32) -> Motion {
        Motion {
            is_rate,
            stamp_us,
            value: [x, 0.0, 0.0],
        }
    }

    #[test]
    fn forces_are_interpolated_to_the_rates() {
        let mut joined = Joined::default();
        joined.take(motion(false, 0, 1.0));
        for k in 0..4 {
            joined.take(motion(true, 2500 * k, 0.5));
        }
        // Only the first has a force at its time or after it.
        assert_eq!(joined.joined().len(), 1);
        joined.take(motion(false, 10_000, 5.0));
        let found = joined.joined();
        let forces: Vec<f64> = found.iter().map(|s| s.specific_force[0]).collect();
        assert_eq!(forces, [2.0, 3.0, 4.0]);
        assert_eq!(found[2].stamp, 0.0075);
        assert!(joined.joined().is_empty());
    }

    #[test]
    fn rates_are_released_without_an_accelerometer() {
        let mut joined = Joined::default();
        for k in 0..40 {
            joined.take(motion(true, 2500 * k, 0.5));
        }
        let found = joined.joined();
        assert!(found.len() >= 20, "{}", found.len());
        assert_eq!(found[0].specific_force, [0.0; 3]);
    }

    #[test]
    fn late_samples_are_dropped() {
        let mut joined = Joined::default();
        for stamp in [5000, 5000, 2500, 7500] {
            joined.take(motion(true, stamp, 0.5));
        }
        joined.take(motion(false, 9000, 1.0));
        let stamps: Vec<f64> = joined.joined().iter().map(|s| s.stamp).collect();
        assert_eq!(stamps, [0.005, 0.0075]);
    }
}
