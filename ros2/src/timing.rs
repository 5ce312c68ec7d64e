//! Latency from the last packet of an image to its odometry.

use std::collections::BTreeMap;
use std::sync::{Arc, Mutex, MutexGuard, PoisonError};
use std::time::{Duration, Instant};

/// Maximum number of frames in processing, including dropped ones.
const ON_THE_WAY: usize = 64;
/// Number of stored latencies: a minute of frames.
const REMEMBERED: usize = 1800;

/// Shared between image input and odometry output.
#[derive(Clone, Debug, Default)]
pub struct Timing(Arc<Mutex<Inner>>);

#[derive(Debug, Default)]
struct Inner {
    /// Arrival times of images, by the stamp of the colour image, µs.
    begun: BTreeMap<u64, Instant>,
    /// Ring buffer of the newest latencies, s.
    latencies: Vec<f32>,
    next: usize,
    sent: u64,
}

impl Timing {
    fn lock(&self) -> MutexGuard<'_, Inner> {
        // A panic of another thread leaves valid numbers.
        self.0.lock().unwrap_or_else(PoisonError::into_inner)
    }

    /// Notes that the images of a frame arrived `ago`. `stamp` is that of its colour image, s.
    pub fn begin(&self, stamp: f64, ago: Duration) {
        let now = Instant::now();
        let mut inner = self.lock();
        let at = now.checked_sub(ago).unwrap_or(now);
        inner.begun.insert(micro(stamp), at);
        if inner.begun.len() > ON_THE_WAY {
            inner.begun.pop_first();
        }
    }

    /// Notes that the odometry of a frame was sent. `time` is its stamp, ns.
    pub fn sent(&self, time: u64) {
        let now = Instant::now();
        let mut inner = self.lock();
        inner.sent += 1;
        let Some(begun) = inner.begun.remove(&(time / 1000)) else {
            return;
        };
        let latency = now.saturating_duration_since(begun).as_secs_f32();
        let next = inner.next;
        if next < inner.latencies.len() {
            inner.latencies[next] = latency;
        } else {
            inner.latencies.push(latency);
        }
        inner.next = (next + 1) % REMEMBERED;
    }

    /// Number of frames with odometry sent.
    #[must_use]
    pub fn frames(&self) -> u64 {
        self.lock().sent
    }

    /// Median and 95th percentile of the last minute, s; `None` before the first frame.
    #[must_use]
    pub fn latency(&self) -> Option<[f32; 2]> {
        let mut all = self.lock().latencies.clone();
        all.sort_by(f32::total_cmp);
        let at = |share: f64| all.get((all.len() as f64 * share) as usize).copied();
        Some([at(0.5)?, at(0.95)?])
    }
}

fn micro(stamp: f64) -> u64 {
    (stamp * 1e6).round().max(0.0) as u64
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn frames_are_matched_by_stamp() {
        let timing = Timing::default();
        assert_eq!(timing.latency(), None);
        for i in 0..100 {
            let stamp = 1305031102.175304 + f64::from(i) / 30.0;
            timing.begin(stamp, Duration::from_millis(10));
            timing.begin(stamp + 0.001, Duration::from_secs(9));
            timing.sent(micro(stamp) * 1000);
        }
        timing.sent(5);
        assert_eq!(timing.frames(), 101);
        let [median, most] = timing.latency().unwrap();
        assert!(
            (0.01..1.0).contains(&median) && most >= median,
            "{median} {most}"
        );
    }
}
