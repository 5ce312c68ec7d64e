//! Figures over all runs of one sequence, for suites and ablations.

use crate::bench::runner::{Sequence, Spread};
use crate::run::summary::{ScoreJson, StatisticsJson};
use serde::Serialize;

#[derive(Clone, Debug, PartialEq, Serialize)]
pub(crate) struct Figures {
    /// Source of the camera model.
    pub(crate) camera: String,
    pub(crate) frames: usize,
    /// Number of frames in the absolute error, in the worst run.
    pub(crate) evaluated: usize,
    pub(crate) tracked: Spread,
    pub(crate) dropped: Option<Spread>,
    /// True when all trajectories are identical, byte for byte; absent with a single run.
    pub(crate) identical: Option<bool>,
    /// Absolute error of the final poses, m.
    pub(crate) ate: Option<Errors>,
    /// Relative error over 1 s, m.
    pub(crate) rpe_translation: Option<Errors>,
    /// Relative error over 1 s, degrees.
    pub(crate) rpe_rotation_deg: Option<Errors>,
    /// Distance from the first pose, m, where the ground truth stands still and alignment is undefined.
    pub(crate) drift: Option<Errors>,
}

/// RMSE and standard deviation over all runs.
#[derive(Clone, Copy, Debug, PartialEq, Serialize)]
pub(crate) struct Errors {
    pub(crate) rmse: Spread,
    pub(crate) sd: Spread,
}

impl Errors {
    /// From one statistic per run; `None` without any.
    fn of(statistics: &[StatisticsJson]) -> Option<Self> {
        Some(Self {
            rmse: Spread::of(statistics.iter().map(|s| s.rmse))?,
            sd: Spread::of(statistics.iter().map(|s| s.sd))?,
        })
    }
}

/// `None` without runs.
pub(crate) fn figures(sequence: &Sequence) -> Option<Figures> {
    let runs = &sequence.runs;
    let first = runs.first()?;
    let scores: Vec<&ScoreJson> = runs
        .iter()
        .filter_map(|r| Some(&r.accuracy.as_ref()?.final_poses))
        .collect();
    let (mut ate, mut translation, mut rotation, mut drift) = (vec![], vec![], vec![], vec![]);
    let mut evaluated = Vec::new();
    for score in scores {
        match score {
            ScoreJson::Moving(m) => {
                evaluated.push(m.pairs);
                ate.push(m.ate);
                translation.extend(m.rpe.as_ref().map(|r| r.translation));
                rotation.extend(m.rpe.as_ref().map(|r| r.rotation_deg));
            }
            ScoreJson::Fixed(f) => drift.push(f.drift),
        }
    }
    Some(Figures {
        camera: first.input.camera.clone(),
        frames: first.tracking.frames,
        evaluated: evaluated.into_iter().min().unwrap_or(0),
        tracked: Spread::of_tracked(runs),
        dropped: Spread::of(
            runs.iter()
                .filter_map(|r| Some(r.pace.live.as_ref()?.dropped_share)),
        ),
        identical: sequence.identical,
        ate: Errors::of(&ate),
        rpe_translation: Errors::of(&translation),
        rpe_rotation_deg: Errors::of(&rotation),
        drift: Errors::of(&drift),
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn errors_are_median_and_maximum_over_runs() {
        let of = |rmse: f64, sd: f64| StatisticsJson {
            rmse,
            sd,
            mean: 0.0,
            median: 0.0,
            max: 0.0,
        };
        let e = Errors::of(&[of(3.0, 0.5), of(1.0, 0.7), of(2.0, 0.6)]).unwrap();
        assert_eq!((e.rmse.median, e.rmse.worst), (2.0, 3.0));
        assert_eq!((e.sd.median, e.sd.worst), (0.6, 0.7));
        assert_eq!(Errors::of(&[]), None);
    }
}
