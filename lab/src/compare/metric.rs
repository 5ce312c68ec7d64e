//! Compared metrics and their verdicts.

use super::statistics::{Estimate, Sum, enough};
use crate::results::{Figures, Run};
use crate::table::{self, figure};

/// Smaller relative differences of times and memory are ignored: two processes of one program differ as much.
const MARGIN: f64 = 0.05;

pub(super) struct Metric {
    pub(super) name: &'static str,
    pub(super) of: fn(&Figures) -> Option<f64>,
    pub(super) sum: Sum,
    /// Ignored relative deviation of a ratio from 1.
    margin: f64,
    /// Compared only between runs with `--jobs 1`.
    pub(super) timed: bool,
    digits: usize,
}

pub(super) const METRICS: [Metric; 6] = [
    Metric {
        name: "ATE, mm",
        of: |f| f.ate_mm,
        sum: Sum::Ratios,
        margin: 0.0,
        timed: false,
        digits: 2,
    },
    Metric {
        name: "ATE at each frame, mm",
        of: |f| f.online_ate_mm,
        sum: Sum::Ratios,
        margin: 0.0,
        timed: false,
        digits: 2,
    },
    Metric {
        name: "lost frames",
        of: |f| Some(f.lost as f64),
        sum: Sum::Differences,
        margin: 0.0,
        timed: false,
        digits: 1,
    },
    Metric {
        name: "wrong frames",
        of: |f| Some(f.wrong as f64),
        sum: Sum::Differences,
        margin: 0.0,
        timed: false,
        digits: 1,
    },
    Metric {
        name: "frame, ms",
        of: Figures::frame_ms,
        sum: Sum::Ratios,
        margin: MARGIN,
        timed: true,
        digits: 2,
    },
    Metric {
        name: "memory, MB",
        of: |f| f.memory_bytes.map(|b| b as f64 * 1e-6),
        sum: Sum::Ratios,
        margin: MARGIN,
        timed: false,
        digits: 0,
    },
];

/// Verdict on B.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Verdict {
    /// All pairs are equal.
    Same,
    Better,
    Worse,
    NoDifference,
    TooFew,
    /// Some runs shared the machine with others.
    NotTimed,
}

impl Verdict {
    pub(super) fn words(self) -> &'static str {
        match self {
            Self::Same => "the same",
            Self::Better => "better",
            Self::Worse => "WORSE",
            Self::NoDifference => "no difference beyond seeds",
            Self::TooFew => "too few to tell",
            Self::NotTimed => "not judged: needs --jobs 1",
        }
    }
}

impl Metric {
    /// The contrast of equal values.
    fn neutral(&self) -> f64 {
        match self.sum {
            Sum::Ratios => 1.0,
            Sum::Differences => 0.0,
        }
    }

    /// B / A or B - A. `None` if undefined.
    pub(super) fn contrast(&self, (a, b): &(Run, Run)) -> Option<f64> {
        let of = |r: &Run| r.figures.as_ref().and_then(self.of);
        let (a, b) = (of(a)?, of(b)?);
        let value = match self.sum {
            // 0 / 0 counts as 1.
            Sum::Ratios if a == b => 1.0,
            Sum::Ratios => b / a,
            Sum::Differences => b - a,
        };
        (value.is_finite() && (self.sum == Sum::Differences || value > 0.0)).then_some(value)
    }

    /// `independent` of the contrasts are independent.
    pub(super) fn judge(
        &self,
        contrasts: &[Vec<f64>],
        independent: usize,
        (e, outside): (Estimate, f64),
    ) -> Verdict {
        let mut all = contrasts.iter().flatten();
        let (above, below) = match self.sum {
            Sum::Ratios => (1.0 + self.margin, 1.0 / (1.0 + self.margin)),
            Sum::Differences => (0.0, 0.0),
        };
        if all.all(|c| *c == self.neutral()) {
            Verdict::Same
        } else if !enough(independent, outside) {
            Verdict::TooFew
        } else if e.low > above {
            Verdict::Worse
        } else if e.high < below {
            Verdict::Better
        } else {
            Verdict::NoDifference
        }
    }

    /// The median of one side; of counts the mean.
    pub(super) fn side(&self, runs: impl Iterator<Item = f64>) -> String {
        let values: Vec<f64> = runs.collect();
        let value = match self.sum {
            Sum::Ratios => table::spread(values)[0],
            Sum::Differences => values.iter().sum::<f64>() / values.len() as f64,
        };
        figure(value, self.digits)
    }

    pub(super) fn interval(&self, e: Estimate) -> [String; 2] {
        match self.sum {
            Sum::Ratios => [
                format!("{:.3}", e.value),
                format!("{:.3} to {:.3}", e.low, e.high),
            ],
            Sum::Differences => [
                format!("{:+.1}", e.value),
                format!("{:+.1} to {:+.1}", e.low, e.high),
            ],
        }
    }
}
