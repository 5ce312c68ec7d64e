//! `eval --objects`: scores tracks against boxes.

use super::tracks::{BoxRow, TrackRow, read_boxes, read_tracks};
use crate::args::eval::ObjectEvalArgs;
use crate::failure::Failure;
use serde::Serialize;
use std::collections::BTreeMap;
use std::path::PathBuf;
use stillpoint::evaluation::objects::{
    TrackFrame, TrackOptions, TrackScore, TrackState, TrackSummary, track_score, track_summary,
};
use stillpoint::evaluation::{Statistics, Table};
use stillpoint::geometry::Se3;

/// Stamps that differ by less belong to one frame, s.
const SAME_FRAME: f64 = 1e-3;

#[derive(Debug, Serialize)]
pub(super) struct ObjectsJson {
    /// Against the boxes, if there are any.
    #[serde(skip_serializing_if = "Option::is_none")]
    score: Option<ObjectScoreJson>,
    classes: BTreeMap<String, ClassJson>,
}

#[derive(Debug, Serialize)]
struct ObjectScoreJson {
    class: String,
    frames: usize,
    truth_ids: usize,
    track_ids: usize,
    ghosts_per_frame: f64,
    hota: f64,
    deta: f64,
    assa: f64,
    loca: f64,
    mota: f64,
    motp: f64,
    idf1: f64,
    idp: f64,
    idr: f64,
    id_switches: usize,
    fragments: usize,
    right: usize,
    missed: usize,
    wrong: usize,
    speed_error_median: Option<f64>,
    velocity_error_median: Option<f64>,
    position_error_median: Option<f64>,
}

#[derive(Debug, Serialize)]
struct ClassJson {
    ids: usize,
    track_frames: usize,
    median_speed: Option<f64>,
    too_fast: f64,
    parked: f64,
    ever_parked: usize,
    seconds_to_park_median: Option<f64>,
}

/// Compares tracks with boxes. `truth_from_found` maps the world of the tracks to that of the boxes, if known.
pub(super) fn evaluate(
    files: &[PathBuf],
    args: &ObjectEvalArgs,
    truth_from_found: Option<Se3>,
) -> Result<ObjectsJson, Failure> {
    let tracks: Vec<TrackRow> = (files.first().map_or(Ok(Vec::new()), |p| read_tracks(p))?)
        .into_iter()
        .filter(|row| row.confirmed)
        .collect();
    let score = match files.get(1) {
        None => None,
        Some(path) => {
            let boxes = read_boxes(path, "--objects BOXES.csv")?;
            let ignored = match &args.ignore {
                Some(path) => read_boxes(path, "--ignore")?,
                None => Vec::new(),
            };
            let frames = frames(&tracks, &boxes, &ignored, args);
            let options = TrackOptions {
                iou: args.iou,
                truth_from_found,
                ..TrackOptions::default()
            };
            Some(score_json(&args.class, &track_score(&frames, &options)))
        }
    };
    Ok(ObjectsJson {
        score,
        classes: classes(&tracks, args.max_speed),
    })
}

/// Groups rows into frames by stamp. Objects with too few visible pixels may be detected but need not be.
fn frames(
    tracks: &[TrackRow],
    boxes: &[BoxRow],
    ignored: &[BoxRow],
    args: &ObjectEvalArgs,
) -> Vec<TrackFrame> {
    let tracks = tracks.iter().filter(|t| t.class == args.class);
    let mut frames = Frames::default();
    for row in boxes {
        let frame = frames.at(row.stamp);
        if row.visible_px >= args.min_visible {
            frame.truth.push(row.thing);
        } else {
            frame.ignored.push(row.thing.bounds);
        }
    }
    for row in tracks {
        // Boxes outside the image have no area.
        let [x0, y0, x1, y1] = row.thing.bounds;
        if x1 > x0 && y1 > y0 {
            frames.at(row.stamp).found.push(row.thing);
        }
    }
    for row in ignored {
        frames.at(row.stamp).ignored.push(row.thing.bounds);
    }
    frames.0.into_values().collect()
}

/// Frames by their stamps in units of [`SAME_FRAME`].
#[derive(Default)]
struct Frames(BTreeMap<i64, TrackFrame>);

impl Frames {
    /// The frame of a stamp; a new one if none is near.
    fn at(&mut self, stamp: f64) -> &mut TrackFrame {
        let key = (stamp / SAME_FRAME).round() as i64;
        let near = self.0.range(key - 1..=key + 1);
        let distance = |k: i64| (k - key).abs();
        let near = near.map(|(k, _)| *k).min_by_key(|k| distance(*k));
        self.0.entry(near.unwrap_or(key)).or_insert(TrackFrame {
            stamp,
            ..TrackFrame::default()
        })
    }
}

