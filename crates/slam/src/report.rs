//! What the stages report: of a frame, of a keyframe, of a correction, of a loop. Values, which events carry outward.

use crate::inertial::InertialReport;
use crate::loop_evidence::LoopEvidence;
use crate::map_shift::MapShift;
use crate::odometry::OdometryReport;
use crate::static_filter::{FeatureVerdict, Segments};
use std::sync::Arc;
use stillpoint_detection::Object;
use stillpoint_geometry::Se3;
use stillpoint_imaging::{FrameId, Standstill};
use stillpoint_map::{Join, KeyframeId, SubmapId};

/// What became of a frame's pose.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Outcome {
    /// The first frame of a map or a submap of one; its pose is where that begins.
    Initialised,
    /// The pose was measured in this frame.
    Tracked,
    /// The camera was found again, near where it was lost or anywhere in the map.
    Relocalised {
        /// The first frame of the loss that ends here; this frame itself where there was none.
        since: FrameId,
        /// The keyframe that was recognised.
        with: KeyframeId,
    },
    /// Too little was seen to measure a pose: the camera is carried by odometry, or its direction by the gyroscope and its place by what little was seen or by its
    /// velocity.
    Carried {
        /// The first frame of this stretch.
        since: FrameId,
    },
    /// No pose could be measured.
    Lost {
        /// The first frame of this loss.
        since: FrameId,
        /// Why this frame gave no pose.
        reason: LostReason,
    },
}

/// Why a frame gave no pose.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LostReason {
    /// Not enough keypoints in the image: black, covered or without texture.
    FewFeatures,
    /// Not enough keypoints with depth to begin a map.
    FewDepths,
    /// Not enough keypoints matched landmarks.
    FewMatches,
    /// Too few matches agreed on one pose.
    FewInliers,
    /// What was seen turns otherwise than the gyroscope, and the gyroscope could not carry the camera any longer.
    AgainstGyro,
    /// What was seen moves otherwise than the wheels, and these could not carry the camera any longer.
    AgainstOdometry,
    /// The colour image is that of the frame before: no new view.
    Repeated,
}

impl std::fmt::Display for LostReason {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::FewFeatures => "too few keypoints in the image",
            Self::FewDepths => "too few keypoints with depth",
            Self::FewMatches => "too few keypoints match the map",
            Self::FewInliers => "too few matches agree on a pose",
            Self::AgainstGyro => "what is seen turns otherwise than the gyroscope",
            Self::AgainstOdometry => "what is seen moves otherwise than the wheels",
            Self::Repeated => "the image is that of the frame before",
        })
    }
}

/// The tracker's report on one frame.
#[derive(Clone, Debug)]
pub struct FrameReport {
    /// The frame.
    pub frame: FrameId,
    /// Its colour stamp, s.
    pub stamp: f64,
    /// Whether a pose was measured.
    pub outcome: Outcome,
    /// The pose as known at this frame, when one was measured in it.
    pub world_from_camera: Option<Se3>,
    /// Time since the map was begun, s, while it is undecided who moves: until then the pose may ride on somebody, and may be replaced
    /// later. None once that is decided.
    pub undecided: Option<f64>,
    /// What the static filter said of each keypoint, and was used for this frame's pose; in the order of extraction.
    pub verdicts: Arc<[FeatureVerdict]>,
    /// The regions that move.
    pub segments: Segments,
    /// The objects as they are expected in this frame: number, class, box in the raw image, whether they move or are parked, and where
    /// depth was seen, position and velocity with their covariance. Those are in the world of the map version `map_version` and of
    /// the pose that the frame had on its way; [`Object::seen_from`] brings them to a camera. None for a frame that was lost
    /// before the static filter was asked.
    pub objects: Arc<[Object]>,
    /// Counts of each step.
    pub counts: FrameCounts,
    /// What of the frame stands still: it is tracked without a depth image that does, and has no pose where the colour image does.
    pub still: Option<Standstill>,
    /// The frame became a keyframe.
    pub is_keyframe: bool,
    /// The submap that the pose is in, by what was known at this frame; none without a pose.
    pub submap: Option<SubmapId>,
    /// Version of the map view that was used.
    pub map_version: u64,
    /// What is known of the inertial sensor; none where there is none.
    pub inertial: Option<InertialReport>,
    /// What is known of the odometry; none where there is none.
    pub odometry: Option<OdometryReport>,
}

