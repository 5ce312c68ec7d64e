//! Estimates the offset between the clocks of two trajectories.
//!
//! Answers: the offset of stamps at which an estimate fits the ground truth best, and whether that is far better than without one. The
//! ground truth is interpolated, so its rate does not limit the result.

use crate::TimedPose;
use stillpoint_geometry::{Vec3, align_umeyama};

/// Maximum offset tried to both sides, s: delays of networks and of synchronised clocks are far below it (evo's users name some tenths),
/// and the stamps of unsynchronised computers do not overlap at all.
const REACH: f64 = 5.0;
/// Likewise if nothing overlaps and one trajectory is longer than the other, s: recordings of one walk, started at two keyboards, begin up
/// to this far apart.
const LONGEST_REACH: f64 = 60.0;
/// Steps between offsets, s, each a refinement of the previous one: the motion of a hand changes within a quarter of a second, and stamps
/// should be right to a millisecond.
const STEPS: [f64; 3] = [0.05, 0.005, 0.0005];
/// Maximum number of compared poses: some 20 s at 30 Hz, so that 200 offsets take a fraction of a second.
const MOST_POSES: usize = 600;
/// Maximum gap for interpolation of the ground truth, s, or in multiples of its usual step: a hand moves straight for a tenth of a second
/// to a millimetre or two, and motion capture sometimes loses a pose or two.
const GAP: f64 = 0.1;
const GAP_STEPS: f64 = 3.0;
/// Minimum fraction and number of compared poses: fewer fit by chance, as an alignment has six degrees of freedom and the offset is a
/// seventh.
const MIN_SHARE: f64 = 0.8;
const MIN_POSES: usize = 10;
/// An offset fits far better if the error falls below this fraction, by at least this difference, m: the delay of a camera's own images (16
/// ms on fr1) causes 4 mm, and is not a fault.
const FAR_BETTER: f64 = 0.5;
const BY_AT_LEAST: f64 = 0.005;

/// An offset between two clocks.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Offset {
    /// To add to the stamps of the estimate, s.
    pub seconds: f64,
    /// Root mean square of the distances with it, m.
    pub rmse: f64,
    /// Likewise without an offset; `None` if the trajectories do not overlap.
    pub rmse_without: Option<f64>,
}

impl Offset {
    /// Whether it fits far better, so that the clocks most likely differ.
    #[must_use]
    pub fn is_far_better(&self) -> bool {
        self.rmse_without
            .is_none_or(|without| self.rmse < (FAR_BETTER * without).min(without - BY_AT_LEAST))
    }
}

/// The offset at which an estimate fits the ground truth best, after alignment by SE(3), with `with_scale` by Sim(3). `None` if no offset
/// gives enough overlap, or the camera stands still. Stamps must ascend.
#[must_use]
pub fn find_offset(
    reference: &[TimedPose],
    estimate: &[TimedPose],
    with_scale: bool,
) -> Option<Offset> {
    let pair = Pair::new(reference, estimate, with_scale)?;
    let without = pair.error(0.0);
    let (from, to) = (reference.first()?.stamp, reference.last()?.stamp);
    let (begin, end) = (estimate.first()?.stamp, estimate.last()?.stamp);
    let (mut best, reach) = match without {
        Some(found) => ((found, 0.0), REACH),
        None => {
            let longer = ((to - from) - (end - begin)).abs();
            (
                (f64::INFINITY, from - begin),
                (REACH + longer).min(LONGEST_REACH),
            )
        }
    };
    let mut span = reach;
    for step in STEPS {
        let (centre, count) = (best.1, (span / step).round() as i32);
        for k in -count..=count {
            let seconds = centre + f64::from(k) * step;
            if let Some(error) = pair.error(seconds).filter(|e| *e < best.0) {
                best = (error, seconds);
            }
        }
        span = step;
    }
    best.0.is_finite().then_some(Offset {
        seconds: best.1,
        rmse: best.0,
        rmse_without: without,
    })
}

/// Two trajectories that are compared at different offsets.
struct Pair<'a> {
    reference: &'a [TimedPose],
    estimate: Vec<&'a TimedPose>,
    with_scale: bool,
    /// Maximum gap for interpolation of the reference, s.
    gap: f64,
}

