//! Text output of `run`, `demo` and `eval`.

use crate::console::{counted, frame_rate};
use crate::download::megabytes;
use crate::run::live_report::LiveJson;
use crate::run::summary::{DetectorJson, ScoreJson, StatisticsJson, Summary};
use stillpoint::detection::MOST_DETECTIONS;
use stillpoint::evaluation::Table;
use stillpoint::evaluation::timing;

/// The report of a run, with the headline figures first. `detailed` adds the scores of the online poses, the network's runtime, the time of
/// every stage and the memory.
pub(crate) fn run_text(summary: &Summary, detailed: bool) -> String {
    let s = summary;
    let mut text = format!("\n{}: {}\n", s.input.name, headline(s));
    let surface = s.kept.dense.as_ref().map(|d| d.text(detailed));
    // Without details, map and surface share one line.
    text += &match &surface {
        Some(surface) if !detailed => format!("{}; {surface}", map_text(s)),
        _ => map_text(s) + "\n",
    };
    text += &filter_text(s, detailed);
    text += &s
        .pace
        .live
        .as_ref()
        .map_or_else(String::new, LiveJson::text);
    if let Some(i) = &s.stages.inertial {
        text += &format!("{}\n", i.line());
    }
    if let Some(o) = &s.stages.odometry {
        text += &format!("{}\n", o.line());
    }
    text += &surface.filter(|_| detailed).unwrap_or_default();
    if let Some(m) = &s.kept.map {
        text += &format!(
            "map saved to {}: {}, {}, {}\n",
            m.path,
            counted(m.keyframes, "keyframe"),
            counted(m.landmarks, "landmark"),
            megabytes(m.bytes)
        );
    }
    if let Some(a) = &s.accuracy {
        let scores = [("final", &a.final_poses), ("online", &a.online)];
        let table = if detailed {
            format!("\n{}", score_text(&scores, frames_in_all(s)))
        } else {
            // Without details, only the heading and the absolute error.
            let all = score_text(&scores[..1], frames_in_all(s));
            all.lines()
                .take(2)
                .map(|line| format!("{line}\n"))
                .collect()
        };
        text += &table;
    }
    if detailed {
        text += &timing_text(s);
    }
    text
}

fn map_text(s: &Summary) -> String {
    let mut text = format!(
        "{}, {}",
        counted(s.map.keyframes, "keyframe"),
        counted(s.map.landmarks, "landmark")
    );
    if s.stages.loops != Default::default() {
        let l = s.stages.loops;
        text += &format!(
            "; loops: {} closed, {} set aside",
            l.closed,
            counted(l.set_aside as usize, "candidate")
        );
        if l.joined > 0 {
            text += &format!(
                "; {} joined to others",
                counted(l.joined as usize, "submap")
            );
        }
    }
    text
}

/// Frames in the run's part of the recording: tracked or not, dropped in a live run, or unreadable.
fn frames_in_all(summary: &Summary) -> usize {
    let dropped = summary.pace.live.as_ref().map_or(0, |live| live.dropped);
    summary.tracking.frames + summary.tracking.skipped + dropped
}

fn headline(s: &Summary) -> String {
    let mut text = format!(
        "{} of {} tracked",
        s.tracking.tracked,
        counted(frames_in_all(s), "frame")
    );
    let dropped = s.pace.live.as_ref().map_or(0, |live| live.dropped);
    for (n, why) in [
        (dropped, "dropped"),
        (s.tracking.skipped, "could not be read and were skipped"),
    ] {
        if n > 0 {
            text += &format!(", {n} {why}");
        }
    }
    text += &match s.accuracy.as_ref().map(|a| &a.final_poses) {
        None => String::new(),
        Some(ScoreJson::Moving(m)) => format!("; ATE {:.1} mm", m.ate.rmse * 1e3),
        Some(ScoreJson::Fixed(f)) => format!("; drift {:.1} mm", f.drift.rmse * 1e3),
    };
    let rate = s.tracking.frames as f64 / s.pace.seconds.max(1e-3);
    text + &format!(
        "; {:.1} s ({})",
        s.pace.seconds,
        frame_rate(rate, "frames/s")
    )
}

fn timing_text(summary: &Summary) -> String {
    let rows = &summary.pace.timing_ms;
    let rows = rows.iter().map(|t| (t.stage.as_str(), t.stats()));
    let live = summary.pace.live.iter().flat_map(LiveJson::rows);
    let mut text = format!("\n{}", timing::table(live.chain(rows)).to_text());
    if let Some(bytes) = summary.pace.peak_memory_bytes {
        text += &format!("\npeak memory {:.0} MB\n", bytes as f64 * 1e-6);
    }
    text
}

