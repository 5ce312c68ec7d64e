//! What the stages send each other.

use crate::evidence::Evidence;
use crate::report::{
    CorrectionReport, FrameReport, LoopReport, MappingReport, RejudgeReport, RevokeReport,
};
use std::sync::Arc;
use stillpoint_geometry::{Se3, Vec6};
use stillpoint_map::{Correction, KeyframeData, KeyframeId, LandmarkId, MapView};
use stillpoint_place::PlaceIndex;

/// The tracker's answer to a frame.
#[derive(Debug)]
pub struct Tracked {
    /// What became of the frame.
    pub report: FrameReport,
    /// The evidence from tracking, for callers that judge the quality of the pose.
    pub evidence: Evidence,
    /// The frame as a new keyframe, when the map needs it; or the one before, which began the map and waited for this frame.
    pub keyframe: Option<NewKeyframe>,
}

impl Tracked {
    /// Whether the frame was no new view.
    pub(crate) fn is_passed_over(&self) -> bool {
        self.report.still.is_some_and(|s| s.what.is_no_view())
    }
}

/// A frame that shall become a keyframe.
#[derive(Clone, Debug)]
pub struct NewKeyframe {
    /// Its id.
    pub id: KeyframeId,
    /// What it saw.
    pub data: Arc<KeyframeData>,
    /// The keyframe it was tracked from; none for the first of a map.
    pub reference: Option<KeyframeId>,
    /// Its pose relative to that; in world coordinates when there is none.
    pub reference_from_camera: Se3,
    /// Per feature, the landmark it observes.
    pub matches: Vec<Option<LandmarkId>>,
    /// How often landmarks were expected and found since the last keyframe, by id.
    pub statistics: Vec<LandmarkStatistic>,
    /// What it was measured with.
    pub exposure: Exposure,
}

impl NewKeyframe {
    /// These features make no landmarks.
    pub(crate) fn keep_out(&mut self, features: &[u32]) {
        let mappable = &mut Arc::make_mut(&mut self.data).mappable;
        for feature in features {
            if let Some(m) = mappable.get_mut(*feature as usize) {
                *m = false;
            }
        }
    }
}

/// What was known of how a frame was exposed when its features were brought to its stamp.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Exposure {
    /// The camera's velocity, twist per second; none where it was not known, and nothing was brought anywhere.
    pub velocity: Option<Vec6>,
    /// The readout of the shutter, s.
    pub readout: f64,
}

/// How often a landmark was expected to be seen, and was.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct LandmarkStatistic {
    /// The landmark.
    pub id: LandmarkId,
    /// Frames in which it was in the field of view.
    pub visible: u32,
    /// Frames in which it was matched as an inlier.
    pub found: u32,
    /// Frames in which the camera saw through its place.
    pub gone: u32,
    /// How much the frames in which it was found say, in frames of 30 Hz: those of a faster camera each say less, those of a slower one more.
    pub found_worth: f32,
    /// The same of the frames in which the camera saw through its place.
    pub gone_worth: f32,
}

/// What the mapper reads.
#[derive(Debug)]
pub enum MapperMsg {
    /// A frame to build into the map.
    Keyframe(Box<NewKeyframe>),
    /// Features of a keyframe that lie on something that moves, as late detections tell.
    Rejudge {
        /// The keyframe.
        keyframe: KeyframeId,
        /// The features.
        features: Vec<u32>,
    },
    /// The keyframes of the first frames of a map, as far as these turned out to have ridden on what moves.
    Revoke {
        /// The first id that such a keyframe may have.
        first: KeyframeId,
        /// The last one.
        last: KeyframeId,
    },
    /// What was found on an older version of the map.
    Correct(Correction),
}

/// What the mapper answers.
#[derive(Clone, Debug)]
pub struct MapperOut {
    /// The map after the message.
    pub view: Arc<MapView>,
    /// What was done.
    pub report: MapperReport,
}

impl MapperOut {
    /// The message about it to the loop closer.
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

/// What the mapper did with a message.
#[derive(Clone, Debug)]
pub enum MapperReport {
    /// It took a keyframe.
    Mapped(MappingReport),
    /// It took out what moves.
    Rejudged(RejudgeReport),
    /// It took keyframes back.
    Revoked(RevokeReport),
    /// It applied a correction.
    Corrected(CorrectionReport),
}

/// What the loop closer reads.
#[derive(Clone, Debug)]
pub enum LoopCloserMsg {
    /// A keyframe that the map took.
    Keyframe {
        /// Its id.
        id: KeyframeId,
        /// The first version of the map that holds it.
        view: Arc<MapView>,
    },
    /// A keyframe some of whose features turned out to move: they are no part of the place.
    Rejudged {
        /// Its id.
        id: KeyframeId,
        /// The first version of the map that knows it.
        view: Arc<MapView>,
    },
    /// Keyframes that were taken back: what was learned by them means nothing.
    Revoked {
        /// The first id that one of them may have.
        first: KeyframeId,
        /// The last one.
        last: KeyframeId,
        /// The first version of the map without them.
        view: Arc<MapView>,
    },
    /// A map that was there before the first frame.
    Known {
        /// The map.
        view: Arc<MapView>,
    },
    /// The last correction is in the map.
    Corrected {
        /// The first version that holds it.
        map_version: u64,
    },
}

/// What the loop closer answers.
#[derive(Clone, Debug)]
pub struct LoopCloserOut {
    /// What is to be changed in the map, when a loop was closed.
    pub correction: Option<Correction>,
    /// What became of the place that was recognised; none when none was.
    pub report: Option<LoopReport>,
    /// The places that can be recognised by now, by keyframe.
    pub places: PlaceIndex<KeyframeId>,
}
