//! Quality of a pose: the minimum of four values from 0 to 1.

/// Factor on the minimum number of inliers from which the value is 1: beyond four times, more keypoints gain nothing,
/// and five are no better (decision 17).
const PLENTY: f64 = 5.0;
/// Share of inliers among the matches in a good frame: the rest are usual mismatches. Chosen: three matches of four, so
/// that quality begins to fall when mismatches exceed one in four.
const USUAL_AGREEMENT: f64 = 0.75;
/// Share of image cells with inliers in a good frame: blank walls and floors have none. Chosen: they fill about the
/// other half of a room's view.
const USUAL_SPREAD: f64 = 0.5;
/// Standard deviation of position or rotation at which certainty is one half, m and rad: chosen, about the size of
/// errors among people, which have medians of 6 mm (fr1_xyz_walkers) and 14 mm (fr1_rpy_walkers; decision 45).
const HALF_CERTAIN: f64 = 0.01;

use crate::evidence::Cells;

/// Tracking quality. Each part runs from 0 (worst) to 1 (best); all are 0 for a lost frame. [`Quality::value`] is their
/// minimum, so that correlated parts are not counted twice.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Quality {
    /// Number of inliers relative to five times [`min_inliers`](crate::TrackingConfig::min_inliers), at most 1. A pose
    /// with just enough inliers has 0.2.
    pub inliers: f64,
    /// Share of inliers among the matches, relative to 0.75, at most 1.
    pub agreement: f64,
    /// Distribution of the inliers: share of the 8x6 cells that have one, relative to 0.5, at most 1.
    pub spread: f64,
    /// Certainty: `1 / (1 + (s_m / 1 cm)^2 + (s_rad / 10 mrad)^2)` with the standard deviations of position and
    /// rotation; 0 if the matches leave a direction unconstrained.
    pub certainty: f64,
}

impl Quality {
    /// Quality in `[0, 1]`: the minimum of the parts.
    #[must_use]
    pub fn value(&self) -> f64 {
        self.weakest().1
    }

    /// Description and value of the lowest part.
    #[must_use]
    pub fn weakest(&self) -> (&'static str, f64) {
        let parts = [
            ("few inliers", self.inliers),
            ("matches disagree", self.agreement),
            ("inliers in one place", self.spread),
            ("uncertain pose", self.certainty),
        ];
        let mut least = parts[0];
        for part in &parts[1..] {
            if part.1 < least.1 {
                least = *part;
            }
        }
        least
    }

    pub(super) fn of(measured: &Measured) -> Self {
        let Measured {
            agreed,
            matched,
            needed,
            cells,
            sigmas,
        } = *measured;
        let share = |part: u32, all: f64| (f64::from(part) / all).min(1.0);
        Self {
            inliers: share(agreed, PLENTY * f64::from(needed.max(1))),
            agreement: share(agreed, USUAL_AGREEMENT * f64::from(matched.max(1))),
            spread: share(cells.count(), USUAL_SPREAD * f64::from(Cells::COUNT)),
            certainty: sigmas.map_or(0.0, |(m, rad)| {
                let (m, rad) = (m / HALF_CERTAIN, rad / HALF_CERTAIN);
                1.0 / (1.0 + m * m + rad * rad)
            }),
        }
    }
}

/// Inputs of the quality of a pose.
#[derive(Clone, Copy, Debug)]
pub(super) struct Measured {
    pub(super) agreed: u32,
    /// Matches used to estimate the pose.
    pub(super) matched: u32,
    /// Minimum number of inliers of a pose.
    pub(super) needed: u32,
    pub(super) cells: Cells,
    /// Standard deviations of position (m) and rotation (rad), if known.
    pub(super) sigmas: Option<(f64, f64)>,
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    fn measured() -> impl Strategy<Value = Measured> {
        let sigmas = prop::option::of((0.0..1.0f64, 0.0..1.0f64));
        (0..500_u32, 0..500_u32, 0..100_u32, any::<u64>(), sigmas).prop_map(
            |(agreed, others, needed, cells, sigmas)| Measured {
                agreed,
                matched: agreed + others,
                needed,
                cells: Cells::of_bits(cells),
                sigmas,
            },
        )
    }

    proptest! {
        #[test]
        fn quality_is_in_0_to_1_and_at_most_every_part(m in measured()) {
            let q = Quality::of(&m);
            for part in [q.inliers, q.agreement, q.spread, q.certainty] {
                prop_assert!((0.0..=1.0).contains(&part));
                prop_assert!(q.value() <= part);
            }
            prop_assert!(q.weakest().1 == q.value());
        }

        /// Improving any input does not reduce the quality.
        #[test]
        fn quality_is_monotone(m in measured(), more in 1..100_u32, cell in 0..Cells::COUNT, less in 0.0..1.0f64) {
            let before = Quality::of(&m).value();
            let better = [
                // A match that becomes an inlier, and an additional inlier.
                Measured { agreed: (m.agreed + more).min(m.matched), ..m },
                Measured { agreed: m.agreed + more, matched: m.matched + more, ..m },
                Measured { matched: m.matched - (m.matched - m.agreed).min(more), ..m },
                Measured { cells: Cells::of_bits(m.cells.bits() | 1 << cell), ..m },
                Measured { sigmas: m.sigmas.map(|(t, r)| (t * less, r)), ..m },
                Measured { sigmas: m.sigmas.map(|(t, r)| (t, r * less)), ..m },
                Measured { sigmas: m.sigmas.or(Some((less, less))), ..m },
            ];
            for b in better {
                prop_assert!(Quality::of(&b).value() >= before, "{b:?}");
            }
        }
    }

    #[test]
    fn weakest_quality_part_is_reported() {
        let good = Measured {
            agreed: 300,
            matched: 320,
            needed: 30,
            cells: Cells::of_bits((1 << 30) - 1),
            sigmas: Some((0.001, 0.001)),
        };
        let quality = Quality::of(&good);
        assert!(quality.value() > 0.95, "{quality:?}");
        let worst = |m: Measured| Quality::of(&m).weakest().0;
        let few = Measured {
            agreed: 30,
            matched: 32,
            ..good
        };
        assert_eq!(worst(few), "few inliers");
        assert!((Quality::of(&few).value() - 0.2).abs() < 1e-12);
        assert_eq!(
            worst(Measured {
                matched: 3000,
                ..good
            }),
            "matches disagree"
        );
        let corner = Measured {
            cells: Cells::of_bits(0b11),
            ..good
        };
        assert_eq!(worst(corner), "inliers in one place");
        let open = Measured {
            sigmas: None,
            ..good
        };
        assert_eq!(worst(open), "uncertain pose");
        assert!(Quality::of(&open).value() == 0.0);
        assert!(Quality::default().value() == 0.0);
    }
}
