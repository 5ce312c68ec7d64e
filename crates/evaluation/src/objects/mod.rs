//! Scores of object tracking: HOTA, MOTA, IDF1, ghosts, and errors of position and velocity.
//!
//! Uses the field's definitions: HOTA (Luiten et al., "HOTA: A higher order metric for evaluating multi-object tracking", IJCV 2021), CLEAR
//! MOT (Bernardin, Stiefelhagen, "Evaluating multiple object tracking performance", 2008), IDF1 (Ristani et al., "Performance measures and
//! a data set for multi-target, multi-camera tracking", 2016). Results agree with the Python package `trackeval`. Knows boxes, not images.

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

/// Position and velocity of an object in the world.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct PointMotion {
    /// Position, m.
    pub position: Vec3,
    /// Velocity, m/s.
    pub velocity: Vec3,
}

/// The box of an object in a frame.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackedBox {
    /// Id, the same in all frames.
    pub id: u32,
    /// Left, upper, right and lower border, px.
    pub bounds: [f64; 4],
    /// Its motion, if known.
    pub motion: Option<PointMotion>,
}

/// True and found boxes of a frame.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct TrackFrame {
    /// Time, s.
    pub stamp: f64,
    /// True boxes; ids are unique.
    pub truth: Vec<TrackedBox>,
    /// Found boxes; ids are unique.
    pub found: Vec<TrackedBox>,
    /// Boxes of objects that may be found and need not be. Found boxes there that match no truth do not count at all.
    pub ignored: Vec<[f64; 4]>,
}

/// Options of the comparison.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct TrackOptions {
    /// Minimum intersection over union of a right box for MOTA and IDF1, above 0 up to 1.
    pub iou: f64,
    /// Intersection over union below which a box is a ghost, above 0 up to 1.
    pub ghost_iou: f64,
    /// Maps the world of the found boxes to that of the truth, for errors of position and of velocity; `None` if unknown.
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

/// Result of a comparison of tracks.
#[derive(Clone, Debug, PartialEq)]
pub struct TrackScore {
    /// Frames compared.
    pub frames: usize,
    /// Number of true objects, over all frames.
    pub truth_ids: usize,
    /// Number of found ids, except those ignored throughout.
    pub found_ids: usize,
    /// HOTA, the mean over its thresholds.
    pub hota: Hota,
    /// MOTA and its components.
    pub clear: Clear,
    /// IDF1 and its components.
    pub identity: Identity,
    /// Boxes per frame without an object.
    pub ghosts_per_frame: f64,
    /// Errors of the matched boxes that have a motion.
    pub motion: MotionErrors,
}

/// Compares tracks with the truth. Frames are in order of time.
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

/// The boxes of a frame by dense indices, and their overlaps.
struct Row {
    truth: Vec<usize>,
    found: Vec<usize>,
    /// Intersection over union by truth, then found.
    alike: Vec<Vec<f64>>,
}

struct Table {
    rows: Vec<Row>,
    truth_ids: usize,
    found_ids: usize,
    /// Number of frames of each.
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

/// Dense indices of ids, from 0, and the count of each.
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

/// A fraction; 0 if the whole is 0.
fn share(part: f64, whole: f64) -> f64 {
    part / whole.max(1.0)
}
