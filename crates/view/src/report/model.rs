//! What a report holds: a run as plain data.

use super::columns::Column;
use super::verdict::Verdict;
use serde::{Deserialize, Serialize};

/// A run as its report has it. Lengths are metres, times seconds unless a name says otherwise; the world is that of the run's poses. What
/// has no value is not a number.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct RunData {
    /// What it is called: data set or scene.
    pub name: String,
    /// `summary.json`.
    pub summary: serde_json::Value,
    /// How it went: see [`RunData::judge`].
    #[serde(default)]
    pub verdict: Verdict,
    /// The configuration, as `config.toml` has it.
    pub config: String,
    /// How to run it again.
    pub command: String,
    /// Width and height of the images, px; zeros where they are not known.
    pub image: [u32; 2],
    /// Every frame.
    pub frames: FrameColumns,
    /// What [`FrameColumns::time_ms`] is: `time per frame` or `latency`.
    pub time_is: String,
    /// Landmarks.
    pub map: MapColumns,
    /// The surface of what stands still, where the run fused one.
    #[serde(default)]
    pub surface: SurfaceColumns,
    /// Keyframes.
    pub keyframes: KeyframeColumns,
    /// What happened at some frames.
    pub marks: Vec<Mark>,
    /// Objects in the frames that have pictures.
    pub objects: ObjectColumns,
    /// Pictures of some frames, or all.
    pub pictures: Pictures,
}

/// Numbers of every frame: all columns have one of each, but where it says otherwise.
#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct FrameColumns {
    /// The stamp of the first frame, s.
    pub first_stamp: f64,
    /// Number of the frame.
    pub id: Column<u32>,
    /// Time since the first frame, s.
    pub seconds: Column<f32>,
    /// What became of it: see [`FrameState`](super::FrameState).
    pub state: Column<u8>,
    /// Landmarks that agree with the pose.
    pub inliers: Column<u16>,
    /// Share of the keypoints that move, 0 to 1.
    pub moving: Column<f32>,
    /// Standard deviation of the position, mm.
    pub sigma_mm: Column<f32>,
    /// Quality of the pose, 0 to 1.
    pub quality: Column<f32>,
    /// Time that it took, or latency in a live run, ms.
    pub time_ms: Column<f32>,
    /// From the frame's arrival until tracking took what the detector said of it, ms; only where it was asked in a live run.
    #[serde(default, skip_serializing_if = "Column::is_empty")]
    pub answer_ms: Column<f32>,
    /// Distance to the true position, mm; only where it is known.
    #[serde(default, skip_serializing_if = "Column::is_empty")]
    pub error_mm: Column<f32>,
    /// Final pose: seven numbers per frame, position and quaternion (x, y, z, w).
    pub pose: Column<f32>,
    /// True position in the run's world: three numbers per frame; only where it is known.
    #[serde(default, skip_serializing_if = "Column::is_empty")]
    pub truth: Column<f32>,
}

/// Landmarks.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct MapColumns {
    /// How many the map has: those here may be fewer.
    pub count: u32,
    /// Positions: three numbers each.
    pub position: Column<f32>,
    /// Number of the frame that each was made at.
    pub frame: Column<u32>,
    /// Probability that it stands still, in 255ths.
    pub stands_still: Column<u8>,
}

/// A surface as triangles.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct SurfaceColumns {
    /// How many triangles the run's surface has: those here may be fewer.
    pub count: u32,
    /// The least corner of the box around it, and its sides: three numbers each.
    pub bounds: Column<f32>,
    /// Corners: three numbers each, in 65535ths of the box's sides.
    pub position: Column<u16>,
    /// Red, green and blue of each corner.
    pub colour: Column<u8>,
    /// Three numbers of corners for each triangle.
    pub triangle: Column<u16>,
}

/// Keyframes.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct KeyframeColumns {
    /// Numbers of the frames that they are.
    pub id: Column<u32>,
    /// Poses: seven numbers each, as in [`FrameColumns::pose`].
    pub pose: Column<f32>,
    /// Pairs of numbers of keyframes that loops tie together.
    pub loops: Column<u32>,
}

/// Something that happened at a frame.
#[derive(Clone, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Mark {
    /// Number of the frame.
    pub frame: u32,
    /// What kind of thing.
    pub kind: MarkKind,
    /// In words.
    pub text: String,
}

/// Kinds of marks.
#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub enum MarkKind {
    /// Poses are missing from here on.
    Loss,
    /// The camera was found again.
    Found,
    /// A map or a submap began.
    Begun,
    /// A loop was closed.
    Loop,
    /// Keyframes of the beginning were taken back.
    Revoked,
}

/// Objects in the frames that have pictures: a row for each object and frame.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct ObjectColumns {
    /// Names of the classes that occur.
    pub classes: Vec<String>,
    /// Number of the frame.
    pub frame: Column<u32>,
    /// Number of the object.
    pub id: Column<u32>,
    /// Index of its class in `classes`.
    pub class: Column<u8>,
    /// Whether it moves: 0 unknown, 1 moving, 2 parked.
    pub motion: Column<u8>,
    /// Box in the image, px: left, top, right, bottom.
    pub bounds: Column<u16>,
    /// Middle of its surface: three numbers each.
    pub position: Column<f32>,
    /// Width and height, m: two numbers each.
    pub size: Column<f32>,
    /// Speed that is above its own standard deviation, m/s.
    pub speed: Column<f32>,
}

/// Pictures of some frames, and what was said of their features.
#[derive(Clone, Debug, Default, Serialize, Deserialize)]
#[serde(deny_unknown_fields)]
pub struct Pictures {
    /// Width and height, px.
    pub size: [u32; 2],
    /// Numbers of the frames.
    pub frame: Column<u32>,
    /// WebP each.
    pub webp: Vec<Column<u8>>,
    /// Features of each: column and row in 255ths of the image, and [`Said`].
    pub features: Vec<Column<u8>>,
    /// One in so many of the features that stand still is there; of those that move, all.
    pub one_in: u32,
}

/// What the static filter said of a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum Said {
    /// It stands still.
    Still = 0,
    /// It lies on an object that moves.
    Object = 1,
    /// Its motion is not that of the rigid scene.
    Rigid = 2,
    /// It is off its epipolar line.
    Epipolar = 3,
    /// Its depth is that of what moves.
    Depth = 4,
    /// Its landmark moved before.
    History = 5,
}