/// So many landmarks that agree hold a pose, whatever moves beside them, and tell what a sensor errs by, a number: poses of 49 and 47 were off by 100 and 119 mm (fr1_rpy_walkers,
/// decision 30).
pub(crate) const HOLDING: u32 = 60;
/// Where at least this share of the keypoints moves, those who move can be a large group: with [`HOLDING`], every frame of the starts of fr1_rpy_walkers
/// that is off by more than 100 mm is undecided (decision 30).
const MANY: f64 = 0.3;

impl FrameReport {
    /// Whether it is undecided who moves: the map has just begun, or so few landmarks hold the pose, beside so much that moves, that it may ride
    /// on somebody for this frame.
    #[must_use]
    pub fn is_undecided(&self) -> bool {
        let posed = matches!(self.outcome, Outcome::Tracked | Outcome::Relocalised { .. });
        let thin = self.counts.inliers < HOLDING && self.counts.moving_share() >= MANY;
        self.undecided.is_some() || (posed && thin)
    }
}

/// How many features each step of tracking dealt with, and which detections it could not use.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct FrameCounts {
    /// Extracted keypoints.
    pub keypoints: u32,
    /// Keypoints rejected because they move.
    pub dynamic: u32,
    /// Of those that move, keypoints used all the same because too few others were left.
    pub released: u32,
    /// Keypoints with a usable depth.
    pub with_depth: u32,
    /// Matches to the last frame (or the reference keyframe).
    pub frame_matches: u32,
    /// Landmarks of the local map in the field of view.
    pub local_visible: u32,
    /// Matches to landmarks that entered the final pose.
    pub map_matches: u32,
    /// Of these, matches that agree with the final pose.
    pub inliers: u32,
    /// Answers of the detector that came since the frame before and were too late to be used: they are about a frame that is
    /// not remembered any more (for 3.2 s it is).
    pub detections_too_late: u32,
    /// Answers of the detector that came since the frame before, or were there in time for this one, and could not be used
    /// because the frame they are about has no pose.
    pub detections_without_pose: u32,
}

impl FrameCounts {
    /// Share of the keypoints that move, among them those that are used all the same.
    #[must_use]
    pub fn moving_share(&self) -> f64 {
        f64::from(self.dynamic + self.released) / f64::from(self.keypoints.max(1))
    }
}

/// The mapper's report on one keyframe.
#[derive(Clone, Debug)]
pub struct MappingReport {
    /// The keyframe.
    pub keyframe: KeyframeId,
    /// Version of the published view.
    pub map_version: u64,
    /// Live keyframes in it.
    pub keyframes: usize,
    /// Live landmarks in it.
    pub landmarks: usize,
    /// Landmarks made from depth at this keyframe.
    pub created_from_depth: u32,
    /// Landmarks made by triangulation.
    pub triangulated: u32,
    /// Landmarks that turned out to be the same as another.
    pub fused: u32,
    /// Landmarks removed.
    pub culled_landmarks: u32,
    /// Keyframes removed as redundant.
    pub culled_keyframes: u32,
    /// Keyframes, landmarks and observations in local bundle adjustment; zeros when it was not run.
    pub bundle: BundleCounts,
}

/// What late detections took out of the map.
#[derive(Clone, Debug)]
pub struct RejudgeReport {
    /// The keyframe they were about.
    pub keyframe: KeyframeId,
    /// Version of the published view.
    pub map_version: u64,
    /// Landmarks removed.
    pub landmarks: u32,
}

/// What was taken back of the beginning of a map.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct RevokeReport {
    /// The first id that a keyframe of it may have.
    pub first: KeyframeId,
    /// The last one.
    pub last: KeyframeId,
    /// Version of the published view.
    pub map_version: u64,
    /// Keyframes removed.
    pub keyframes: u32,
}