fn median(s: Option<&Statistics>) -> Option<f64> {
    s.map(|s| s.median)
}

fn score_json(class: &str, s: &TrackScore) -> ObjectScoreJson {
    ObjectScoreJson {
        class: class.to_owned(),
        frames: s.frames,
        truth_ids: s.truth_ids,
        track_ids: s.found_ids,
        ghosts_per_frame: s.ghosts_per_frame,
        hota: s.hota.hota,
        deta: s.hota.detection,
        assa: s.hota.association,
        loca: s.hota.localisation,
        mota: s.clear.mota,
        motp: s.clear.motp,
        idf1: s.identity.f1,
        idp: s.identity.precision,
        idr: s.identity.recall,
        id_switches: s.clear.id_switches,
        fragments: s.clear.fragments,
        right: s.clear.right,
        missed: s.clear.missed,
        wrong: s.clear.wrong,
        speed_error_median: median(s.motion.speed.as_ref()),
        velocity_error_median: median(s.motion.velocity.as_ref()),
        position_error_median: median(s.motion.position.as_ref()),
    }
}

fn classes(tracks: &[TrackRow], limit: f64) -> BTreeMap<String, ClassJson> {
    let mut by_class: BTreeMap<&str, Vec<TrackState>> = BTreeMap::new();
    for row in tracks {
        by_class.entry(&row.class).or_default().push(TrackState {
            stamp: row.stamp,
            id: row.thing.id,
            speed: row.thing.motion.map(|m| m.velocity.norm()),
            parked: row.parked,
        });
    }
    let summary = |(class, rows): (&str, Vec<TrackState>)| {
        (class.to_owned(), class_json(&track_summary(&rows, limit)))
    };
    by_class.into_iter().map(summary).collect()
}

fn class_json(s: &TrackSummary) -> ClassJson {
    ClassJson {
        ids: s.ids,
        track_frames: s.track_frames,
        median_speed: median(s.speed.as_ref()),
        too_fast: s.too_fast,
        parked: s.parked,
        ever_parked: s.ever_parked,
        seconds_to_park_median: median(s.seconds_to_park.as_ref()),
    }
}

impl ObjectsJson {
    pub(super) fn text(&self, limit: f64) -> String {
        let mut text = self.score.as_ref().map_or_else(String::new, score_text);
        let mut table = Table::new([
            "class".to_owned(),
            "ids".to_owned(),
            "track-frames".to_owned(),
            "median speed [m/s]".to_owned(),
            format!("above {limit} m/s [%]"),
            "parked [%]".to_owned(),
            "ids ever parked".to_owned(),
            "after [s]".to_owned(),
        ]);
        let known = |x: Option<f64>| x.map_or_else(|| "-".to_owned(), |x| format!("{x:.3}"));
        for (class, c) in &self.classes {
            table.row([
                class.clone(),
                c.ids.to_string(),
                c.track_frames.to_string(),
                known(c.median_speed),
                format!("{:.1}", c.too_fast * 100.0),
                format!("{:.1}", c.parked * 100.0),
                c.ever_parked.to_string(),
                known(c.seconds_to_park_median),
            ]);
        }
        text += &table.to_text();
        text
    }
}

fn score_text(s: &ObjectScoreJson) -> String {
    let mut text = format!(
        "{} in {} frames: {} there, {} ids given, {:.3} ghosts per frame\n",
        s.class, s.frames, s.truth_ids, s.track_ids, s.ghosts_per_frame
    );
    text += &format!(
        "HOTA {:.3} (DetA {:.3}, AssA {:.3}, LocA {:.3})\n",
        s.hota, s.deta, s.assa, s.loca
    );
    text += &format!(
        "MOTA {:.3} (right {}, missed {}, wrong {}, id switches {}, fragments {}), MOTP {:.3}\n",
        s.mota, s.right, s.missed, s.wrong, s.id_switches, s.fragments, s.motp
    );
    text += &format!("IDF1 {:.3} (IDP {:.3}, IDR {:.3})\n", s.idf1, s.idp, s.idr);
    for (name, error, unit) in [
        ("speed", s.speed_error_median, "m/s"),
        ("velocity", s.velocity_error_median, "m/s"),
        ("position", s.position_error_median, "m"),
    ] {
        if let Some(error) = error {
            text += &format!("median error of {name}: {error:.3} {unit}\n");
        }
    }
    text + "\n"
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn stamps_differing_by_rounding_are_one_frame() {
        let mut frames = Frames::default();
        for stamp in [1.0, 1.0004, 1.0333, 1.033_299, 0.9999] {
            frames.at(stamp);
        }
        assert_eq!(frames.0.len(), 2);
    }
}
