//! Measurements of a live run, for `summary.json` and as text.

use crate::console;
use serde::{Deserialize, Serialize};
use std::collections::BTreeMap;
use stillpoint::evaluation::timing::Stats;
use stillpoint::imaging::FrameId;
use stillpoint::live::{Ended, FrameTiming, LiveStatistics, Missed, WorkerEnd};

/// Subscriber of the progress line: sees only the newest frame.
pub(crate) const PROGRESS: &str = "progress";
/// Subscriber that draws images into a folder: reports omitted images.
pub(crate) const OVERLAY: &str = "overlay";

/// Lateness above which frames are reported, ms: a third of the time between two frames.
const LATE_MS: f64 = 10.0;

pub(crate) struct LiveRun {
    pub(crate) json: LiveJson,
    /// Of every tracked frame, ms.
    pub(crate) latency_ms: Vec<f64>,
    /// Of every frame with a detector answer, until tracking took the answer, ms.
    pub(crate) answer_ms: Vec<(FrameId, f64)>,
}

impl LiveRun {
    /// From the frame selection, how the threads ended, and the lateness of frames, s.
    pub(crate) fn new(
        frames: &str,
        measured: &LiveStatistics,
        ended: &Ended,
        detections_per_second: f64,
        late: &[f64],
    ) -> Self {
        let latencies = measured.frames.iter().map(|f| f.latency * 1e3);
        let answers = measured.detections.iter();
        Self {
            json: LiveJson::new(frames, measured, ended, detections_per_second, late),
            latency_ms: latencies.collect(),
            answer_ms: answers.map(|a| (a.frame, a.latency * 1e3)).collect(),
        }
    }
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct LiveJson {
    /// Frame selection: `newest` or `all`.
    pub(crate) frames: String,
    pub(crate) arrived: u64,
    /// Frames that came twice or out of order, or do not match the camera.
    pub(crate) refused: u64,
    /// Frames that were replaced by a newer one before tracking took them.
    pub(crate) dropped: usize,
    /// Share of arrived frames that were dropped, 0 to 1.
    pub(crate) dropped_share: f64,
    /// From a frame's arrival to its pose.
    pub(crate) latency_ms: Figures,
    /// Part of the latency until tracking took the frame.
    pub(crate) waited_ms: Figures,
    /// Age of the newest known detections relative to the frame's stamp.
    pub(crate) detections_age_ms: Figures,
    /// From the arrival of a frame until tracking took the detector's answer for it.
    pub(crate) answer_ms: Figures,
    /// Age of the map view that a frame was tracked in.
    pub(crate) view_age_ms: Figures,
    /// Lateness of frames relative to their stamps.
    pub(crate) late_ms: Figures,
    #[serde(default)]
    pub(crate) features: Figures,
    /// Keyframes that this view did not contain yet.
    pub(crate) keyframes_behind: Figures,
    /// Messages queued for mapping when a pose was ready.
    pub(crate) mapping_queue: Figures,
    /// Messages queued for loop closing at that time.
    pub(crate) looping_queue: Figures,
    /// Frames answered by the detector per second of the run.
    pub(crate) detections_per_second: f64,
    /// Events and images missed by slow subscribers, by name.
    #[serde(default)]
    pub(crate) subscribers: BTreeMap<String, MissedJson>,
    /// How every thread ended: `finished`, or why not.
    pub(crate) threads: Threads,
}

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct MissedJson {
    pub(crate) events: u64,
    pub(crate) images: u64,
}

impl From<Missed> for MissedJson {
    fn from(missed: Missed) -> Self {
        Self {
            events: missed.events,
            images: missed.images,
        }
    }
}

/// Statistics over frames or answers; all zero if there are none.
#[derive(Clone, Copy, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct Figures {
    pub(crate) n: usize,
    pub(crate) median: f64,
    pub(crate) p95: f64,
    pub(crate) p99: f64,
    pub(crate) max: f64,
    pub(crate) mean: f64,
}