impl<'a> Pair<'a> {
    fn new(
        reference: &'a [TimedPose],
        estimate: &'a [TimedPose],
        with_scale: bool,
    ) -> Option<Self> {
        let stride = estimate.len().div_ceil(MOST_POSES).max(1);
        let mut steps: Vec<f64> = reference
            .windows(2)
            .map(|w| w[1].stamp - w[0].stamp)
            .collect();
        if steps.is_empty() {
            return None;
        }
        let middle = steps.len() / 2;
        let usual = *steps.select_nth_unstable_by(middle, f64::total_cmp).1;
        Some(Self {
            reference,
            estimate: estimate.iter().step_by(stride).collect(),
            with_scale,
            gap: GAP.max(GAP_STEPS * usual),
        })
    }

    fn at(&self, stamp: f64) -> Option<Vec3> {
        let after = self.reference.partition_point(|p| p.stamp <= stamp);
        let (a, b) = (
            self.reference.get(after.checked_sub(1)?)?,
            self.reference.get(after)?,
        );
        let step = b.stamp - a.stamp;
        let part = (stamp - a.stamp) / step;
        let (from, to) = (
            a.world_from_camera.translation,
            b.world_from_camera.translation,
        );
        (step <= self.gap).then(|| from + (to - from) * part)
    }

    /// Root mean square of the distances at an offset, m.
    fn error(&self, offset: f64) -> Option<f64> {
        let (mut source, mut target) = (Vec::new(), Vec::new());
        for pose in &self.estimate {
            if let Some(place) = self.at(pose.stamp + offset) {
                source.push(pose.world_from_camera.translation);
                target.push(place);
            }
        }
        let enough = (MIN_SHARE * self.estimate.len() as f64).max(MIN_POSES as f64);
        if (source.len() as f64) < enough {
            return None;
        }
        let alignment = align_umeyama(&source, &target, self.with_scale).ok()?;
        let squares = source.iter().zip(&target);
        let squares = squares.map(|(s, t)| (alignment.apply(s) - t).norm_squared());
        Some((squares.sum::<f64>() / source.len() as f64).sqrt())
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint_geometry::Se3;

    /// A hand's motion from `start` on, sampled at a rate, with late stamps.
    fn moved(start: f64, seconds: f64, rate: f64, late: f64) -> Vec<TimedPose> {
        let count = (seconds * rate) as usize;
        (0..count)
            .map(|i| {
                let t = start + i as f64 / rate;
                TimedPose {
                    stamp: t + late,
                    world_from_camera: Se3 {
                        translation: Vec3::new(
                            0.3 * (2.1 * t).sin(),
                            0.2 * (3.7 * t).cos(),
                            0.1 * (1.3 * t).sin() + 0.05 * t,
                        ),
                        ..Se3::identity()
                    },
                }
            })
            .collect()
    }

    #[test]
    fn clock_offset_is_found_only_if_present() {
        let truth = moved(0.0, 12.0, 100.0, 0.0);
        for late in [0.25, -0.25, 0.033, 2.0, -4.0, 1.3e9] {
            let found = find_offset(&truth, &moved(5.0, 5.0, 30.0, late), false).unwrap();
            assert!((found.seconds + late).abs() < 2e-3, "{late}: {found:?}");
            assert!(found.is_far_better() && found.rmse < 1e-3, "{found:?}");
        }
        // Without delay, with an error that no offset explains.
        let mut noisy = moved(5.0, 5.0, 30.0, 0.0);
        for (k, pose) in noisy.iter_mut().enumerate() {
            pose.world_from_camera.translation.x += 0.02 * ((k * 7919 % 13) as f64 / 13.0 - 0.5);
        }
        let found = find_offset(&truth, &noisy, false).unwrap();
        assert!(!found.is_far_better(), "{found:?}");
    }

    #[test]
    fn too_few_poses_give_no_offset() {
        let truth = moved(0.0, 12.0, 100.0, 0.0);
        assert_eq!(find_offset(&truth, &[], false), None);
        assert_eq!(find_offset(&[], &truth, false), None);
        assert_eq!(find_offset(&truth, &truth[..5], false), None);
    }
}