/// Figures of the detector and the static filter.
fn filter_text(summary: &Summary, detailed: bool) -> String {
    let (d, f) = (&summary.stages.detector, &summary.stages.features);
    let detector = match d.kind.as_str() {
        "none" => "none".to_owned(),
        kind => format!(
            "{kind} {}, {} in {}",
            d.name,
            counted(d.detections, "detection"),
            counted(d.frames, "frame")
        ),
    };
    let network = d.network().filter(|_| detailed);
    let network = network.map_or_else(String::new, |n| format!("network: {n}\n"));
    let mut text = format!(
        "{network}detector: {detector}; {:.1} % of {:.0} keypoints per frame move",
        f.dynamic_share * 100.0,
        f.keypoints as f64 / summary.tracking.frames.max(1) as f64
    );
    if f.released > 0 {
        text += &format!(
            ", {} more were used because too few others were left",
            f.released
        );
    }
    text + &beginning_text(summary) + "\n" + &unused_text(d)
}

/// Number of frames in which it was undecided which regions move, and the revoked keyframes.
fn beginning_text(summary: &Summary) -> String {
    if summary.tracking.undecided == 0 {
        return String::new();
    }
    let frames = counted(summary.tracking.undecided, "frame");
    let mut text = format!("; undecided who moves in {frames}");
    let revoked = summary.stages.features.revoked_keyframes;
    if revoked > 0 {
        let revoked = counted(revoked as usize, "keyframe");
        text += &format!(": the first ones were tracked again, and {revoked} taken back");
    }
    text
}

/// Detector answers that were not used.
fn unused_text(detector: &DetectorJson) -> String {
    let line = |answers: u64, why: &str| match answers {
        0 => String::new(),
        n => format!("{} of the detector {why}\n", counted(n as usize, "answer")),
    };
    let left_out = match detector.left_out {
        0 => String::new(),
        n => format!(
            "{n} detections were left out: the weakest of over {MOST_DETECTIONS} in a frame\n"
        ),
    };
    left_out
        + &line(detector.too_late, "came too late to be used")
        + &line(
            detector.without_pose,
            "could not be used, since their frames have no pose",
        )
}

/// A table of scores. `frames` is the total that pairs are counted against.
pub(crate) fn score_text(scores: &[(&str, &ScoreJson)], frames: usize) -> String {
    let mut table = Table::new(["error", "rmse", "sd", "mean", "median", "max", "pairs"]);
    for (name, score) in scores {
        let label = |text: &str| {
            if name.is_empty() {
                text.to_owned()
            } else {
                format!("{name}: {text}")
            }
        };
        match score {
            ScoreJson::Moving(m) => {
                let alignment = m
                    .scale
                    .map_or_else(String::new, |s| format!(", scale {s:.4}"));
                table.row(cells(
                    label(&format!("ATE (mm{alignment})")),
                    &m.ate,
                    1e3,
                    format!("{} of {}", m.pairs, counted(frames, "frame")),
                ));
                if let Some(r) = &m.rpe {
                    let unit = |u: &str| label(&format!("RPE ({u} per {})", r.delta));
                    let pairs = r.pairs.to_string();
                    table.row(cells(unit("mm"), &r.translation, 1e3, pairs.clone()));
                    table.row(cells(unit("deg"), &r.rotation_deg, 1.0, pairs));
                }
            }
            ScoreJson::Fixed(f) => {
                let none = String::new;
                table.row(cells(label("drift (mm)"), &f.drift, 1e3, none()));
                table.row(cells(label("spread (mm)"), &f.spread, 1e3, none()));
                table.row(cells(label("rotation (deg)"), &f.rotation_deg, 1.0, none()));
            }
        }
    }
    table.to_text()
}

fn cells(name: String, s: &StatisticsJson, factor: f64, pairs: String) -> Vec<String> {
    let mut row = vec![name];
    row.extend([s.rmse, s.sd, s.mean, s.median, s.max].map(|x| format!("{:.3}", x * factor)));
    row.push(pairs);
    row
}

#[cfg(test)]
mod tests {
    use super::*;