impl Figures {
    fn of(values: impl Iterator<Item = f64>) -> Self {
        let s = Stats::of(&values.collect::<Vec<f64>>());
        Self {
            n: s.n,
            median: s.median,
            p95: s.p95,
            p99: s.p99,
            max: s.max,
            mean: s.mean,
        }
    }

    fn stats(&self) -> Stats {
        Stats {
            n: self.n,
            median: self.median,
            p95: self.p95,
            p99: self.p99,
            max: self.max,
            mean: self.mean,
        }
    }
}

#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
pub(crate) struct Threads {
    pub(crate) tracking: String,
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) detection: Option<String>,
    pub(crate) mapping: String,
    pub(crate) looping: String,
}

impl LiveJson {
    pub(crate) fn new(
        frames: &str,
        measured: &LiveStatistics,
        ended: &Ended,
        detections_per_second: f64,
        late: &[f64],
    ) -> Self {
        let each = |of: fn(&FrameTiming) -> f64| Figures::of(measured.frames.iter().map(of));
        let ages = |of: fn(&FrameTiming) -> Option<f64>| {
            Figures::of(measured.frames.iter().filter_map(of).map(|s| s * 1e3))
        };
        let dropped = measured.dropped.len();
        Self {
            frames: frames.to_owned(),
            arrived: measured.arrived,
            refused: measured.refused,
            dropped,
            dropped_share: dropped as f64 / measured.arrived.max(1) as f64,
            latency_ms: each(|f| f.latency * 1e3),
            waited_ms: each(|f| f.waited * 1e3),
            detections_age_ms: ages(|f| f.detections_age),
            answer_ms: Figures::of(measured.detections.iter().map(|a| a.latency * 1e3)),
            view_age_ms: ages(|f| f.view_age),
            late_ms: Figures::of(late.iter().map(|s| s * 1e3)),
            features: each(|f| f64::from(f.features)),
            keyframes_behind: each(|f| f64::from(f.keyframes_behind)),
            mapping_queue: each(|f| f64::from(f.mapping_queue)),
            looping_queue: each(|f| f64::from(f.looping_queue)),
            detections_per_second,
            subscribers: measured
                .subscribers
                .iter()
                .map(|(name, missed)| (name.clone(), MissedJson::from(*missed)))
                .collect(),
            threads: Threads {
                tracking: ended.tracking.to_string(),
                detection: ended.detection.as_ref().map(ToString::to_string),
                mapping: ended.mapping.to_string(),
                looping: ended.looping.to_string(),
            },
        }
    }

    /// Threads that did not finish, with the reason.
    fn failures(&self) -> impl Iterator<Item = (&'static str, &str)> {
        let t = &self.threads;
        let all = [
            ("tracking", Some(&t.tracking)),
            ("detection", t.detection.as_ref()),
            ("mapping", Some(&t.mapping)),
            ("looping", Some(&t.looping)),
        ];
        let finished = WorkerEnd::Finished.to_string();
        all.into_iter()
            .filter_map(|(name, end)| end.map(|end| (name, end.as_str())))
            .filter(move |(_, end)| *end != finished)
    }

    /// Prints problems of threads and events. Returns the number of threads that did not finish.
    pub(crate) fn tell(&self) -> usize {
        for (name, end) in self.failures() {
            console::line(&format!(
                "the thread of {name} {end}; the result holds what there was"
            ));
        }
        for (name, missed) in &self.subscribers {
            if missed.events > 0 && name != PROGRESS {
                console::warn(&format!(
                    "{} events did not reach {name} since this machine was too slow: it lacks frames",
                    missed.events
                ));
            }
            if missed.images > 0 && name == OVERLAY {
                console::warn(&format!(
                    "{} pictures were left out, since drawing them took longer than frames came",
                    missed.images
                ));
            }
        }
        self.failures().count()
    }

