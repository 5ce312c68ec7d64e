//! Detects the unit of stamps that are not in seconds, by their steps and their magnitude. Sensors deliver many samples a second, and no
//! clock counts seconds with twelve digits.

/// Maximum value of seconds: larger ones would be a date after the year 5000.
const LARGEST_SECONDS: f64 = 1e11;
/// Maximum value of milliseconds, and of microseconds.
const LARGEST_MILLISECONDS: f64 = 1e14;
const LARGEST_MICROSECONDS: f64 = 1e17;
/// Typical time between two samples of a sensor, s: some take a hundred times more or less.
const USUAL_STEP: f64 = 0.03;
/// Minimum number of stamps for judging their steps.
const FEW: usize = 5;

/// Maximum time between images, s: beyond it they do not show a motion.
pub(crate) const BETWEEN_IMAGES: f64 = 4.0;
/// Maximum time between inertial or wheel samples, s.
pub(crate) const BETWEEN_SAMPLES: f64 = 3.0;
/// Maximum time between poses, which may be those of keyframes alone, s.
pub(crate) const BETWEEN_POSES: f64 = 20.0;

#[derive(Clone, Copy, Debug, PartialEq, Eq, PartialOrd, Ord)]
pub(crate) enum Unit {
    Seconds,
    Milliseconds,
    Microseconds,
    Nanoseconds,
}

impl Unit {
    const ALL: [Self; 4] = [
        Self::Seconds,
        Self::Milliseconds,
        Self::Microseconds,
        Self::Nanoseconds,
    ];

    /// The unit of stamps with steps of at most `most` seconds.
    pub(crate) fn of(stamps: &[f64], most: f64) -> Self {
        let by_size = |largest: f64| match largest {
            t if t < LARGEST_SECONDS => Self::Seconds,
            t if t < LARGEST_MILLISECONDS => Self::Milliseconds,
            t if t < LARGEST_MICROSECONDS => Self::Microseconds,
            _ => Self::Nanoseconds,
        };
        let largest = stamps.iter().fold(0.0_f64, |m, t| m.max(t.abs()));
        let by_step = usual_step(stamps)
            .filter(|step| *step >= most)
            .map_or(Self::Seconds, Self::nearest);
        // The magnitude is inconclusive for a clock that started recently, the steps for a slow one.
        by_size(largest).max(by_step)
    }

    /// The unit, other than seconds, in which a step is closest to a sensor's.
    fn nearest(step: f64) -> Self {
        let unlike = |unit: &Self| (step / unit.per_second() / USUAL_STEP).ln().abs();
        let all = Self::ALL[1..].iter().copied();
        all.min_by(|a, b| unlike(a).total_cmp(&unlike(b)))
            .unwrap_or(Self::Seconds)
    }

    pub(crate) fn per_second(self) -> f64 {
        match self {
            Self::Seconds => 1.0,
            Self::Milliseconds => 1e3,
            Self::Microseconds => 1e6,
            Self::Nanoseconds => 1e9,
        }
    }

    /// A message about a list in this unit; `None` for seconds.
    pub(crate) fn remark(self, list: &std::path::Path) -> Option<String> {
        let name = match self {
            Self::Seconds => return None,
            Self::Milliseconds => "milliseconds",
            Self::Microseconds => "microseconds",
            Self::Nanoseconds => "nanoseconds",
        };
        Some(format!(
            "{}: stamps are {name}, by their size or distance; they are read as seconds",
            list.display()
        ))
    }
}

/// The median forward step; `None` for too few stamps.
fn usual_step(stamps: &[f64]) -> Option<f64> {
    let steps = stamps.iter().zip(stamps.iter().skip(1));
    let mut steps: Vec<f64> = steps.map(|(a, b)| b - a).filter(|s| *s > 0.0).collect();
    if stamps.len() < FEW || steps.is_empty() {
        return None;
    }
    let middle = steps.len() / 2;
    Some(*steps.select_nth_unstable_by(middle, f64::total_cmp).1)
}

#[cfg(test)]
mod tests {
    use super::*;

    fn unit(start: f64, step: f64) -> Unit {
        let stamps: Vec<f64> = (0..20).map(|i| start + step * f64::from(i)).collect();
        Unit::of(&stamps, BETWEEN_IMAGES)
    }

    #[test]
    fn unit_is_inferred_from_magnitude_and_step() {
        for (start, step, expected) in [
            (1.3e9, 1.0 / 30.0, Unit::Seconds),
            (0.0, 1.0, Unit::Seconds),
            (1.3e12, 33.3, Unit::Milliseconds),
            (0.0, 33.0, Unit::Milliseconds),
            (1.3e15, 33_333.0, Unit::Microseconds),
            (0.0, 33_333.0, Unit::Microseconds),
            (1.3e18, 33_333_333.0, Unit::Nanoseconds),
            (0.0, 33_333_333.0, Unit::Nanoseconds),
            // Since a computer was started.
            (4e12, 33_333_333.0, Unit::Nanoseconds),
        ] {
            assert_eq!(unit(start, step), expected, "{start} {step}");
        }
        // Poses of a motion capture system, since it was started.
        let fast: Vec<f64> = (0..20).map(|i| 1e7 * f64::from(i)).collect();
        assert_eq!(Unit::of(&fast, BETWEEN_POSES), Unit::Nanoseconds);
        // The step of only two stamps is inconclusive.
        assert_eq!(Unit::of(&[0.0, 60.0], BETWEEN_IMAGES), Unit::Seconds);
        assert_eq!(Unit::of(&[1.3e18], BETWEEN_IMAGES), Unit::Nanoseconds);
        assert_eq!(Unit::of(&[], BETWEEN_IMAGES), Unit::Seconds);
        // A single gap does not determine the unit.
        assert_eq!(
            Unit::of(&[0.0, 0.1, 0.2, 500.0, 500.1, 500.2], BETWEEN_IMAGES),
            Unit::Seconds
        );
    }
}
