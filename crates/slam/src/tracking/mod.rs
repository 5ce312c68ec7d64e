//! Tracking: the pose of every frame, and which frames the map needs.
//!
//! Owns the motion model and the last frame; sees the map only as a view. Does not change the map.

mod config;
mod flow;
mod frame;
mod keyframe;
mod last_frame;
mod local_map;
pub(crate) mod matching;
mod motion;
mod pose;
mod self_calibration;
mod sight;

pub(crate) use pose::measurement;

pub use config::TrackingConfig;
pub use keyframe::KeyframeConfig;

use crate::config::Config;
use crate::event::{FrameCounts, FrameReport, LostReason, Outcome};
use crate::messages::{LandmarkStatistic, MapperMsg, NewKeyframe, Tracked};
use crate::sensor::Timing;
use crate::static_filter::{
    FeatureVerdict, FlowPair, FrameInput, Judgement, Place, Preset, StaticFilter,
};
use crate::trajectory::{Trajectory, TrajectoryEntry};
use frame::Observer;
use local_map::{LocalMap, SearchArea};
use matching::Matches;
use motion::Motion;
use self_calibration::SelfCalibration;
use sight::{DepthSight, Sight};
use std::collections::BTreeMap;
use std::sync::Arc;
use stillpoint_detection::Detections;
use stillpoint_geometry::{Camera, Se3, Vec3, Vec6};
use stillpoint_imaging::{FrameId, RgbdFrame, Simd};
use stillpoint_map::{KeyframeData, KeyframeId, LandmarkId, MapView};

/// The last frame whose pose is known.
struct LastFrame {
    stamp: f64,
    data: Arc<KeyframeData>,
    matches: Vec<Option<LandmarkId>>,
    reference: KeyframeId,
    reference_from_camera: Se3,
    /// The pose in the view of that time; used until the view holds the reference keyframe.
    world_from_camera: Se3,
}

/// Tracks the camera, frame by frame.
pub struct Tracker {
    config: Config,
    observer: Observer,
    filter: StaticFilter,
    view: Arc<MapView>,
    motion: Motion,
    calibration: SelfCalibration,
    last: Option<LastFrame>,
    /// The frame before, whatever became of it.
    previous: Option<Arc<RgbdFrame>>,
    local_map: LocalMap,
    lost_since: Option<FrameId>,
    last_keyframe: Option<FrameId>,
    statistics: BTreeMap<LandmarkId, LandmarkStatistic>,
    trajectory: Trajectory,
}

/// What is noted of a frame on its way.
#[derive(Default)]
struct Notes {
    counts: FrameCounts,
    judgement: Judgement,
}

/// A pose with all that led to it.
struct Solution {
    data: Arc<KeyframeData>,
    camera_from_world: Se3,
    reference: KeyframeId,
    matches: Vec<Option<LandmarkId>>,
}

impl Tracker {
    /// A tracker for one camera.
    #[must_use]
    pub fn new(config: Config, camera: Camera, simd: Simd) -> Self {
        Self {
            calibration: SelfCalibration::new(config.sensor.timing()),
            filter: StaticFilter::new(&config, &camera),
            observer: Observer::new(camera, config.sensor.clone(), &config.features, simd),
            config,
            view: Arc::default(),
            motion: Motion::default(),
            last: None,
            previous: None,
            local_map: LocalMap::default(),
            lost_since: None,
            last_keyframe: None,
            statistics: BTreeMap::new(),
            trajectory: Trajectory::default(),
        }
    }

    /// The frames tracked so far.
    #[must_use]
    pub fn trajectory(&self) -> &Trajectory {
        &self.trajectory
    }

    /// When the parts of a frame are exposed, as estimated so far.
    #[must_use]
    pub fn timing(&self) -> Timing {
        *self.calibration.timing()
    }

    /// The view in use.
    #[must_use]
    pub fn view(&self) -> Arc<MapView> {
        Arc::clone(&self.view)
    }

    /// Takes detections of the frame to come, or late ones. Returns what the mapper is to be told of earlier keyframes.
    pub fn receive_detections(&mut self, detections: Detections, next: FrameId) -> Vec<MapperMsg> {
        let late = detections.frame < next;
        self.filter.receive(detections);
        if !late {
            return Vec::new();
        }
        let view = Arc::clone(&self.view);
        let data = |f: FrameId| view.keyframe(KeyframeId(f.0)).map(|k| Arc::clone(&k.data));
        let rejudged = self.filter.take_late(&view, data);
        rejudged
            .into_iter()
            .map(|r| MapperMsg::Rejudge {
                keyframe: KeyframeId(r.frame.0),
                features: r.features,
            })
            .collect()
    }

    /// Takes a newer view of the map.
    pub fn receive(&mut self, view: Arc<MapView>) {
        self.view = view;
    }

