//! Verdicts on features, with reasons.

/// Reasons of a verdict, a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reasons(u16);

impl Reasons {
    /// In the box of an object of a moving class.
    pub const OBJECT: Self = Self(1);
    /// Off its epipolar line.
    pub const EPIPOLAR: Self = Self(1 << 1);
    /// Depth within the box: of the object if dynamic, of the background if static.
    pub const DEPTH: Self = Self(1 << 2);
    /// Contradicts (if dynamic) or fits (if static) the rigid motion of the scene.
    pub const RIGID: Self = Self(1 << 3);
    /// Motion in earlier frames.
    pub const AGE: Self = Self(1 << 4);
    /// On a parked object: used for this pose, but creates no landmark.
    pub const PARKED: Self = Self(1 << 5);
    /// Kept because too few others remained.
    pub const RELEASED: Self = Self(1 << 6);

    const NAMES: [(Self, &'static str); 7] = [
        (Self::OBJECT, "object"),
        (Self::EPIPOLAR, "epipolar"),
        (Self::DEPTH, "depth"),
        (Self::RIGID, "rigid"),
        (Self::AGE, "age"),
        (Self::PARKED, "parked"),
        (Self::RELEASED, "released"),
    ];

    /// Whether all of `other` are among these.
    #[must_use]
    pub fn has(self, other: Self) -> bool {
        self.0 & other.0 == other.0
    }

    /// Whether there are no reasons.
    #[must_use]
    pub fn is_empty(self) -> bool {
        self.0 == 0
    }
}

impl std::ops::BitOr for Reasons {
    type Output = Self;

    fn bitor(self, other: Self) -> Self {
        Self(self.0 | other.0)
    }
}

impl std::ops::BitOrAssign for Reasons {
    fn bitor_assign(&mut self, other: Self) {
        self.0 |= other.0;
    }
}

/// Joined by `+`, e.g. `object+rigid`; empty without reasons.
impl std::fmt::Display for Reasons {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let mut first = true;
        for (reason, name) in Self::NAMES {
            if self.has(reason) {
                if !first {
                    f.write_str("+")?;
                }
                f.write_str(name)?;
                first = false;
            }
        }
        Ok(())
    }
}

/// Verdict on one feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureVerdict {
    /// Raw pixel.
    pub pixel: [f32; 2],
    /// Whether it is excluded from tracking, mapping and loop closing.
    pub dynamic: bool,
    /// Reasons.
    pub reasons: Reasons,
    /// Risk of keeping it, as log odds of "moving" or the preset's equivalent: features with the lowest risk are
    /// released first.
    pub risk: f32,
}

impl FeatureVerdict {
    /// A static verdict without reasons.
    #[must_use]
    pub fn kept(pixel: [f32; 2]) -> Self {
        Self {
            pixel,
            dynamic: false,
            reasons: Reasons::default(),
            risk: 0.0,
        }
    }

    /// Makes the verdict agree with the mask. Contrary reasons are dropped.
    pub(crate) fn follow(&mut self, moves: bool) {
        if self.dynamic != moves {
            self.dynamic = moves;
            self.reasons = [Reasons::default(), Reasons::RIGID][usize::from(moves)];
        }
    }

    /// Whether the feature may create or confirm a landmark.
    #[must_use]
    pub fn may_map(&self) -> bool {
        !self.dynamic && !self.reasons.has(Reasons::PARKED) && !self.reasons.has(Reasons::RELEASED)
    }
}

/// With fewer than `enough` static features, releases dynamic ones in order of risk, since losing track is worse than a
/// few outliers. Returns the number released.
pub(super) fn release_when_starving(verdicts: &mut [FeatureVerdict], enough: usize) -> u32 {
    let kept = verdicts.iter().filter(|v| !v.dynamic).count();
    if kept >= enough {
        return 0;
    }
    let mut order: Vec<usize> = (0..verdicts.len())
        .filter(|i| verdicts[*i].dynamic)
        .collect();
    order.sort_by(|a, b| {
        verdicts[*a]
            .risk
            .total_cmp(&verdicts[*b].risk)
            .then(a.cmp(b))
    });
    order.truncate(enough - kept);
    for i in &order {
        verdicts[*i].dynamic = false;
        verdicts[*i].reasons |= Reasons::RELEASED;
    }
    order.len() as u32
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn reasons_print_as_words() {
        assert_eq!(Reasons::default().to_string(), "");
        assert_eq!(
            (Reasons::RIGID | Reasons::OBJECT).to_string(),
            "object+rigid"
        );
    }

    #[test]
    fn least_risky_features_are_released_first() {
        let mut verdicts: Vec<FeatureVerdict> = (0..10)
            .map(|i| FeatureVerdict {
                dynamic: i >= 2,
                risk: (10 - i) as f32,
                ..FeatureVerdict::kept([0.0; 2])
            })
            .collect();
        assert_eq!(release_when_starving(&mut verdicts, 5), 3);
        let kept: Vec<usize> = (0..10).filter(|i| !verdicts[*i].dynamic).collect();
        assert_eq!(kept, [0, 1, 7, 8, 9]);
        assert!(
            kept[2..]
                .iter()
                .all(|i| verdicts[*i].reasons.has(Reasons::RELEASED) && !verdicts[*i].may_map())
        );
        assert_eq!(release_when_starving(&mut verdicts, 5), 0);
    }
}
