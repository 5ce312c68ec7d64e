//! How well objects are followed: HOTA, MOTA, IDF1, ghosts, and errors of position and velocity.
//!
//! Answers what the field asks of a tracker, with the field's definitions: HOTA (Luiten et al., "HOTA: A higher order metric for evaluating multi-object
//! tracking", IJCV 2021), CLEAR MOT (Bernardin, Stiefelhagen, "Evaluating multiple object tracking performance", 2008), IDF1 (Ristani et al., "Performance
//! measures and a data set for multi-target, multi-camera tracking", 2016). Figures agree with the Python package `trackeval`. Knows boxes, not images.

mod clear;
mod hota;
mod identity;
mod ignored;
mod motion;

pub use clear::Clear;
pub use hota::Hota;
pub use identity::Identity;
pub use motion::{MotionErrors, TrackState, TrackSummary, track_summary};

use std::collections::BTreeMap;
use stillpoint_geometry::{Se3, Vec3};

/// Where a thing is in the world and how it moves.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMotion {
    /// Position, m.
    pub position: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
}

/// The box of a thing in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedBox {
    /// Its number, the same in all frames.
    pub id: u32,
    /// Left, upper, right and lower border, px.
    pub bounds: [f64; 4],
    /// Where it is and how it moves, if that is known.
    pub motion: Option<PointMotion>,
}

/// A frame: what there is, and what was found.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackFrame {
    /// Time, s.
    pub stamp: f64,
    /// What there is; no number twice.
    pub truth: Vec<TrackedBox>,
    /// What was found; no number twice.
    pub found: Vec<TrackedBox>,
    /// Boxes of things that may be found and need not be. What is found there and fits no truth does not count at all.
    pub ignored: Vec<[f64; 4]>,
}

/// How to compare.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackOptions {
    /// Intersection over union from which MOTA and IDF1 take a box for the right one, above 0 up to 1.
    pub iou: f64,
    /// Intersection over union below which a box is a ghost, above 0 up to 1.
    pub ghost_iou: f64,
    /// Maps the world of what was found to that of the truth, for errors of position and of velocity; `None` when that is not known.
    pub truth_from_found: Option<Se3>,
}

impl Default for TrackOptions {
    fn default() -> Self {
        Self {
            iou: 0.5,
            ghost_iou: 0.3,
            truth_from_found: None,
        }
    }
}

/// What a comparison of tracks gave.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackScore {
    /// Frames compared.
    pub frames: usize,
    /// Things that there are, over all frames.
    pub truth_ids: usize,
    /// Numbers that were given to what was found, without those that were ignored throughout.
    pub found_ids: usize,
    /// HOTA, the mean over its thresholds.
    pub hota: Hota,
    /// MOTA and what it is made of.
    pub clear: Clear,
    /// IDF1 and what it is made of.
    pub identity: Identity,
    /// Boxes per frame that no thing is under.
    pub ghosts_per_frame: f64,
    /// Errors of the matched boxes that have a motion.
    pub motion: MotionErrors,
}

/// Compares tracks with the truth. Frames are in the order of time.
#[must_use]
pub fn track_score(frames: &[TrackFrame], options: &TrackOptions) -> TrackScore {
    let kept: Vec<TrackFrame> = frames.iter().map(ignored::without_ignored).collect();
    let table = Table::new(&kept);
    let (clear, matches) = clear::score(&table, options.iou);
    TrackScore {
        frames: kept.len(),
        truth_ids: table.truth_ids,
        found_ids: table.found_ids,
        hota: hota::score(&table),
        clear,
        identity: identity::score(&table, options.iou),
        ghosts_per_frame: clear::ghosts(&table, options.ghost_iou) as f64
            / kept.len().max(1) as f64,
        motion: motion::errors(&kept, &matches, options.truth_from_found.as_ref()),
    }
}

/// Intersection over union of two boxes, 0 to 1.
fn iou(a: &[f64; 4], b: &[f64; 4]) -> f64 {
    let area = |b: &[f64; 4]| (b[2] - b[0]).max(0.0) * (b[3] - b[1]).max(0.0);
    let common = area(&[
        a[0].max(b[0]),
        a[1].max(b[1]),
        a[2].min(b[2]),
        a[3].min(b[3]),
    ]);
    let union = area(a) + area(b) - common;
    if union > 0.0 { common / union } else { 0.0 }
}

/// The boxes of a frame by dense numbers, and how alike they are.
struct Row {
    truth: Vec<usize>,
    found: Vec<usize>,
    /// Intersection over union by truth, then found.
    alike: Vec<Vec<f64>>,
}

/// What all figures are made of.
struct Table {
    rows: Vec<Row>,
    truth_ids: usize,
    found_ids: usize,
    /// In how many frames each is.
    truth_count: Vec<f64>,
    found_count: Vec<f64>,
}

impl Table {
    fn new(frames: &[TrackFrame]) -> Self {
        let (mut truth, mut found) = (Numbers::default(), Numbers::default());
        let rows = frames
            .iter()
            .map(|f| Row {
                truth: f.truth.iter().map(|b| truth.of(b.id)).collect(),
                found: f.found.iter().map(|b| found.of(b.id)).collect(),
                alike: f
                    .truth
                    .iter()
                    .map(|t| f.found.iter().map(|d| iou(&t.bounds, &d.bounds)).collect())
                    .collect(),
            })
            .collect();
        Self {
            rows,
            truth_ids: truth.count.len(),
            found_ids: found.count.len(),
            truth_count: truth.count,
            found_count: found.count,
        }
    }
}

/// Dense numbers for ids, from 0, and how often each was asked for.
#[derive(Default)]
struct Numbers {
    known: BTreeMap<u32, usize>,
    count: Vec<f64>,
}

impl Numbers {
    fn of(&mut self, id: u32) -> usize {
        let next = self.count.len();
        let n = *self.known.entry(id).or_insert(next);
        if n == next {
            self.count.push(0.0);
        }
        self.count[n] += 1.0;
        n
    }
}

/// A share, 0 of nothing.
fn share(part: f64, whole: f64) -> f64 {
    part / whole.max(1.0)
}
