//! Reports missing input: at once and then periodically, with advice.

use crate::camera::CameraTopics;
use std::time::{Duration, Instant};
use stillpoint::ros_messages as ros;

/// A stream without messages for this long has stopped.
const STOPPED: Duration = Duration::from_secs(2);
/// Interval of repeated messages.
const AGAIN: Duration = Duration::from_secs(10);

/// State of a stream.
#[derive(Clone, Debug, Default)]
pub struct StreamState {
    /// Number of messages received.
    pub count: u64,
    /// Arrival of the last one.
    pub last: Option<Instant>,
    /// Stamp of the last one, s.
    pub stamp: Option<f64>,
    /// Number of missing messages, by gaps in their numbers.
    pub lost: u64,
    /// Arrival of the last camera info.
    pub info: Option<Instant>,
    /// Writer and number of the last message.
    number: Option<([u8; 16], i64)>,
}

impl StreamState {
    /// Counts a message, with its writer and number.
    pub fn come(&mut self, now: Instant, number: ([u8; 16], i64)) {
        self.count += 1;
        self.last = Some(now);
        if let Some((writer, last)) = self.number
            && writer == number.0
        {
            let between = number.1.saturating_sub(last).saturating_sub(1);
            self.lost = self.lost.saturating_add(between.max(0).unsigned_abs());
        }
        self.number = Some(number);
    }

    fn has_stopped(&self, now: Instant) -> bool {
        self.last
            .is_none_or(|last| now.saturating_duration_since(last) > STOPPED)
    }
}

/// State of both streams.
#[derive(Clone, Copy, Debug)]
pub struct Seen<'a> {
    /// Names of the topics.
    pub topics: &'a CameraTopics,
    /// Colour and depth.
    pub streams: &'a [StreamState; 2],
    /// Numbers of publishers of colour, depth and constant transforms.
    pub publishers: [usize; 3],
    /// Numbers of images without a partner.
    pub alone: [u64; 2],
    /// Whether lost packets are retransmitted.
    pub reliable: bool,
    /// Description of losses on the wire, if any.
    pub losses: Option<&'a str>,
}

impl Seen<'_> {
    /// Description of missing input; `None` while pairs of images arrive.
    #[must_use]
    pub fn missing(&self, now: Instant, last_pair: Option<Instant>, max_dt: f64) -> Option<String> {
        let kind = |compressed| {
            if compressed {
                "sensor_msgs/msg/CompressedImage"
            } else {
                "sensor_msgs/msg/Image"
            }
        };
        let topics = self.topics;
        let each = [
            ("colour", &topics.colour, topics.colour_compressed),
            ("depth", &topics.depth, topics.depth_compressed),
        ];
        let stopped: Vec<String> = each
            .into_iter()
            .enumerate()
            .filter(|(i, _)| self.streams[*i].has_stopped(now))
            .map(|(i, (what, topic, compressed))| {
                let publishers = match self.publishers[i] {
                    0 => "nobody publishes it; remap it, or start the camera".to_owned(),
                    1 => format!("it has a publisher{}", self.hint(i, now)),
                    n => format!("it has {n} publishers{}", self.hint(i, now)),
                };
                format!(
                    "{what} images on {topic} ({}: {publishers})",
                    kind(compressed)
                )
            })
            .collect();
        if !stopped.is_empty() {
            return Some(stopped.join(", and "));
        }
        let pairs_stopped = last_pair.is_none_or(|t| now.saturating_duration_since(t) > STOPPED);
        let stamps = self.streams[0].stamp.zip(self.streams[1].stamp);
        let (c, d) = stamps.filter(|_| pairs_stopped)?;
        if let Some(losses) = self.losses {
            return Some(format!("whole pairs of images: {losses}"));
        }
        Some(format!(
            "colour and depth images with stamps within {max_dt} s of each other: the last are of {c:.3} s and {d:.3} s; set max_dt, or the camera's clock"
        ))
    }

    /// Advice if no images arrive from a publisher: small messages may get through where large ones do not.
    fn hint(&self, stream: usize, now: Instant) -> &'static str {
        let info = self.streams[stream].info;
        let infos_come = info.is_some_and(|at| now.saturating_duration_since(at) <= STOPPED);
        if infos_come && !self.reliable {
            ", and its camera infos come; where images are incomplete since packets are lost, start with -p reliability:=reliable, as best effort does not ask for them again"
        } else {
            ""
        }
    }
}

/// Reports missing input periodically.
#[derive(Debug, Default)]
pub struct Waiting {
    what: Option<(String, Instant, Instant)>,
}

impl Waiting {
    /// Updates the missing input; returns a message if one is due.
    pub fn update(&mut self, now: Instant, what: Option<String>) -> Option<String> {
        match (what, &mut self.what) {
            (None, None) => None,
            (None, Some((_, since, _))) => {
                let seconds = now.saturating_duration_since(*since).as_secs_f64();
                self.what = None;
                Some(format!("frames come, after {seconds:.1} s"))
            }
            (Some(what), Some((known, _, said)))
                if kind(known) == kind(&what) && now.saturating_duration_since(*said) < AGAIN =>
            {
                *known = what;
                None
            }
            (Some(what), known) => {
                let since = known.as_ref().map_or(now, |(_, since, _)| *since);
                let told = format!("waiting for {what}");
                *known = Some((what, since, now));
                Some(told)
            }
        }
    }