    /// Rows that a live run adds to the timing table.
    pub(crate) fn rows(&self) -> Vec<(&str, Stats)> {
        let rows = [
            ("latency", &self.latency_ms),
            ("- waited", &self.waited_ms),
            ("age of detections", &self.detections_age_ms),
            ("detector's answer", &self.answer_ms),
            ("age of the view", &self.view_age_ms),
        ];
        rows.into_iter()
            .filter(|(_, figures)| figures.n > 0)
            .map(|(name, figures)| (name, figures.stats()))
            .collect()
    }

    pub(crate) fn text(&self) -> String {
        let queue = |q: &Figures| format!("{:.1} (at most {:.0})", q.mean, q.max);
        let mut text = format!(
            "live: {:.1} ms from a frame to its pose (99th percentile {:.1} ms); {} of {} frames dropped ({:.1} %); waiting for mapping {}, for looping {} messages; {} keyframes behind\n",
            self.latency_ms.median,
            self.latency_ms.p99,
            self.dropped,
            self.arrived,
            self.dropped_share * 100.0,
            queue(&self.mapping_queue),
            queue(&self.looping_queue),
            queue(&self.keyframes_behind),
        );
        if self.features.mean < self.features.max {
            text += &format!(
                "live: {:.0} keypoints asked for per frame on average (at most {:.0})\n",
                self.features.mean, self.features.max
            );
        }
        if self.late_ms.p95 > LATE_MS {
            text += &format!(
                "live: frames arrived {:.0} ms late on average (at most {:.0}): {}\n",
                self.late_ms.mean,
                self.late_ms.max,
                match self.frames.as_str() {
                    "all" => "tracking and reading them took longer than the camera did",
                    _ => "reading them took longer than the camera did",
                }
            );
        }
        if self.threads.detection.is_some() {
            text += &format!(
                "live: {:.1} detections per second, {:.0} ms old on average when used\n",
                self.detections_per_second, self.detections_age_ms.mean
            );
        }
        text
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::imaging::FrameId;

    fn measured() -> LiveStatistics {
        let frame = |n: u32| FrameTiming {
            latency: 0.01 * f64::from(n),
            waited: 0.001,
            detections_age: (n > 1).then_some(0.1),
            mapping_queue: n,
            frame: FrameId(n),
            ..FrameTiming::default()
        };
        LiveStatistics {
            arrived: 4,
            dropped: vec![FrameId(0)],
            frames: (1..4).map(frame).collect(),
            subscribers: vec![(
                "overlay".to_owned(),
                Missed {
                    events: 2,
                    images: 3,
                },
            )],
            ..LiveStatistics::default()
        }
    }

    #[test]
    fn live_measurements_are_reported_in_milliseconds() {
        let ended = Ended {
            tracking: WorkerEnd::Finished,
            detection: Some(WorkerEnd::GivenUp),
            mapping: WorkerEnd::Panicked("oh".to_owned()),
            looping: WorkerEnd::Finished,
        };
        let json = LiveJson::new("newest", &measured(), &ended, 12.0, &[0.0, 0.05]);
        assert!((json.latency_ms.median - 20.0).abs() < 1e-9);
        assert_eq!((json.detections_age_ms.n, json.view_age_ms.n), (2, 0));
        assert_eq!((json.dropped_share, json.mapping_queue.max), (0.25, 3.0));
        let text = json.text();
        assert!(text.contains("1 of 4 frames dropped (25.0 %)"), "{text}");
        let missed = json.subscribers["overlay"];
        assert_eq!((missed.events, missed.images), (2, 3));
        assert!(
            text.contains("25 ms late on average (at most 50)"),
            "{text}"
        );
        assert!(
            text.contains("12.0 detections per second, 100 ms old"),
            "{text}"
        );
        // Missing measurements have no row.
        let rows: Vec<&str> = json.rows().iter().map(|r| r.0).collect();
        assert_eq!(rows, ["latency", "- waited", "age of detections"]);
        assert_eq!(json.tell(), 2);
        let failures: Vec<_> = json.failures().collect();
        assert_eq!(failures[1], ("mapping", "panicked: oh"));
        let text = serde_json::to_string(&json).unwrap();
        assert_eq!(serde_json::from_str::<LiveJson>(&text).unwrap(), json);
    }
}
