//! Verdicts: what the filter says of each feature, and why.

/// Why a feature got its verdict: a set.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub struct Reasons(u16);

impl Reasons {
    /// In the box of an object of a class that moves.
    pub const OBJECT: Self = Self(1);
    /// Off its epipolar line.
    pub const EPIPOLAR: Self = Self(1 << 1);
    /// By its depth within the box: of the object when dynamic, of the background when static.
    pub const DEPTH: Self = Self(1 << 2);
    /// Breaks (when dynamic) or keeps (when static) the rigid motion of the scene.
    pub const RIGID: Self = Self(1 << 3);
    /// What was there in the frames before.
    pub const AGE: Self = Self(1 << 4);
    /// On an object that stands still: good for this pose, makes no landmark.
    pub const PARKED: Self = Self(1 << 5);
    /// Kept because too few others were left.
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

    /// No reason: nothing spoke against the feature.
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

/// Joined by `+`, e.g. `object+rigid`; empty when there is none.
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

/// What the filter says of one feature.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct FeatureVerdict {
    /// Where it is, raw px.
    pub pixel: [f32; 2],
    /// Whether it is kept from tracking, mapping and loop closing.
    pub dynamic: bool,
    /// Why.
    pub reasons: Reasons,
    /// Risk of keeping it, in log odds of "moving" or what the preset has in its place: the starvation guard releases the
    /// lowest first.
    pub risk: f32,
}

impl FeatureVerdict {
    /// Nothing speaks against the feature.
    #[must_use]
    pub fn kept(pixel: [f32; 2]) -> Self {
        Self {
            pixel,
            dynamic: false,
            reasons: Reasons::default(),
            risk: 0.0,
        }
    }

    /// Brings the verdict to whether its pixel is in the mask of what moves. Reasons for the opposite are dropped.
    pub(crate) fn follow(&mut self, moves: bool) {
        if self.dynamic != moves {
            self.dynamic = moves;
            self.reasons = [Reasons::default(), Reasons::RIGID][usize::from(moves)];
        }
    }

    /// Whether the feature may become or confirm a landmark.
    #[must_use]
    pub fn may_map(&self) -> bool {
        !self.dynamic && !self.reasons.has(Reasons::PARKED) && !self.reasons.has(Reasons::RELEASED)
    }
}

/// Losing track is worse than a few bad points: when fewer than `enough` features are static, releases dynamic ones in the
/// order of least risk until there are. Returns how many.
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
    fn releases_the_least_risky_and_no_more_than_needed() {
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