    /// The missing input.
    #[must_use]
    pub fn what(&self) -> Option<&str> {
        self.what.as_ref().map(|(what, _, _)| what.as_str())
    }
}

/// The part of a message without numbers.
fn kind(what: &str) -> &str {
    what.split([':', '(']).next().unwrap_or(what)
}

/// State of the input, for `/diagnostics`.
#[must_use]
pub fn diagnostics(
    seen: &Seen<'_>,
    waiting: Option<&str>,
    rates: [f64; 2],
    stamp: ros::Time,
) -> ros::DiagnosticArray<'static> {
    let value = |key: &'static str, value: String| ros::KeyValue {
        key: key.into(),
        value: value.into(),
    };
    let message = match waiting {
        Some(what) => format!("waiting for {what}"),
        None => "frames come".to_owned(),
    };
    ros::DiagnosticArray {
        header: ros::Header {
            stamp,
            ..ros::Header::default()
        },
        status: vec![ros::DiagnosticStatus {
            level: u8::from(waiting.is_some()),
            name: "stillpoint: input".into(),
            message: message.into(),
            hardware_id: "".into(),
            values: vec![
                value("colour_topic", seen.topics.colour.clone()),
                value("depth_topic", seen.topics.depth.clone()),
                value("colour_hz", format!("{:.1}", rates[0])),
                value("depth_hz", format!("{:.1}", rates[1])),
                value("colour_images", seen.streams[0].count.to_string()),
                value("depth_images", seen.streams[1].count.to_string()),
                value("colour_without_depth", seen.alone[0].to_string()),
                value("depth_without_colour", seen.alone[1].to_string()),
                value("colour_lost", seen.streams[0].lost.to_string()),
                value("depth_lost", seen.streams[1].lost.to_string()),
            ],
        }],
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn topics() -> CameraTopics {
        CameraTopics {
            colour: "/c".into(),
            depth: "/d/compressedDepth".into(),
            colour_info: "/ci".into(),
            depth_info: "/di".into(),
            colour_compressed: false,
            depth_compressed: true,
        }
    }

    #[test]
    fn missing_input_is_reported() {
        let topics = topics();
        let now = Instant::now();
        let mut streams = [StreamState::default(), StreamState::default()];
        let told_of = |streams: &[StreamState; 2], pair, losses| {
            let seen = Seen {
                topics: &topics,
                streams,
                publishers: [0, 2, 0],
                alone: [0; 2],
                reliable: false,
                losses,
            };
            seen.missing(now, pair, 0.02)
        };
        let missing = |streams: &[StreamState; 2], pair| told_of(streams, pair, None);
        let told = missing(&streams, None).unwrap();
        for part in [
            "colour images on /c",
            "nobody publishes it",
            "/d/compressedDepth",
            "2 publishers",
        ] {
            assert!(told.contains(part), "{told}");
        }
        streams[0].come(now, ([1; 16], 1));
        let told = missing(&streams, None).unwrap();
        assert!(told.starts_with("depth images") && !told.contains("reliable"));
        streams[1].info = Some(now);
        let told = missing(&streams, None).unwrap();
        assert!(told.contains("incomplete") && told.contains("reliability:=reliable"));
        streams[1].come(now, ([2; 16], 1));
        (streams[0].stamp, streams[1].stamp) = (Some(5.0), Some(9.0));
        let told = missing(&streams, None).unwrap();
        assert!(
            told.contains("within 0.02 s") && told.contains("9.000"),
            "{told}"
        );
        let told = told_of(&streams, None, Some("120 of 150 images")).unwrap();
        assert_eq!(told, "whole pairs of images: 120 of 150 images");
        assert_eq!(missing(&streams, Some(now)), None);
    }

    #[test]
    fn missing_input_is_reported_periodically() {
        let (mut waiting, begin) = (Waiting::default(), Instant::now());
        let at = |s: u64| begin + Duration::from_secs(s);
        let what = |n: u32| Some(format!("depth images on /d (type: {n} publishers)"));
        assert_eq!(waiting.update(at(0), None), None);
        assert!(
            waiting
                .update(at(1), what(0))
                .unwrap()
                .starts_with("waiting for depth")
        );
        assert_eq!(waiting.update(at(2), what(1)), None);
        assert_eq!(waiting.what(), what(1).as_deref());
        assert!(waiting.update(at(3), Some("colour".into())).is_some());
        assert!(waiting.update(at(14), Some("colour".into())).is_some());
        assert_eq!(
            waiting.update(at(16), None).unwrap(),
            "frames come, after 15.0 s"
        );
        assert_eq!(waiting.what(), None);
    }
}
