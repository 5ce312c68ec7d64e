//! Health: the quality of the pose and state of the run at a frame, for people and programs that rely on the pose.
//!
//! Reports quality and covariance of the pose, moving shares, age of detections and map, and the cause of a loss. A
//! pure function of the tracker's inputs and outputs with times from stamps, so a replay reproduces it. No stage
//! depends on it.

mod crowd;
mod loss;
mod quality;

pub use loss::{Loss, LossCause};
pub use quality::Quality;

use crate::config::Config;
use crate::covariance::{MapCovariance, covariance_in_map, covariance_of_motion};
use crate::inertial::InertialState;
use crate::messages::Tracked;
use crate::odometry::OdometryState;
use crate::report::{LostReason, Outcome};
use crate::shutter::TYPICAL_DEPTH;
use crate::tracking::MIN_INITIAL_POINTS;
use crowd::Crowd;
use loss::{Clues, Look, percent};
use quality::Measured;
use stillpoint_detection::{Detections, MotionWeights};
use stillpoint_estimation::pose_covariance;
use stillpoint_geometry::{Mat6, Se3};
use stillpoint_imaging::{FrameId, RgbdFrame, Standstill};
use stillpoint_map::MapView;

/// Standard deviation of the speed at which a pose that follows a moving person is displaced, per axis, m/s; it
/// rotates by as much at [`TYPICAL_DEPTH`]. People walk at 1 m/s, and one start in some follows a person.
const CARRIED_M_S: f64 = 0.2;

/// Tracking health at a frame.
#[derive(Clone, Debug, PartialEq)]
pub struct Health {
    /// The frame.
    pub frame: FrameId,
    /// Its colour stamp, s.
    pub stamp: f64,
    /// Tracking quality; zeros if lost.
    pub quality: Quality,
    /// Covariance of the pose `world_from_camera`, as a twist `[translation; rotation]` (m^2, m rad, rad^2) in camera
    /// axes: `truth = world_from_camera * exp(e)` with e of this covariance. The truth is relative to the origin of the
    /// map or submap; the error of the map is included, as is, while it is undecided which surfaces move, displacement
    /// with them. `None` without a pose, for the first frame of a map (exact by definition), and if the measurements
    /// leave a direction unconstrained.
    pub covariance: Option<Mat6>,
    /// The part due to this frame's pose in the map around it; zero for the first frame of a map. For the motion
    /// between nearby poses see [`Health::covariance_since`].
    pub covariance_in_map: Option<Mat6>,
    /// Share of static keypoints; 0, like [`Health::dynamic_share`], if the frame was lost before the static filter
    /// ran.
    pub static_share: f64,
    /// Share of moving keypoints, including those used nevertheless because too few static ones remain.
    pub dynamic_share: f64,
    /// Share of the pixels that have depth.
    pub depth_share: f64,
    /// Age of the newest detections known to tracking, by stamps, s; `None` before the first.
    pub detections_age: Option<f64>,
    /// Time since tracking received its current view of the map, s; `None` before the first change of the map.
    pub map_age: Option<f64>,
    /// Whether it is undecided which surfaces move, so that the pose may follow a moving object. This happens at the
    /// beginning of a map, where the covariance allows for it and the pose may be replaced later, and when few
    /// landmarks agree while much moves.
    pub undecided: bool,
    /// Why there is no pose; `None` if there is one.
    pub loss: Option<Loss>,
    /// Static part of the frame.
    pub still: Option<Standstill>,
    /// State of the inertial sensor, if there is one.
    pub inertial: Option<InertialState>,
    /// State of the odometry, if there is one.
    pub odometry: Option<OdometryState>,
}

impl Health {
    /// Standard deviation of the position, m: root of the sum of its three variances.
    #[must_use]
    pub fn sigma_m(&self) -> Option<f64> {
        self.covariance.as_ref().map(|c| block_sigma(c, 0))
    }

    /// Standard deviation of the rotation, rad: root of the sum of its three variances.
    #[must_use]
    pub fn sigma_rad(&self) -> Option<f64> {
        self.covariance.as_ref().map(|c| block_sigma(c, 3))
    }