    /// Tracks a frame.
    pub fn track(&mut self, frame: &Arc<RgbdFrame>) -> Tracked {
        let _span = tracing::info_span!("frame").entered();
        let tracked = self.track_frame(frame);
        self.previous = Some(Arc::clone(frame));
        tracked
    }

    fn track_frame(&mut self, frame: &RgbdFrame) -> Tracked {
        let mut notes = Notes::default();
        self.observer.extract(frame);
        let velocity = self.motion.velocity();
        let data = self
            .observer
            .measure(frame, velocity, self.calibration.timing(), None);
        // What is said of a frame that gives no pose: nothing against any feature.
        let kept = data
            .keypoints
            .iter()
            .map(|k| FeatureVerdict::kept([k.x, k.y]));
        notes.judgement.verdicts = kept.collect();
        notes.counts.keypoints = data.len() as u32;
        notes.counts.with_depth = data.depths.iter().filter(|z| **z > 0.0).count() as u32;
        if self.last.is_none() {
            return self.initialise(frame, &data, notes);
        }
        match self.locate(frame, data, &mut notes) {
            Ok(solution) => self.accept(frame, notes, solution),
            Err(reason) => self.lose(frame, notes, reason),
        }
    }

    /// Asks the static filter about the features `data` of a frame whose pose is about `world_from_camera`.
    fn judge(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        world_from_camera: &Se3,
        velocity: Option<&Vec6>,
        pairs: &[Option<FlowPair>],
        notes: &mut Notes,
    ) {
        let features: Vec<[f32; 2]> = data.keypoints.iter().map(|k| [k.x, k.y]).collect();
        let last = self.last.as_ref().map(|l| l.world_from_camera);
        notes.judgement = self.filter.judge(&FrameInput {
            frame,
            view: &self.view,
            world_from_camera: *world_from_camera,
            camera_from_depth: self.camera_from_depth(frame, velocity),
            features: &features,
            depths: &data.depths,
            pairs,
            last_from_now: last.unwrap_or_default().inverse() * *world_from_camera,
        });
        let verdicts = &notes.judgement.verdicts;
        notes.counts.dynamic = verdicts.iter().filter(|v| v.dynamic).count() as u32;
        notes.counts.released = notes.judgement.released;
    }

    /// The camera's motion from the depth image's exposure to the colour image's.
    fn camera_from_depth(&self, frame: &RgbdFrame, velocity: Option<&Vec6>) -> Se3 {
        let dt = frame.depth_stamp - frame.stamp - self.calibration.timing().depth_delay;
        velocity.map_or(Se3::identity(), |v| Se3::exp(&(v * dt)).inverse())
    }

    /// Begins a map with the first frame that has enough depth.
    fn initialise(&mut self, frame: &RgbdFrame, data: &KeyframeData, mut notes: Notes) -> Tracked {
        let pose = Se3::identity();
        self.judge(frame, data, &pose, None, &[], &mut notes);
        let timing = self.calibration.timing();
        let data = self
            .observer
            .measure(frame, None, timing, Some(&notes.judgement.verdicts));
        let counts = &notes.counts;
        if (counts.with_depth as usize) < self.config.tracking.min_initial_points {
            let few = (counts.keypoints as usize) < self.config.tracking.min_initial_points;
            let reason = if few {
                LostReason::FewFeatures
            } else {
                LostReason::FewDepths
            };
            return self.lose(frame, notes, reason);
        }
        let inliers = counts.with_depth;
        let id = KeyframeId(frame.id.0);
        let matches = vec![None; data.len()];
        self.remember(frame, &data, matches.clone(), id, Se3::identity(), pose);
        self.filter.remember(&Place {
            reference: id,
            reference_from_camera: Se3::identity(),
            world_from_camera: pose,
            camera_from_depth: Se3::identity(),
        });
        self.last_keyframe = Some(frame.id);
        self.lost_since = None;
        self.trajectory.push(TrajectoryEntry {
            frame: frame.id,
            stamp: frame.stamp,
            reference: id,
            reference_from_camera: Se3::identity(),
            online_world_from_camera: pose,
            inliers,
        });
        Tracked {
            report: self.report(frame, Outcome::Initialised, Some(pose), notes, true),
            keyframe: Some(NewKeyframe {
                id,
                data,
                reference: None,
                reference_from_camera: pose,
                matches,
                statistics: Vec::new(),
            }),
        }
    }

