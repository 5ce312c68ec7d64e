//! What a browser is told.

use super::frames::FrameUpdate;
use super::scene::MapUpdate;
use crate::report::{Column, Mark, ObjectColumns, SurfaceColumns};
use serde::{Deserialize, Serialize};
use stillpoint_slam::{FrameReport, FrameState, Health};

/// What is new since a version of the page.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Update {
    /// The version that is known with it.
    pub version: u64,
    /// The facts that do not change, only for readers who know nothing yet.
    pub about: Option<About>,
    /// Frames.
    pub frames: FrameUpdate,
    /// The map.
    pub map: MapUpdate,
    /// The surface of what stands still, where it is new.
    pub surface: Option<SurfaceColumns>,
    /// What happened.
    pub marks: Vec<Mark>,
    /// The newest picture, where it is new.
    pub picture: Option<PictureUpdate>,
    /// How things stand.
    pub now: Now,
}

/// What does not change while a run goes on.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// What the run is called: data set or camera.
    pub name: String,
    /// In what layout its input is, and which camera it has.
    pub input: String,
    /// The command that was typed.
    pub command: String,
    /// The configuration, as `config.toml` has it.
    pub config: String,
    /// What [`FrameColumns::time_ms`](crate::report::FrameColumns::time_ms) is.
    pub time_is: String,
    /// Frames that there will be, where that is known.
    pub frames: Option<u64>,
}

/// The picture of a frame, and what was found in it.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureUpdate {
    /// Number of the frame.
    pub frame: u32,
    /// Width and height of the image, px, in which boxes are.
    pub image: [u32; 2],
    /// Width and height of the picture, px.
    pub size: [u32; 2],
    /// The picture as WebP.
    pub webp: Column<u8>,
    /// Column and row in 255ths of the image, and [`Said`](crate::report::Said), of one in four features that stand still, and all that move.
    pub features: Column<u8>,
    /// Objects in this frame.
    pub objects: ObjectColumns,
}

/// Measurements of the run's driver.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// The frame that the times are of.
    pub frame: Option<u32>,
    /// From its arrival to its pose, ms.
    pub latency_ms: Option<f64>,
    /// How long ago its pose was there, s.
    pub silent_s: Option<f64>,
    /// Frames that were dropped.
    pub dropped: u64,
    /// Threads that do not do what they should, in words.
    pub troubles: Vec<String>,
}

/// How things stand.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Now {
    /// Frames that were tracked, whatever became of their poses.
    pub frames: u64,
    /// Of these, frames that got a pose.
    pub posed: u64,
    /// Keyframes of the map.
    pub keyframes: u32,
    /// Landmarks of the map.
    pub landmarks: u32,
    /// Loops that were closed, and submaps that were joined.
    pub loops: u32,
    /// Candidates for loops that were set aside.
    pub set_aside: u32,
    /// Answers of the detector.
    pub detections: u64,
    /// What became of the newest frame: the word of [`FrameState`].
    pub state: String,
    /// Whether that is lost.
    pub lost: bool,
    /// Whether it is undecided who moves.
    pub undecided: bool,
    /// Quality of its pose, 0 to 1.
    pub quality: f64,
    /// Standard deviation of its position, mm, and of its direction, degrees.
    pub sigma_mm: Option<f64>,
    /// Standard deviation of its direction, degrees.
    pub sigma_deg: Option<f64>,
    /// Share of the keypoints that stand still, 0 to 1.
    pub static_share: f64,
    /// How old the newest detections are, s.
    pub detections_age: Option<f64>,
    /// How old the map is that tracking uses, s.
    pub map_age: Option<f64>,
    /// Why there is no pose, and what helps.
    pub loss: Option<String>,
    /// What of the newest frame stands still, and for how long.
    pub still: Option<String>,
    /// What is measured.
    pub measured: Measured,
}

impl Now {
    /// Takes what is known of a frame.
    pub(super) fn set_health(&mut self, report: &FrameReport, health: &Health) {
        let state = report.state();
        self.state = state.name().to_owned();
        self.lost = state == FrameState::Lost;
        self.undecided = health.undecided;
        self.quality = health.quality.value();
        self.sigma_mm = health.sigma_m().map(|m| 1e3 * m);
        self.sigma_deg = health.sigma_rad().map(f64::to_degrees);
        self.static_share = health.static_share;
        self.detections_age = health.detections_age;
        self.map_age = health.map_age;
        self.still = health.still.as_ref().map(ToString::to_string);
        self.loss = match &health.loss {
            Some(loss) => Some(loss.to_string()),
            None => report.loss(),
        };
    }
}
