//! Detection of incomplete images, by gaps in the sequence numbers.

use crate::waiting::StreamState;
use std::time::{Duration, Instant};

/// Duration of a counting window.
const WINDOW: Duration = Duration::from_secs(5);
/// Interval of repeated warnings.
const AGAIN: Duration = Duration::from_secs(10);
/// Losses below one in this many images are ignored.
const FEW: u64 = 50;

/// Reports when images are lost, and when losses end.
#[derive(Debug)]
pub struct Losses {
    since: Instant,
    /// Counts of received and lost colour and depth images at that time.
    came: [u64; 2],
    lost: [u64; 2],
    now: Option<(String, Instant)>,
}

impl Losses {
    /// Starts counting.
    #[must_use]
    pub fn new(now: Instant) -> Self {
        Self {
            since: now,
            came: [0; 2],
            lost: [0; 2],
            now: None,
        }
    }

    /// Counts losses; returns a message if one is due. `reliable`: whether lost packets are retransmitted.
    pub fn update(
        &mut self,
        now: Instant,
        streams: &[StreamState; 2],
        reliable: bool,
    ) -> Option<String> {
        let window = now.saturating_duration_since(self.since);
        if window < WINDOW {
            return None;
        }
        let came = [0, 1].map(|i| streams[i].count - self.came[i]);
        let lost = [0, 1].map(|i| streams[i].lost - self.lost[i]);
        if came == [0; 2] {
            // Gaps become visible with the next image.
            return None;
        }
        self.since = now;
        self.came = [0, 1].map(|i| streams[i].count);
        self.lost = [0, 1].map(|i| streams[i].lost);
        if [0, 1].iter().all(|i| lost[*i] * FEW <= came[*i] + lost[*i]) {
            let was = self.now.take();
            return was.map(|_| "images arrive whole again".to_owned());
        }
        let told = text(came, lost, window, reliable);
        let said = self.now.as_ref().map(|(_, said)| *said);
        let speak = said.is_none_or(|said| now.saturating_duration_since(said) >= AGAIN);
        self.now = Some((told.clone(), if speak { now } else { said.unwrap_or(now) }));
        speak.then_some(told)
    }

    /// Description of current losses, if any.
    #[must_use]
    pub fn now(&self) -> Option<&str> {
        self.now.as_ref().map(|(told, _)| told.as_str())
    }
}

fn text(came: [u64; 2], lost: [u64; 2], window: Duration, reliable: bool) -> String {
    let what = if reliable {
        "lost packets are asked for again, so the network or this machine does not keep up"
    } else {
        "an image is many packets, and with best effort one lost packet loses it; start with -p reliability:=reliable, which asks for lost packets again"
    };
    format!(
        "incomplete images: {} of {} colour and {} of {} depth images in {:.0} s did not arrive whole; {what}",
        lost[0],
        came[0] + lost[0],
        lost[1],
        came[1] + lost[1],
        window.as_secs_f64()
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn ongoing_and_ended_losses_are_reported() {
        let begin = Instant::now();
        let at = |s: u64| begin + Duration::from_secs(s);
        let mut streams = [StreamState::default(), StreamState::default()];
        let mut losses = Losses::new(begin);
        let mut next = 0;
        let mut come = |streams: &mut [StreamState; 2], numbers: i64, step: i64| {
            for _ in 0..numbers {
                next += step;
                streams[0].come(begin, ([1; 16], next));
                streams[1].come(begin, ([2; 16], next));
            }
        };
        come(&mut streams, 150, 1);
        assert_eq!(losses.update(at(1), &streams, false), None);
        assert_eq!(losses.update(at(5), &streams, false), None);
        come(&mut streams, 30, 5);
        let told = losses.update(at(10), &streams, false).unwrap();
        assert!(
            told.contains("120 of 150 colour") && told.contains("reliability:=reliable"),
            "{told}"
        );
        come(&mut streams, 30, 5);
        assert_eq!(losses.update(at(15), &streams, false), None);
        come(&mut streams, 30, 5);
        assert!(losses.update(at(20), &streams, false).is_some());
        assert!(losses.now().is_some());
        assert_eq!(losses.update(at(25), &streams, false), None);
        assert!(losses.now().is_some(), "nothing came");
        come(&mut streams, 150, 1);
        let told = losses.update(at(30), &streams, false).unwrap();
        assert!(told.contains("again"));
        assert_eq!(losses.now(), None);
    }

    #[test]
    fn second_writer_is_not_counted_as_loss() {
        let now = Instant::now();
        let mut stream = StreamState::default();
        stream.come(now, ([1; 16], 1));
        stream.come(now, ([2; 16], 900));
        stream.come(now, ([2; 16], 901));
        stream.come(now, ([2; 16], 899));
        assert_eq!((stream.count, stream.lost), (4, 0));
    }
}