    /// Finds the pose: predict, match to the last frame, match to the local map, optimise.
    fn locate(
        &mut self,
        frame: &RgbdFrame,
        data: Arc<KeyframeData>,
        notes: &mut Notes,
    ) -> Result<Solution, LostReason> {
        if data.len() < self.config.tracking.min_inliers {
            return Err(LostReason::FewFeatures);
        }
        let (reference, predicted) = self.predict(frame.stamp);
        let mut pairs = self.flow(&data, &predicted);
        let by_flow = self.pose_by_flow(frame, &data, &pairs, &predicted);
        let (matches, pose) = self
            .match_last_frame(&data, reference, &by_flow.unwrap_or(predicted))
            .or_else(|lost| Ok((Matches::new(data.len()), by_flow.ok_or(lost)?)))?;
        notes.counts.frame_matches = matches.count as u32;
        self.recheck_flow(&data, &mut pairs, &pose);
        let velocity = self.velocity_to(&pose, frame.stamp);
        self.judge(
            frame,
            &data,
            &pose.inverse(),
            velocity.as_ref(),
            &pairs,
            notes,
        );
        let data = self.observer.measure(
            frame,
            velocity.as_ref(),
            self.calibration.timing(),
            Some(&notes.judgement.verdicts),
        );
        let matches = matches.without_dynamic(&notes.judgement.verdicts);
        let counts = &mut notes.counts;
        let (reference, found, pose) =
            self.match_local_map(frame, &data, reference, matches, &pose, counts);
        if let Some(v) = velocity.filter(|_| self.config.sensor.self_calibrate) {
            self.calibration
                .learn(&self.observer, &data, &found, &pose, &v);
        }
        let established = found.landmarks();
        let starved = established < self.config.tracking.min_inliers;
        let (found, pose) = match by_flow.filter(|_| starved) {
            Some(start) => self.bridge(&data, &pairs, &notes.judgement.verdicts, found, &start),
            None => (found, pose),
        };
        // Until the first view of the map arrives, and while flow bridges a gap, the last frame's own points are what there
        // is to track.
        let bridged = starved && by_flow.is_some();
        let inliers = if bridged || self.view.keyframe_count() == 0 {
            found.count
        } else {
            established
        };
        let matches: Vec<Option<LandmarkId>> = found
            .targets
            .iter()
            .map(|t| t.and_then(|t| t.landmark))
            .collect();
        counts.inliers = inliers as u32;
        if inliers < self.config.tracking.min_inliers {
            return Err(LostReason::FewInliers);
        }
        Ok(Solution {
            data,
            camera_from_world: pose,
            reference,
            matches,
        })
    }

    /// The velocity that a pose of this frame amounts to.
    fn velocity_to(&self, camera_from_world: &Se3, stamp: f64) -> Option<Vec6> {
        let last = self.last.as_ref().filter(|_| self.lost_since.is_none())?;
        motion::velocity(
            &last.world_from_camera.inverse(),
            camera_from_world,
            stamp - last.stamp,
        )
    }

    /// Expresses the last pose in the present view, then predicts. Returns the reference keyframe and
    /// `camera_from_world`.
    fn predict(&mut self, stamp: f64) -> (KeyframeId, Se3) {
        let Some(last) = &mut self.last else {
            return (KeyframeId(0), Se3::identity());
        };
        if let Some(w) = self.view.world_from_keyframe(last.reference) {
            last.world_from_camera = w * last.reference_from_camera;
        }
        let reference = self
            .view
            .resolve_keyframe(last.reference)
            .unwrap_or(last.reference);
        let last_from_world = last.world_from_camera.inverse();
        let predicted = self.motion.predict(&last_from_world, stamp - last.stamp);
        (reference, predicted)
    }

    /// Matches to the local map and optimises the pose with all that was found. Returns the new reference keyframe, the
    /// landmark of each inlier, and the pose.
    fn match_local_map(
        &mut self,
        frame: &RgbdFrame,
        data: &KeyframeData,
        reference: KeyframeId,
        mut matches: Matches,
        pose: &Se3,
        counts: &mut FrameCounts,
    ) -> (KeyframeId, Matches, Se3) {
        let span = tracing::info_span!("match").entered();
        let reference = self.local_map.update(&self.view, reference, &matches);
        let statistics = &mut self.statistics;
        let area = SearchArea {
            bounds: self.observer.bounds(),
            level_sigmas: self.observer.level_sigmas(),
            radius_px: self.config.tracking.local_radius as f32,
        };
        let sight = DepthSight {
            camera: &data.camera,
            image: &frame.depth,
        };
        let use_sight = self.config.static_filter.preset != Preset::Off;
        let look = |p: &Vec3| if use_sight { sight.of(p) } else { Sight::Open };
        let search = self
            .local_map
            .search(data, pose, &area, &mut matches, look, |id, sight| {
                let s = statistic(statistics, id);
                match sight {
                    // Of the landmarks that look hidden most are wrong, at the edge of something near: they must prove
                    // themselves like all others.
                    Sight::Open | Sight::Hidden => s.visible += 1,
                    Sight::Through => s.gone += 1,
                }
            });
        drop(span);
        counts.local_visible = search.visible;
        counts.map_matches = matches.count as u32;
        let (matches, pose) = pose::solve(data, pose, matches);
        for id in matches.targets.iter().flatten().filter_map(|t| t.landmark) {
            statistic(&mut self.statistics, id).found += 1;
        }
        (reference, matches, pose)
    }

