//! Messages between the stages.

use crate::evidence::Evidence;
use crate::report::{
    CorrectionReport, FrameReport, LoopReport, MappingReport, RejudgeReport, RevokeReport,
};
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_map::{Correction, KeyframeData, KeyframeId, LandmarkId, MapView};
use stillpoint_place::PlaceIndex;

/// The tracker's reply to a frame.
#[derive(Debug)]
pub struct Tracked {
    /// Tracking report.
    pub report: FrameReport,
    /// Statistics from which callers judge the quality of the pose.
    pub evidence: Evidence,
    /// The new keyframe, if the map needs one: this frame, or the one before if that started the map and waited for
    /// this frame.
    pub keyframe: Option<NewKeyframe>,
}

impl Tracked {
    pub(crate) fn is_passed_over(&self) -> bool {
        self.report.still.is_some_and(|s| s.what.is_no_view())
    }
}

/// A frame to be inserted as keyframe.
#[derive(Clone, Debug)]
pub struct NewKeyframe {
    /// Keyframe id.
    pub id: KeyframeId,
    /// Features.
    pub data: Arc<KeyframeData>,
    /// Reference keyframe of tracking; `None` for the first of a map.
    pub reference: Option<KeyframeId>,
    /// Pose relative to the reference; in world coordinates without one.
    pub reference_from_camera: Se3,
    /// Observed landmark of each feature.
    pub matches: Vec<Option<LandmarkId>>,
    /// Observation counts of landmarks since the last keyframe, sorted by id.
    pub statistics: Vec<LandmarkStatistic>,
    /// Exposure assumed for the measurements.
    pub exposure: Exposure,
}

impl NewKeyframe {
    /// Excludes features from creating landmarks.
    pub(crate) fn keep_out(&mut self, features: &[u32]) {
        let mappable = &mut Arc::make_mut(&mut self.data).mappable;
        for feature in features {
            if let Some(m) = mappable.get_mut(*feature as usize) {
                *m = false;
            }
        }
    }
}

/// Velocity and readout with which features were corrected to the frame's stamp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exposure {
    /// Camera velocity, twist per second; `None` if unknown, and then features are uncorrected.
    pub velocity: Option<Vec6>,
    /// Readout time of the shutter, s.
    pub readout: f64,
}

/// Observation counts of a landmark.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LandmarkStatistic {
    /// The landmark.
    pub id: LandmarkId,
    /// Frames with the landmark in the field of view.
    pub visible: u32,
    /// Frames in which it was matched as an inlier.
    pub found: u32,
    /// Frames in which the camera saw through its place.
    pub gone: u32,
    /// Weight of the frames in which it was found, in frames of 30 Hz, independent of the frame rate.
    pub found_worth: f32,
    /// Likewise for the frames in which the camera saw through its place.
    pub gone_worth: f32,
}

/// Messages to the mapper.
#[derive(Debug)]
pub enum MapperMsg {
    /// A frame to insert.
    Keyframe(Box<NewKeyframe>),
    /// Features of a keyframe that late detections show to be on moving objects.
    Rejudge {
        /// The keyframe.
        keyframe: KeyframeId,
        /// The features.
        features: Vec<u32>,
    },
    /// Keyframes of the first frames of a map, whose poses followed a moving object.
    Revoke {
        /// First id to revoke.
        first: KeyframeId,
        /// Last id to revoke.
        last: KeyframeId,
    },
    /// A correction computed from an older version of the map.
    Correct(Correction),
}

/// The mapper's reply.
#[derive(Clone, Debug)]
pub struct MapperOut {
    /// The map after the message.
    pub view: Arc<MapView>,
    /// Report.
    pub report: MapperReport,
}

impl MapperOut {
    /// The corresponding message to the loop closer.
    #[must_use]
    pub fn for_loop_closer(&self) -> LoopCloserMsg {
        let view = || Arc::clone(&self.view);
        match &self.report {
            MapperReport::Mapped(report) => LoopCloserMsg::Keyframe {
                id: report.keyframe,
                view: view(),
            },
            MapperReport::Rejudged(report) => LoopCloserMsg::Rejudged {
                id: report.keyframe,
                view: view(),
            },
            MapperReport::Revoked(report) => LoopCloserMsg::Revoked {
                first: report.first,
                last: report.last,
                view: view(),
            },
            MapperReport::Corrected(report) => LoopCloserMsg::Corrected {
                map_version: report.map_version,
            },
        }
    }
}

/// The mapper's report on a message.
#[derive(Clone, Debug)]
pub enum MapperReport {
    /// A keyframe was inserted.
    Mapped(MappingReport),
    /// Moving features were removed.
    Rejudged(RejudgeReport),
    /// Keyframes were revoked.
    Revoked(RevokeReport),
    /// A correction was applied.
    Corrected(CorrectionReport),
}

/// Messages to the loop closer.
#[derive(Clone, Debug)]
pub enum LoopCloserMsg {
    /// A new keyframe of the map.
    Keyframe {
        /// Keyframe id.
        id: KeyframeId,
        /// First version of the map with it.
        view: Arc<MapView>,
    },
    /// A keyframe some of whose features were found to move; they are excluded from the place.
    Rejudged {
        /// Keyframe id.
        id: KeyframeId,
        /// First version of the map without them.
        view: Arc<MapView>,
    },
    /// Revoked keyframes, whose loops are discarded.
    Revoked {
        /// First revoked id.
        first: KeyframeId,
        /// Last revoked id.
        last: KeyframeId,
        /// First version of the map without them.
        view: Arc<MapView>,
    },
    /// A map that existed before the first frame.
    Known {
        /// The map.
        view: Arc<MapView>,
    },
    /// The last correction was applied.
    Corrected {
        /// First version that contains it.
        map_version: u64,
    },
}

/// The loop closer's reply.
#[derive(Clone, Debug)]
pub struct LoopCloserOut {
    /// The correction, if a loop was closed.
    pub correction: Option<Correction>,
    /// Report on the best candidate, if there was one.
    pub report: Option<LoopReport>,
    /// The current place index, by keyframe.
    pub places: PlaceIndex<KeyframeId>,
}
