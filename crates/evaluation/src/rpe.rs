//! The relative pose error.

use crate::associate::nearest;
use crate::{Statistics, TimedPose};
use stillpoint_geometry::{Se3, so3};

/// Interval of the relative error.
#[derive(Clone, Copy, Debug, PartialEq)]
pub enum Delta {
    /// Seconds of the estimate's time, as the TUM script with a fixed delta.
    Seconds(f64),
    /// Poses among those with ground truth, over all pairs, as evo.
    Frames(usize),
}

impl Default for Delta {
    fn default() -> Self {
        Self::Seconds(1.0)
    }
}

impl std::fmt::Display for Delta {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Seconds(s) => write!(f, "{s}s"),
            Self::Frames(n) => write!(f, "{n}f"),
        }
    }
}

impl std::str::FromStr for Delta {
    type Err = String;
    /// Parses `1s`, `0.5s` or `30f`.
    fn from_str(s: &str) -> Result<Self, String> {
        let wrong = || format!("expected a delta like 1s or 30f (above 0), found \"{s}\"");
        if let Some(n) = s.strip_suffix('f') {
            n.parse().ok().filter(|n| *n > 0).map(Self::Frames)
        } else {
            s.strip_suffix('s')
                .and_then(|t| t.parse().ok())
                .filter(|t: &f64| t.is_finite() && *t > 0.0)
                .map(Self::Seconds)
        }
        .ok_or_else(wrong)
    }
}

/// The relative pose error over a fixed delta.
#[derive(Clone, Debug, PartialEq)]
pub struct Rpe {
    /// The interval.
    pub delta: Delta,
    /// Number of pairs of poses.
    pub pairs: usize,
    /// Translation per delta, m (m/s for a delta of 1 s).
    pub translation: Statistics,
    /// Rotation per delta, degrees.
    pub rotation_deg: Statistics,
    /// The error of each pair, in order.
    pub errors: Vec<RelativeError>,
}

/// The relative error from one pose to the one a delta later.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct RelativeError {
    /// Stamp of the first of both in the estimate, s.
    pub stamp: f64,
    /// Translation, m.
    pub translation: f64,
    /// Rotation, degrees.
    pub rotation_deg: f64,
}

/// Relative error of the motion over `delta`; `None` if no two poses are that far apart. `pairs` are the associated indices `(reference,
/// estimate)`; the estimate's translations are multiplied by `scale`.
///
/// With seconds, each pose of the estimate is paired with the one nearest to `delta` later; pairs that end at the last pose are omitted,
/// and so are those without ground truth within `max_dt` (this is the TUM script with a fixed delta and no limit on pairs). Unlike the
/// script, pairs across a gap are omitted: their times must differ from `delta` by at most the larger of `max_dt` and the estimate's median
/// interval.
#[must_use]
pub fn relative_error(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    pairs: &[(usize, usize)],
    (delta, max_dt, scale): (Delta, f64, f64),
) -> Option<Rpe> {
    let spans: Vec<[(usize, usize); 2]> = match delta {
        Delta::Frames(n) => pairs
            .iter()
            .zip(pairs.iter().skip(n))
            .map(|(a, b)| [*a, *b])
            .collect(),
        Delta::Seconds(s) => spans_by_time(reference, estimate, s, max_dt),
    };
    let scaled = |p: &Se3| Se3::new(p.rotation, p.translation * scale);
    let error_of = |[(r0, e0), (r1, e1)]: [(usize, usize); 2]| {
        let truth = reference[r0].world_from_camera.inverse() * reference[r1].world_from_camera;
        let found = scaled(&estimate[e0].world_from_camera).inverse()
            * scaled(&estimate[e1].world_from_camera);
        let error = truth.inverse() * found;
        RelativeError {
            stamp: estimate[e0].stamp,
            translation: error.translation.norm(),
            rotation_deg: so3::angle(&error.rotation).to_degrees(),
        }
    };
    let errors: Vec<RelativeError> = spans.into_iter().map(error_of).collect();
    let of =
        |f: fn(&RelativeError) -> f64| Statistics::of(&errors.iter().map(f).collect::<Vec<_>>());
    Some(Rpe {
        delta,
        pairs: errors.len(),
        translation: of(|e| e.translation)?,
        rotation_deg: of(|e| e.rotation_deg)?,
        errors,
    })
}

/// Pairs of `(reference, estimate)` that are `delta` seconds apart in the estimate.
fn spans_by_time(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    delta: f64,
    max_dt: f64,
) -> Vec<[(usize, usize); 2]> {
    let mut intervals: Vec<f64> = estimate
        .windows(2)
        .map(|w| w[1].stamp - w[0].stamp)
        .collect();
    intervals.sort_unstable_by(f64::total_cmp);
    let median = intervals
        .get(intervals.len() / 2)
        .copied()
        .unwrap_or_default();
    let slack = median.max(max_dt);
    let truth: Vec<Option<usize>> = estimate
        .iter()
        .map(|p| nearest(reference, p.stamp, max_dt))
        .collect();
    let last = estimate.len().saturating_sub(1);
    (0..estimate.len())
        .filter_map(|i| {
            let j = nearest(estimate, estimate[i].stamp + delta, slack)?;
            (j != last && j != i).then_some(())?;
            Some([(truth[i]?, i), (truth[j]?, j)])
        })
        .collect()
}