    /// A recorded summary, with `change` applied.
    fn summary(change: serde_json::Value) -> Summary {
        let statistics =
            serde_json::json!({"rmse": 0.0081, "sd": 0.0, "mean": 0.0, "median": 0.0, "max": 0.0});
        let score = serde_json::json!({"pairs": 70, "ate": statistics, "rpe": null});
        let mut json = serde_json::json!({
            "input": {"name": "room", "layout": "TUM", "camera": "tum_fr1"},
            "frames": 70, "skipped": 0, "tracked": 70, "lost": [], "interrupted": false,
            "keyframes": 5, "landmarks": 600, "map_versions": 9, "seconds": 2.0,
            "timing_ms": [{"stage": "filter", "n": 70, "median": 1.0, "p95": 1.0, "p99": 1.0, "max": 1.0, "mean": 1.0}],
            "peak_memory_bytes": 100_000_000, "simd": "scalar", "machine": crate::machine::Machine::here(),
            "accuracy": {"final": score, "online": score},
        });
        for (key, value) in change.as_object().unwrap() {
            json[key] = value.clone();
        }
        serde_json::from_value(json).unwrap()
    }

    #[test]
    fn first_line_summarises_and_details_need_verbose() {
        let summary = summary(serde_json::json!({}));
        let text = run_text(&summary, false);
        assert!(
            text.starts_with("\nroom: 70 of 70 frames tracked; ATE 8.1 mm; 2.0 s (35 frames/s)\n"),
            "{text}"
        );
        let detailed = run_text(&summary, true);
        for part in ["filter", "peak memory 100 MB", "online: ATE"] {
            assert!(!text.contains(part), "{text}");
            assert!(detailed.contains(part), "{detailed}");
        }
    }

    #[test]
    fn single_frame_run_uses_singular_words() {
        let one = serde_json::json!({"frames": 1, "tracked": 1, "keyframes": 1, "landmarks": 1, "seconds": 2.0,
            "loops": {"closed": 1, "joined": 0, "set_aside": 1}});
        let text = run_text(&summary(one), false);
        assert!(text.contains("1 of 1 frame tracked"), "{text}");
        assert!(text.contains("(2.0 s per frame)"), "{text}");
        let map = "\n1 keyframe, 1 landmark; loops: 1 closed, 1 candidate set aside\n";
        assert!(text.contains(map), "{text}");
    }

    #[test]
    fn undecided_start_among_people_is_reported() {
        let none = run_text(&summary(serde_json::json!({})), false);
        assert!(!none.contains("undecided"), "{none}");
        let short = serde_json::json!({"undecided": 24});
        let short = run_text(&summary(short), false);
        assert!(
            short.contains("undecided who moves in 24 frames\n"),
            "{short}"
        );
        let features = serde_json::json!({"keypoints": 0, "dynamic": 0, "dynamic_share": 0.0, "released": 0, "rejudged_landmarks": 0, "revoked_keyframes": 3});
        let long = serde_json::json!({"undecided": 38, "features": features});
        let long = run_text(&summary(long), false);
        assert!(
            long.contains(
                "in 38 frames: the first ones were tracked again, and 3 keyframes taken back\n"
            ),
            "{long}"
        );
    }

    #[test]
    fn dropped_and_skipped_frames_are_not_counted_as_tracked() {
        let figures = serde_json::json!({"n": 0, "median": 0.0, "p95": 0.0, "p99": 0.0, "max": 0.0, "mean": 0.0});
        let mut live = serde_json::json!({
            "frames": "newest", "arrived": 120, "refused": 0, "dropped": 50, "dropped_share": 0.4167,
            "detections_per_second": 0.0, "events_missed": 0,
            "threads": {"tracking": "finished", "mapping": "finished", "looping": "finished"},
        });
        for name in [
            "latency_ms",
            "waited_ms",
            "detections_age_ms",
            "answer_ms",
            "view_age_ms",
            "late_ms",
            "keyframes_behind",
            "mapping_queue",
            "looping_queue",
        ] {
            live[name] = figures.clone();
        }
        let live = summary(serde_json::json!({"live": live}));
        let text = run_text(&live, false);
        assert!(
            text.contains("70 of 120 frames tracked, 50 dropped;"),
            "{text}"
        );
        assert!(text.contains("70 of 120 frames\n"), "{text}");
        let text = run_text(&summary(serde_json::json!({"skipped": 3})), false);
        assert!(
            text.contains("70 of 73 frames tracked, 3 could not be read"),
            "{text}"
        );
    }

    #[test]
    fn left_out_detections_are_reported() {
        let detector = DetectorJson {
            left_out: 51_000,
            ..DetectorJson::default()
        };
        let said = "51000 detections were left out: the weakest of over 300 in a frame\n";
        assert_eq!(unused_text(&detector), said);
    }

    #[test]
    fn unusable_detector_answers_are_reported() {
        let mut detector = DetectorJson::default();
        assert_eq!(unused_text(&detector), "");
        detector.too_late = 3;
        let said = "3 answers of the detector came too late to be used\n";
        assert_eq!(unused_text(&detector), said);
        detector.without_pose = 2;
        assert!(unused_text(&detector).contains("\n2 answers"));
    }
}