/// What became of a correction.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct CorrectionReport {
    /// Version of the published view.
    pub map_version: u64,
    /// Version that was corrected.
    pub base_version: u64,
    /// Keyframes that it named and that were still there.
    pub keyframes: u32,
    /// Of these, the ones that local bundle adjustment had moved since.
    pub composed: u32,
    /// Keyframes made since, to which the correction was propagated.
    pub propagated: u32,
    /// Landmarks that became others.
    pub merged: u32,
    /// What moved, however little.
    pub moved: MapShift,
}

/// What became of a candidate for a loop: an older keyframe that may show the same place.
#[derive(Clone, Debug)]
pub struct LoopReport {
    /// The keyframe that showed it.
    pub keyframe: KeyframeId,
    /// The keyframe that showed it before.
    pub with: KeyframeId,
    /// How alike both look, 0 to 1; 0 where the map named the place, and nobody asked.
    pub score: f64,
    /// How alike what looks most like it elsewhere on the map is.
    pub rival: f64,
    /// Pairs of points that agree on one rigid motion.
    pub rigid_inliers: u32,
    /// Landmarks around `with` that are seen where that motion puts them.
    pub inliers: u32,
    /// Landmarks around `with` that are in the image there, hidden ones too.
    pub expected: u32,
    /// Keyframes that told the same of the place, this one among them; 0 without a motion.
    pub agreeing: u32,
    /// Pose of `keyframe` relative to `with`, once it is known.
    pub edge: Option<Se3>,
    /// The submaps that became one by it.
    pub joined: Option<Join>,
    /// Squared Mahalanobis distance between the loop's motion and the map's, by what the path between both may have drifted: 6 on
    /// average where that is told exactly. 0 for submaps, which nothing ties.
    pub cost: f64,
    /// What speaks for it; none without a motion.
    pub evidence: Option<LoopEvidence>,
    /// Landmarks that turned out to be others seen before.
    pub merges: u32,
    /// Farthest that a keyframe was moved, m.
    pub moved_m: f64,
    /// Full bundle adjustment; zeros when it was not run.
    pub bundle: BundleCounts,
    /// Whether the loop was closed.
    pub outcome: LoopOutcome,
    /// What applying the correction did; none until then, and in [`Event::Looped`](crate::Event::Looped).
    pub applied: Option<CorrectionReport>,
}

/// Whether a loop was closed, or for what reason the candidate was set aside.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum LoopOutcome {
    /// The map was corrected.
    Closed,
    /// Too few points of both keyframes agree on one rigid motion.
    NoRigidMotion,
    /// Too few landmarks were seen where that motion puts them to measure one.
    FewInliers,
    /// The place lies farther from where the map expects it than the path can have drifted: it is an equal one.
    Elsewhere,
    /// Too little speaks for it so far.
    TooLittle,
}

impl LoopOutcome {
    /// Whether the candidate was set aside: what every place that is passed for the first time and looks like another comes to.
    #[must_use]
    pub fn is_set_aside(self) -> bool {
        self != Self::Closed
    }
}

impl std::fmt::Display for LoopOutcome {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(match self {
            Self::Closed => "closed",
            Self::NoRigidMotion => "set aside: too few points agree on one motion",
            Self::FewInliers => "set aside: too few landmarks are where they should be",
            Self::Elsewhere => "set aside: an equal place elsewhere on the map",
            Self::TooLittle => "set aside: too little speaks for it so far",
        })
    }
}

/// Size and effort of one local bundle adjustment.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct BundleCounts {
    /// Keyframes whose poses were free.
    pub free_keyframes: u32,
    /// Keyframes that only held the window in place.
    pub fixed_keyframes: u32,
    /// Landmarks.
    pub landmarks: u32,
    /// Observations.
    pub observations: u32,
    /// Observations removed as outliers.
    pub outliers: u32,
    /// Iterations.
    pub iterations: u32,
}