    /// Takes a pose: motion model, trajectory, keyframe decision.
    fn accept(&mut self, frame: &RgbdFrame, notes: Notes, solution: Solution) -> Tracked {
        let counts = &notes.counts;
        let Solution {
            data,
            camera_from_world,
            reference,
            matches,
        } = solution;
        let world_from_camera = camera_from_world.inverse();
        match &self.last {
            Some(last) if self.lost_since.is_none() => self.motion.learn(
                &last.world_from_camera.inverse(),
                &camera_from_world,
                frame.stamp - last.stamp,
            ),
            _ => self.motion.forget(),
        }
        self.lost_since = None;
        let world_from_reference = self.view.world_from_keyframe(reference).unwrap_or_default();
        let reference_from_camera = world_from_reference.inverse() * world_from_camera;
        self.trajectory.push(TrajectoryEntry {
            frame: frame.id,
            stamp: frame.stamp,
            reference,
            reference_from_camera,
            online_world_from_camera: world_from_camera,
            inliers: counts.inliers,
        });
        self.filter.remember(&Place {
            reference,
            reference_from_camera,
            world_from_camera,
            camera_from_depth: self.camera_from_depth(frame, self.motion.velocity()),
        });
        let keyframe = self.make_keyframe(frame, &data, reference, reference_from_camera, &matches);
        self.remember(
            frame,
            &data,
            matches,
            reference,
            reference_from_camera,
            world_from_camera,
        );
        let outcome = Outcome::Tracked;
        Tracked {
            report: self.report(
                frame,
                outcome,
                Some(world_from_camera),
                notes,
                keyframe.is_some(),
            ),
            keyframe,
        }
    }

    fn make_keyframe(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        reference: KeyframeId,
        reference_from_camera: Se3,
        matches: &[Option<LandmarkId>],
    ) -> Option<NewKeyframe> {
        let _span = tracing::info_span!("keyframe").entered();
        let gap = self
            .last_keyframe
            .map_or(u32::MAX, |id| frame.id.0.saturating_sub(id.0));
        let config = &self.config.keyframes;
        let due = gap >= config.min_gap
            && config.is_due(
                &self.view,
                self.view.keyframe(reference)?,
                data,
                matches,
                self.config.sensor.close_depth,
            );
        if !due {
            return None;
        }
        self.last_keyframe = Some(frame.id);
        Some(NewKeyframe {
            id: KeyframeId(frame.id.0),
            data: Arc::clone(data),
            reference: Some(reference),
            reference_from_camera,
            matches: matches.to_vec(),
            statistics: std::mem::take(&mut self.statistics).into_values().collect(),
        })
    }

    fn remember(
        &mut self,
        frame: &RgbdFrame,
        data: &Arc<KeyframeData>,
        matches: Vec<Option<LandmarkId>>,
        reference: KeyframeId,
        reference_from_camera: Se3,
        world_from_camera: Se3,
    ) {
        self.last = Some(LastFrame {
            stamp: frame.stamp,
            data: Arc::clone(data),
            matches,
            reference,
            reference_from_camera,
            world_from_camera,
        });
    }

    fn lose(&mut self, frame: &RgbdFrame, notes: Notes, reason: LostReason) -> Tracked {
        self.motion.forget();
        let since = *self.lost_since.get_or_insert(frame.id);
        let outcome = Outcome::Lost { since, reason };
        Tracked {
            report: self.report(frame, outcome, None, notes, false),
            keyframe: None,
        }
    }

    fn report(
        &self,
        frame: &RgbdFrame,
        outcome: Outcome,
        world_from_camera: Option<Se3>,
        notes: Notes,
        is_keyframe: bool,
    ) -> FrameReport {
        FrameReport {
            frame: frame.id,
            stamp: frame.stamp,
            outcome,
            world_from_camera,
            verdicts: notes.judgement.verdicts,
            objects: notes.judgement.objects,
            segments: notes.judgement.segments,
            counts: notes.counts,
            is_keyframe,
            map_version: self.view.version(),
        }
    }
}

fn statistic(
    statistics: &mut BTreeMap<LandmarkId, LandmarkStatistic>,
    id: LandmarkId,
) -> &mut LandmarkStatistic {
    statistics.entry(id).or_insert(LandmarkStatistic {
        id,
        visible: 0,
        found: 0,
        gone: 0,
    })
}
