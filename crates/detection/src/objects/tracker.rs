//! Tracker of all objects, from detections to predictions.

use super::associate::associate;
use super::duplicates;
use super::expected::Expected;
use super::kind::liveliness;
use super::lost::Memory;
use super::measurement::Measurement;
use super::occlusion::Occlusion;
use super::track::Track;
use super::vertical::Vertical;
use super::view::View;
use super::{Object, ObjectId, ObjectsConfig};
use crate::{Detection, Detections};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::CoarseDepth;

/// Share of the parking time after which a thing that does not move by itself is parked (section 14 of
/// docs/algorithm.md).
const THINGS_PARK: f64 = 0.33;
/// Object tracker: an extended Kalman filter per object, detections assigned by the Hungarian method.
///
/// The state refers to the newest detections' stamp; [`Self::predict`] gives predictions for other times. Objects are
/// upright along the estimated vertical, to which the cameras were held most nearly level. Source: Bar-Shalom, Li,
/// Kirubarajan, Estimation with Applications to Tracking and Navigation, 2001.
#[derive(Clone, Debug)]
pub struct ObjectTracker {
    config: ObjectsConfig,
    camera: Camera,
    limits: [f64; 4],
    vertical: Vertical,
    stamp: Option<f64>,
    tracks: Vec<Track>,
    memory: Memory,
    next_id: u32,
    ignored: u64,
}

/// Maximum detections processed per frame, by score: the output size of transformers (RT-DETR: Zhao et al., CVPR 2024),
/// and three times that of benchmarks (COCO: Lin et al., ECCV 2014). The work grows with the square of their number, 4
/// ms for this one (docs/robustness.md). Also the maximum number of tracked objects.
pub const MOST_DETECTIONS: usize = 300;

/// The processed detections, in their original order.
fn strongest(all: &[Detection]) -> Vec<&Detection> {
    if all.len() <= MOST_DETECTIONS {
        return all.iter().collect();
    }
    let mut order: Vec<usize> = (0..all.len()).collect();
    order.sort_by(|&i, &j| all[j].score.total_cmp(&all[i].score).then(i.cmp(&j)));
    order.truncate(MOST_DETECTIONS);
    order.sort_unstable();
    order.into_iter().map(|i| &all[i]).collect()
}

impl ObjectTracker {
    /// An empty tracker, for a camera whose raw images the detector sees.
    #[must_use]
    pub fn new(config: ObjectsConfig, camera: Camera) -> Self {
        Self {
            limits: camera.undistorted_bounds(),
            config,
            camera,
            vertical: Vertical::default(),
            stamp: None,
            tracks: Vec::new(),
            memory: Memory::default(),
            next_id: 0,
            ignored: 0,
        }
    }

    /// Forgets all objects after a change of the frame of reference or the clock. Ids continue.
    pub fn forget(&mut self) {
        self.tracks.clear();
        self.memory.clear();
        self.stamp = None;
        self.vertical = Vertical::default();
    }

    /// Updates the tracker with the detections of one frame, possibly some frames old, with the camera's pose and the
    /// depth of that frame.
    ///
    /// Detections that are not newer than the last ones, or whose stamp or pose is not finite, are ignored and counted:
    /// see [`Self::ignored`]. Boxes that are not finite or not in the image are ignored, and of more than
    /// [`MOST_DETECTIONS`] those of the lowest scores.
    pub fn update(
        &mut self,
        detections: &Detections,
        world_from_camera: &Se3,
        depth: &CoarseDepth,
    ) {
        let stamp = detections.stamp;
        let late = self.stamp.is_some_and(|last| stamp <= last);
        if late || !stamp.is_finite() || !world_from_camera.is_finite() {
            self.ignored += 1;
            return;
        }
        self.advance(stamp);
        let down = self.vertical.observe(world_from_camera);
        let camera = self.camera;
        let view = View::new(&camera, self.limits, world_from_camera, &down);
        let measurements = strongest(&detections.items)
            .into_iter()
            .filter_map(|d| Measurement::new(&view, d, depth));
        let measurements = duplicates::one_name_each(measurements.collect());
        let share = self.config.side_sigma;
        let assigned = associate(&self.tracks, &view, depth, &measurements, share);
        let mut taken = vec![false; measurements.len()];
        for (track, found) in self.tracks.iter_mut().zip(assigned) {
            match found {
                Some((j, m)) => {
                    track.absorb(&view, &m, stamp, share);
                    track.settle(&down);
                    taken[j] = true;
                }
                None => {
                    track.misses += 1;
                    track.look(&view, depth);
                }
            }
        }
        self.begin(&view, depth, &measurements, &taken);
        // A formerly separate object may be a person in front of another.
        let ended = duplicates::merge(&mut self.tracks, &view);
        ended
            .iter()
            .filter(|t| t.known)
            .for_each(|t| self.memory.keep(t));
        // A single miss is weak evidence at any detector rate, as some detectors miss every third time.
        let patience = self.config.tentative_seconds;
        let waits = |t: &Track| t.misses < 2 || stamp - t.last_seen < patience;
        let memory = &mut self.memory;
        self.tracks.retain(|t| {
            let kept = (t.confirmed() || waits(t))
                && !(t.misses > 0 && (t.vague() || t.out_of_sight(stamp)));
            if !kept {
                memory.keep(t);
            }
            kept
        });
        self.memory.recognise(&mut self.tracks);
        for track in &mut self.tracks {
            track.end_update(stamp);
        }
    }

