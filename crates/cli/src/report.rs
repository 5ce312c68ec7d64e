//! What `run`, `demo` and `eval` print about a result.

use crate::models::megabytes;
use crate::run::live_report::LiveJson;
use crate::run::summary::{DetectorJson, ScoreJson, StatisticsJson, Summary};
use stillpoint::evaluation::Table;
use stillpoint::evaluation::timing;

/// The report of a run: counts, score, timing.
pub(crate) fn run_text(summary: &Summary) -> String {
    let s = summary;
    let dropped = s
        .live
        .as_ref()
        .map_or_else(String::new, LiveJson::dropped_text);
    let mut text = format!(
        "\n{}: {} of {} frames tracked{dropped}, {} keyframes, {} landmarks, {:.1} s ({:.0} frames/s)\n",
        s.input.name,
        s.tracked,
        s.frames,
        s.keyframes,
        s.landmarks,
        s.seconds,
        s.frames as f64 / s.seconds.max(1e-3)
    );
    if s.skipped > 0 {
        text += &format!("{} frames could not be read and were skipped\n", s.skipped);
    }
    text += &filter_text(s);
    text += &s.live.as_ref().map_or_else(String::new, LiveJson::text);
    if s.loops != Default::default() {
        let l = s.loops;
        text += &format!("loops: {} closed, {} rejected", l.closed, l.rejected);
        if l.joined > 0 {
            text += &format!("; {} pieces of map joined to others", l.joined);
        }
        text.push('\n');
    }
    if let Some(m) = &s.map {
        text += &format!(
            "map saved to {}: {} keyframes, {} landmarks, {}\n",
            m.path,
            m.keyframes,
            m.landmarks,
            megabytes(m.bytes)
        );
    }
    if let Some(a) = &s.accuracy {
        text.push('\n');
        text += &score_text(
            &[("final", &a.final_poses), ("online", &a.online)],
            s.frames,
        );
    }
    text.push('\n');
    let rows = s.timing_ms.iter().map(|t| (t.stage.as_str(), t.stats()));
    let live = s.live.iter().flat_map(LiveJson::rows);
    text += &timing::table(live.chain(rows)).to_text();
    if let Some(bytes) = s.peak_memory_bytes {
        text += &format!("\npeak memory {:.0} MB\n", bytes as f64 * 1e-6);
    }
    text
}

/// What the detector and the static filter did.
fn filter_text(summary: &Summary) -> String {
    let (d, f) = (&summary.detector, &summary.features);
    let detector = match d.kind.as_str() {
        "none" => "none".to_owned(),
        kind => format!(
            "{kind} {}, {} detections in {} frames",
            d.name, d.detections, d.frames
        ),
    };
    let network = d.network();
    let network = network.map_or_else(String::new, |n| format!("network: {n}\n"));
    let mut text = format!(
        "{network}detector: {detector}; {:.1} % of {:.0} keypoints per frame move",
        f.dynamic_share * 100.0,
        f.keypoints as f64 / summary.frames.max(1) as f64
    );
    if f.released > 0 {
        text += &format!(
            ", {} more were used because too few others were left",
            f.released
        );
    }
    text + "\n" + &unused_text(d)
}

/// Which answers of the detector were of no use.
fn unused_text(detector: &DetectorJson) -> String {
    let line = |answers: u64, why: &str| match answers {
        0 => String::new(),
        n => format!("{n} answers of the detector {why}\n"),
    };
    line(detector.too_late, "came too late to be used")
        + &line(
            detector.without_pose,
            "could not be used, since their frames have no pose",
        )
}

/// A table of scores. `frames` is what the pairs are counted against.
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
                    format!("{} of {frames} frames", m.pairs),
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

    #[test]
    fn answers_that_were_of_no_use_are_told() {
        let mut detector = DetectorJson::default();
        assert_eq!(unused_text(&detector), "");
        detector.too_late = 3;
        let said = "3 answers of the detector came too late to be used\n";
        assert_eq!(unused_text(&detector), said);
        detector.without_pose = 2;
        assert!(unused_text(&detector).contains("\n2 answers"));
    }
}
