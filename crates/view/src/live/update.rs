//! Updates of the live page.

use super::frames::FrameUpdate;
use super::scene::MapUpdate;
use crate::report::{Column, Mark, ObjectColumns, SurfaceColumns};
use serde::{Deserialize, Serialize};
use stillpoint_slam::{FrameReport, FrameState, Health};

/// The changes since a version.
#[derive(Clone, Debug, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Update {
    /// The version reached.
    pub version: u64,
    /// Constant facts, only for new clients.
    pub about: Option<About>,
    /// Frames.
    pub frames: FrameUpdate,
    /// The map.
    pub map: MapUpdate,
    /// The surface of the static scene, if changed.
    pub surface: Option<SurfaceColumns>,
    /// Events.
    pub marks: Vec<Mark>,
    /// The newest image, if changed.
    pub picture: Option<PictureUpdate>,
    /// The current state.
    pub now: Now,
}

/// Constant facts about a run.
#[derive(Clone, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct About {
    /// Name of the run: data set or camera.
    pub name: String,
    /// Input layout and camera.
    pub input: String,
    /// The command line.
    pub command: String,
    /// The configuration, as in `config.toml`.
    pub config: String,
    /// Meaning of [`FrameColumns::time_ms`](crate::report::FrameColumns::time_ms).
    pub time_is: String,
    /// Expected number of frames, if known.
    pub frames: Option<u64>,
}

/// The image of a frame, with its features and objects.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct PictureUpdate {
    /// Frame number.
    pub frame: u32,
    /// Size of the camera image, px, to which boxes refer.
    pub image: [u32; 2],
    /// Size of the reduced image, px.
    pub size: [u32; 2],
    /// The image as WebP.
    pub webp: Column<u8>,
    /// Column and row in 255ths of the image, and [`Said`](crate::report::Said), of one in four static features, and all moving ones.
    pub features: Column<u8>,
    /// Objects in this frame.
    pub objects: ObjectColumns,
}

/// Measurements of the run's driver.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Measured {
    /// The frame of the latency.
    pub frame: Option<u32>,
    /// From its arrival to its pose, ms.
    pub latency_ms: Option<f64>,
    /// Time since the last pose, s.
    pub silent_s: Option<f64>,
    /// Number of dropped frames.
    pub dropped: u64,
    /// Problems of threads.
    pub troubles: Vec<String>,
}

/// The current state.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Now {
    /// Number of processed frames.
    pub frames: u64,
    /// Number of those with a pose.
    pub posed: u64,
    /// Keyframes of the map.
    pub keyframes: u32,
    /// Landmarks of the map.
    pub landmarks: u32,
    /// Closed loops and joined submaps.
    pub loops: u32,
    /// Rejected loop candidates.
    pub set_aside: u32,
    /// Number of detector answers.
    pub detections: u64,
    /// State of the newest frame: the word of [`FrameState`].
    pub state: String,
    /// Whether tracking is lost.
    pub lost: bool,
    /// Whether it is undecided which regions move.
    pub undecided: bool,
    /// Quality of its pose, 0 to 1.
    pub quality: f64,
    /// Standard deviation of its position, mm.
    pub sigma_mm: Option<f64>,
    /// Standard deviation of its orientation, degrees.
    pub sigma_deg: Option<f64>,
    /// Share of static keypoints, 0 to 1.
    pub static_share: f64,
    /// Age of the newest detections, s.
    pub detections_age: Option<f64>,
    /// Age of the map that tracking uses, s.
    pub map_age: Option<f64>,
    /// Why there is no pose, with advice.
    pub loss: Option<String>,
    /// Which images of the newest frame repeat earlier ones, and for how long.
    pub still: Option<String>,
    /// Measurements.
    pub measured: Measured,
}

impl Now {
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
