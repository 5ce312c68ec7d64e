//! The data of a report.

use super::columns::Column;
use super::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// A run in its report. Lengths are metres, times seconds unless a name says otherwise; the world is that of the run's poses. Missing
/// values are NaN.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunData {
    /// Name: data set or scene.
    pub name: String,
    /// `summary.json`.
    pub summary: serde_json::Value,
    /// Verdict on the run: see [`RunData::judge`].
    #[serde(default)]
    pub verdict: Verdict,
    /// The configuration, as in `config.toml`.
    pub config: String,
    /// The command line.
    pub command: String,
    /// Size of the images, px; zeros if unknown.
    pub image: [u32; 2],
    /// Every frame.
    pub frames: FrameColumns,
    /// Meaning of [`FrameColumns::time_ms`]: `time per frame` or `latency`.
    pub time_is: String,
    /// Landmarks.
    pub map: MapColumns,
    /// The surface of the static scene, if fused.
    #[serde(default)]
    pub surface: SurfaceColumns,
    /// Keyframes.
    pub keyframes: KeyframeColumns,
    /// Events at frames.
    pub marks: Vec<Mark>,
    /// Objects in the frames with images.
    pub objects: ObjectColumns,
    /// Images of some or all frames.
    pub pictures: Pictures,
}

/// Values per frame: all columns have one per frame unless stated otherwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameColumns {
    /// The stamp of the first frame, s.
    pub first_stamp: f64,
    /// Frame number.
    pub id: Column<u32>,
    /// Time since the first frame, s.
    pub seconds: Column<f32>,
    /// State: see [`FrameState`](super::FrameState).
    pub state: Column<u8>,
    /// Number of inliers of the pose.
    pub inliers: Column<u16>,
    /// Share of moving keypoints, 0 to 1.
    pub moving: Column<f32>,
    /// Standard deviation of the position, mm.
    pub sigma_mm: Column<f32>,
    /// Quality of the pose, 0 to 1.
    pub quality: Column<f32>,
    /// Processing time, or latency in a live run, ms.
    pub time_ms: Column<f32>,
    /// From the frame's arrival until tracking took the detector's answer, ms; only for frames sent to the detector in a live run.
    #[serde(default, skip_serializing_if = "Column::is_empty")]
    pub answer_ms: Column<f32>,
    /// Distance to the true position, mm; if known.
    #[serde(default, skip_serializing_if = "Column::is_empty")]
    pub error_mm: Column<f32>,
    /// Final pose: seven numbers per frame, position and quaternion (x, y, z, w).
    pub pose: Column<f32>,
    /// True position in the run's world: three numbers per frame; if known.
    #[serde(default, skip_serializing_if = "Column::is_empty")]
    pub truth: Column<f32>,
}

/// Landmarks.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapColumns {
    /// Number in the map; the report may hold fewer.
    pub count: u32,
    /// Positions: three numbers each.
    pub position: Column<f32>,
    /// Frame in which each was created.
    pub frame: Column<u32>,
    /// Probability of being static, in 255ths.
    pub stands_still: Column<u8>,
}

/// A surface as triangles.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceColumns {
    /// Number of triangles of the full surface; the report may hold fewer.
    pub count: u32,
    /// Minimum corner of its bounding box, and the box's sides: three numbers each.
    pub bounds: Column<f32>,
    /// Vertices: three numbers each, in 65535ths of the box's sides.
    pub position: Column<u16>,
    /// Red, green and blue of each vertex.
    pub colour: Column<u8>,
    /// Three vertex indices per triangle.
    pub triangle: Column<u16>,
}

/// Keyframes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyframeColumns {
    /// Frame numbers.
    pub id: Column<u32>,
    /// Poses: seven numbers each, as in [`FrameColumns::pose`].
    pub pose: Column<f32>,
    /// Pairs of keyframes connected by loops.
    pub loops: Column<u32>,
}

/// An event at a frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mark {
    /// Frame number.
    pub frame: u32,
    /// Kind of event.
    pub kind: MarkKind,
    /// Description.
    pub text: String,
}

/// Kinds of events.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MarkKind {
    /// Tracking was lost.
    Loss,
    /// The camera was relocalised.
    Found,
    /// A map or a submap was started.
    Begun,
    /// A loop was closed.
    Loop,
    /// Keyframes from the beginning were revoked.
    Revoked,
}

/// Objects in the frames with images: a row per object and frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectColumns {
    /// Names of the classes that occur.
    pub classes: Vec<String>,
    /// Frame number.
    pub frame: Column<u32>,
    /// Object id.
    pub id: Column<u32>,
    /// Index of its class in `classes`.
    pub class: Column<u8>,
    /// Motion: 0 unknown, 1 moving, 2 parked.
    pub motion: Column<u8>,
    /// Box in the image, px: left, top, right, bottom.
    pub bounds: Column<u16>,
    /// Centre of its surface: three numbers each.
    pub position: Column<f32>,
    /// Width and height, m: two numbers each.
    pub size: Column<f32>,
    /// Speed if it exceeds its standard deviation, m/s.
    pub speed: Column<f32>,
}

/// Images of some frames, with the verdicts on their features.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pictures {
    /// Width and height, px.
    pub size: [u32; 2],
    /// Frame numbers.
    pub frame: Column<u32>,
    /// Each as WebP.
    pub webp: Vec<Column<u8>>,
    /// Features of each: column and row in 255ths of the image, and [`Said`].
    pub features: Vec<Column<u8>>,
    /// Static features are thinned to one in this many; moving ones are complete.
    pub one_in: u32,
}

/// Verdict on a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Said {
    /// Static.
    Still = 0,
    /// On a moving object.
    Object = 1,
    /// Its motion differs from the rigid scene's.
    Rigid = 2,
    /// Off its epipolar line.
    Epipolar = 3,
    /// Its depth is that of a moving region.
    Depth = 4,
    /// Its landmark moved before.
    History = 5,
}