    fn begin(
        &mut self,
        view: &View,
        depth: &CoarseDepth,
        measurements: &[Measurement],
        taken: &[bool],
    ) {
        let is_new = |j: usize| {
            !taken[j] && !duplicates::part_of_another(&measurements[j], measurements, taken)
        };
        let new: Vec<usize> = (0..measurements.len()).filter(|j| is_new(*j)).collect();
        let (Some(stamp), false) = (self.stamp, new.is_empty()) else {
            return;
        };
        let expected: Vec<Expected> = self.tracks.iter().map(|t| t.expected(view)).collect();
        let occlusion = Occlusion::new(&self.tracks, &expected);
        for j in new
            .into_iter()
            .take(MOST_DETECTIONS.saturating_sub(self.tracks.len()))
        {
            let m = &measurements[j];
            let own = occlusion.around(m, depth).seen_of_new(m, depth);
            let id = ObjectId(self.next_id);
            self.next_id += 1;
            let share = self.config.side_sigma;
            self.tracks.push(Track::new(id, view, &own, stamp, share));
        }
    }

    /// Predicts all objects to a new stamp; ends those that coasted too long.
    fn advance(&mut self, stamp: f64) {
        let dt = self.stamp.map_or(0.0, |last| stamp - last);
        let coast = self.config.coast_seconds;
        self.memory.age(stamp);
        let memory = &mut self.memory;
        self.tracks.retain(|t| {
            let kept = stamp - t.last_seen <= t.patience(coast);
            if !kept {
                memory.keep(t);
            }
            kept
        });
        for track in &mut self.tracks {
            track.propagate(dt, self.config.acceleration);
        }
        self.stamp = Some(stamp);
    }

    /// The predicted objects at a stamp (s), seen from a camera pose, by id. Read-only, so that late detections need no
    /// special case. Stamps before the newest detections are predicted backwards.
    #[must_use]
    pub fn predict(&self, stamp: f64, world_from_camera: &Se3) -> Vec<Object> {
        let (Some(last), Some(down)) = (self.stamp, self.vertical.down()) else {
            return Vec::new();
        };
        if !stamp.is_finite() || !world_from_camera.is_finite() {
            return Vec::new();
        }
        let view = View::new(&self.camera, self.limits, world_from_camera, &down);
        let coast = self.config.coast_seconds;
        self.tracks
            .iter()
            .filter(|t| (stamp - t.last_seen).abs() <= coast)
            .map(|t| {
                let mut t = t.clone();
                t.propagate(stamp - last, self.config.acceleration);
                t.object(&view)
            })
            .collect()
    }

    /// Adds a result of the rigid test for an object at a stamp (s): the number of tested features that agree with a
    /// static scene. With hysteresis this makes it parked or moving. Unknown ids are ignored: the object may have
    /// ended.
    pub fn observe_rigidity(&mut self, id: ObjectId, stamp: f64, agreeing: u32, tested: u32) {
        let share = self.config.parked_share;
        if let Some(track) = self.tracks.iter_mut().find(|t| t.id == id) {
            // Walkers stand still when they turn round; things that stop stay.
            let lively = liveliness(track.class) >= 1.0;
            let seconds = self.config.parked_seconds * if lively { 1.0 } else { THINGS_PARK };
            track
                .rigidity
                .observe(stamp, [agreeing, tested], share, seconds);
        }
    }

    /// Number of ignored calls of [`Self::update`]: detections out of order, or without finite stamp and pose.
    #[must_use]
    pub fn ignored(&self) -> u64 {
        self.ignored
    }

    /// Stamp of the newest detections, s.
    #[must_use]
    pub fn stamp(&self) -> Option<f64> {
        self.stamp
    }
}