    /// Covariance of the motion from an earlier frame to this one, `[translation; rotation]` in the axes of the camera
    /// here, m and rad. Errors of the map and other lasting errors cancel. While it is undecided which surfaces move,
    /// it allows for displacement with them. `None` if either pose has no covariance.
    #[must_use]
    pub fn covariance_since(&self, before: &Self, before_from_here: &Se3) -> Option<Mat6> {
        let (earlier, later) = (before.covariance_in_map?, self.covariance_in_map?);
        let seconds = self.stamp - before.stamp;
        let sum = covariance_of_motion(&earlier, &later, before_from_here, seconds);
        Some(carried(sum, self.undecided.then_some(seconds)))
    }

    /// The covariance in world axes, as in ROS: of the position `[x, y, z]`, m, and of a rotation about the world's
    /// axes, rad.
    #[must_use]
    pub fn covariance_in_world(&self, world_from_camera: &Se3) -> Option<Mat6> {
        let r = world_from_camera.rotation_matrix();
        let mut turn = Mat6::zeros();
        turn.fixed_view_mut::<3, 3>(0, 0).copy_from(&r);
        turn.fixed_view_mut::<3, 3>(3, 3).copy_from(&r);
        self.covariance.map(|c| turn * c * turn.transpose())
    }
}

/// Adds the displacement with a moving object within `undecided` seconds to a pose's covariance.
fn carried(mut covariance: Mat6, undecided: Option<f64>) -> Mat6 {
    let since = undecided.unwrap_or(0.0);
    for (i, speed) in [CARRIED_M_S, CARRIED_M_S / TYPICAL_DEPTH]
        .into_iter()
        .enumerate()
    {
        for axis in 3 * i..3 * i + 3 {
            covariance[(axis, axis)] += (speed * since) * (speed * since);
        }
    }
    covariance
}

fn block_sigma(covariance: &Mat6, at: usize) -> f64 {
    let variance = |i: usize| covariance[(at + i, at + i)];
    (variance(0) + variance(1) + variance(2)).sqrt()
}

/// One line, e.g. `quality 0.82 | +-1.3 mm 0.05 deg | static 81 % | detection 0.12 s ago | map 0.4 s ago`, or the cause
/// of the loss.
impl std::fmt::Display for Health {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "quality {:.2}", self.quality.value())?;
        if let Some(loss) = &self.loss {
            return write!(f, " | {loss}");
        }
        if let (Some(m), Some(rad)) = (self.sigma_m(), self.sigma_rad()) {
            let (mm, deg) = (1e3 * m, rad.to_degrees());
            write!(f, " | +-{mm:.1} mm {deg:.2} deg")?;
        }
        if self.undecided {
            write!(f, " | undecided who moves")?;
        }
        write!(f, " | static {} %", percent(self.static_share))?;
        if let Some(still) = &self.still {
            write!(f, " | {still}")?;
        }
        if let Some(age) = self.detections_age {
            write!(f, " | detection {age:.2} s ago")?;
        }
        if let Some(age) = self.map_age {
            write!(f, " | map {age:.1} s ago")?;
        }
        if let Some(state @ InertialState::Ignored(_)) = self.inertial {
            write!(f, " | inertial sensor {state}")?;
        }
        if let Some(state @ OdometryState::Ignored(_)) = self.odometry {
            write!(f, " | odometry {state}")?;
        }
        Ok(())
    }
}

/// Computes the health of each frame of a run. The driver passes the detections that the tracker receives, and its
/// reports, in order.
#[derive(Clone, Debug)]
pub struct HealthMonitor {
    weights: MotionWeights,
    /// Minimum number of inliers of a pose, and of points with depth to start a map.
    min_inliers: u32,
    min_initial_points: u32,
    crowd: Crowd,
    before: Option<f64>,
    version: Option<u64>,
    /// Stamp of the first frame with the current version; `None` before the first change.
    mapped: Option<f64>,
    /// First frame of the current loss, and its stamp.
    lost: Option<(FrameId, f64)>,
    map: MapCovariance,
}

impl HealthMonitor {
    /// A monitor before the first frame.
    #[must_use]
    pub fn new(config: &Config) -> Self {
        Self {
            weights: config.motion_weights.clone(),
            min_inliers: config.tracking.min_inliers as u32,
            min_initial_points: MIN_INITIAL_POINTS as u32,
            crowd: Crowd::default(),
            before: None,
            version: None,
            mapped: None,
            lost: None,
            map: MapCovariance::default(),
        }
    }

    /// Records detections that the tracker received.
    pub fn receive(&mut self, detections: &Detections) {
        self.crowd.observe(detections, &self.weights);
    }

