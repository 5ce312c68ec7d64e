//! Errors against the ground truth, for `summary.json`.

use serde::{Deserialize, Serialize};
use stillpoint::evaluation::{Drift, Evaluation, Rpe, Score, Statistics};

/// Scores of the final poses and of the poses as known at each frame.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct Accuracy {
    #[serde(rename = "final")]
    pub(crate) final_poses: ScoreJson,
    pub(crate) online: ScoreJson,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(untagged)]
pub(crate) enum ScoreJson {
    Moving(MovingJson),
    Fixed(FixedJson),
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct MovingJson {
    pub(crate) pairs: usize,
    pub(crate) ate: StatisticsJson,
    /// Relative error; absent when the trajectory is shorter than the delta.
    pub(crate) rpe: Option<RpeJson>,
    /// Scale of the alignment, if requested.
    #[serde(skip_serializing_if = "Option::is_none", default)]
    pub(crate) scale: Option<f64>,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct FixedJson {
    /// Distance from the first pose, m.
    pub(crate) drift: StatisticsJson,
    /// Distance from the mean position, m.
    pub(crate) spread: StatisticsJson,
    /// Angle to the first pose, degrees.
    pub(crate) rotation_deg: StatisticsJson,
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct RpeJson {
    /// The interval, e.g. `1s`, `30f`.
    pub(crate) delta: String,
    pub(crate) pairs: usize,
    /// m per delta.
    pub(crate) translation: StatisticsJson,
    /// Degrees per delta.
    pub(crate) rotation_deg: StatisticsJson,
}

#[derive(Clone, Copy, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct StatisticsJson {
    pub(crate) rmse: f64,
    pub(crate) sd: f64,
    pub(crate) mean: f64,
    pub(crate) median: f64,
    pub(crate) max: f64,
}

impl From<&Statistics> for StatisticsJson {
    fn from(s: &Statistics) -> Self {
        Self {
            rmse: s.rmse,
            sd: s.sd,
            mean: s.mean,
            median: s.median,
            max: s.max,
        }
    }
}

impl From<&Rpe> for RpeJson {
    fn from(r: &Rpe) -> Self {
        Self {
            delta: r.delta.to_string(),
            pairs: r.pairs,
            translation: (&r.translation).into(),
            rotation_deg: (&r.rotation_deg).into(),
        }
    }
}

impl ScoreJson {
    /// `with_scale`: whether the alignment estimated a scale.
    pub(crate) fn new(score: &Score, with_scale: bool) -> Self {
        match score {
            Score::Moving(e) => Self::Moving(MovingJson::new(e, with_scale)),
            Score::Fixed(d) => Self::Fixed(FixedJson::from(d)),
        }
    }
}

impl MovingJson {
    fn new(e: &Evaluation, with_scale: bool) -> Self {
        Self {
            pairs: e.pairs,
            ate: (&e.ate.statistics).into(),
            rpe: e.rpe.as_ref().map(RpeJson::from),
            scale: with_scale.then_some(e.ate.alignment.scale),
        }
    }
}

impl From<&Drift> for FixedJson {
    fn from(d: &Drift) -> Self {
        Self {
            drift: (&d.drift).into(),
            spread: (&d.spread).into(),
            rotation_deg: (&d.rotation_deg).into(),
        }
    }
}