    /// Shifts stored stamps if the clock was set back since the last frame.
    fn handle_clock(&mut self, stamp: f64) {
        let Some(before) = self.before.replace(stamp).filter(|b| stamp <= *b) else {
            return;
        };
        let by = stamp - before;
        self.crowd.set_clock(by);
        self.mapped = self.mapped.map(|stamp| stamp + by);
        self.lost = self.lost.map(|(frame, stamp)| (frame, stamp + by));
    }

    /// Health of a frame from the tracker's report and its current version of the map.
    pub fn judge(&mut self, frame: &RgbdFrame, tracked: &Tracked, view: &MapView) -> Health {
        let Tracked {
            report, evidence, ..
        } = tracked;
        self.handle_clock(report.stamp);
        let stamp = report.stamp;
        // Detections may belong to a later frame.
        let age = |since: f64| (stamp - since).max(0.0);
        if self.version.is_some_and(|v| v != report.map_version) {
            self.mapped = Some(stamp);
        }
        self.version = Some(report.map_version);
        let counts = &report.counts;
        let dynamic_share = counts.moving_share();
        let judged = evidence.judged && counts.keypoints > 0;
        let look = Look::at(frame);
        if judged {
            self.crowd.judge(stamp, dynamic_share);
        }
        let mut health = Health {
            frame: report.frame,
            stamp,
            quality: Quality::default(),
            covariance: None,
            covariance_in_map: None,
            undecided: report.is_undecided(),
            static_share: if judged { 1.0 - dynamic_share } else { 0.0 },
            dynamic_share,
            depth_share: look.depth,
            detections_age: self.crowd.detected().map(age),
            map_age: self.mapped.map(age),
            loss: None,
            still: report.still,
            inertial: report.inertial.map(|i| i.state),
            odometry: report.odometry.map(|o| o.state),
        };
        if let Outcome::Lost { reason, since } = report.outcome {
            health.loss = Some(self.loss(tracked, since, reason, look));
            return health;
        }
        self.lost = None;
        let begins = report.outcome == Outcome::Initialised;
        // Uses the stated variances: excess scatter already shows in the share of inliers.
        let stated = evidence.information.as_ref().and_then(pose_covariance);
        let stated = if begins { Some(Mat6::zeros()) } else { stated };
        health.quality = Quality::of(&Measured {
            agreed: evidence.agreed,
            matched: evidence.matched,
            needed: self.min_inliers,
            cells: evidence.cells,
            sigmas: stated.map(|c| (block_sigma(&c, 0), block_sigma(&c, 3))),
        });
        if begins {
            health.covariance_in_map = stated;
        } else {
            self.tell_covariance(tracked, view, &mut health);
        }
        health
    }

    fn tell_covariance(&mut self, tracked: &Tracked, view: &MapView, health: &mut Health) {
        let Tracked {
            report, evidence, ..
        } = tracked;
        self.map.follow(view);
        let information = evidence.information.as_ref();
        let in_map = information.and_then(|i| covariance_in_map(i, evidence.scatter.as_ref()));
        let Some(in_map) = in_map else {
            return;
        };
        // The first keyframe of a map is inserted late, and is exact.
        let own = tracked.keyframe.as_ref().filter(|k| k.reference.is_some());
        if let Some(keyframe) = own {
            self.map.note(keyframe.id, in_map);
        }
        let measured_from = evidence.reference.zip(report.world_from_camera);
        let of_map = measured_from.map(|(id, pose)| self.map.at(view, id, &pose));
        health.covariance_in_map = Some(in_map);
        health.covariance = Some(carried(
            in_map + of_map.unwrap_or_else(Mat6::zeros),
            report.undecided,
        ));
    }

    /// Describes the loss that began at frame `since`, as of the frame `tracked`.
    fn loss(&mut self, tracked: &Tracked, since: FrameId, reason: LostReason, look: Look) -> Loss {
        let Tracked {
            report, evidence, ..
        } = tracked;
        let lost = self.lost.filter(|(first, _)| *first == since);
        let (_, began) = *self.lost.insert(lost.unwrap_or((since, report.stamp)));
        let needed = if evidence.has_map {
            self.min_inliers
        } else {
            self.min_initial_points
        };
        Loss {
            since,
            seconds: (report.stamp - began).max(0.0),
            reason,
            cause: loss::cause(&Clues {
                reason,
                counts: &report.counts,
                look,
                moving: self.crowd.share(report.stamp, &report.verdicts),
                needed,
            }),
            can_recognise: evidence.has_map,
        }
    }
}

#[cfg(test)]
mod tests;
