//! Colours by meaning, equal in all images.
//!
//! Static features are green, rejected ones warm, objects cool. Warm and cool stay distinguishable for people with red-green colour
//! blindness, and static and rejected features also differ in shape.

/// An RGB colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

impl Colour {
    /// White.
    pub const WHITE: Self = Self(255, 255, 255);
    /// Black.
    pub const BLACK: Self = Self(0, 0, 0);
    /// A static feature, used for the pose.
    pub const STATIC: Self = Self(30, 200, 110);
    /// An undecided or unused feature.
    pub const UNUSED: Self = Self(150, 158, 170);
    /// Rejected by its object.
    pub const SEMANTIC: Self = Self(238, 52, 28);
    /// Rejected by its distance from the epipolar line.
    pub const EPIPOLAR: Self = Self(255, 232, 40);
    /// Rejected by its depth.
    pub const DEPTH: Self = Self(255, 214, 168);
    /// Rejected because its motion differs from the rigid scene's.
    pub const RIGID: Self = Self(255, 150, 0);
    /// Rejected by its landmark's history.
    pub const HISTORY: Self = Self(168, 92, 36);
    /// Tint and outline of a moving region.
    pub const REGION: Self = Self(238, 52, 28);
    /// Background of the lines under an image.
    pub const PANEL: Self = Self(20, 23, 28);
    /// Frame of an unlabelled object.
    pub const THING: Self = Self(196, 204, 214);

    /// Colours of objects, from cyan over blue to purple, ordered so that neighbours differ clearly.
    pub(crate) const OBJECTS: [Self; 8] = [
        Self(56, 132, 255),
        Self(196, 150, 255),
        Self(0, 206, 255),
        Self(132, 70, 240),
        Self(20, 160, 214),
        Self(206, 92, 255),
        Self(150, 210, 255),
        Self(44, 76, 226),
    ];

    /// The colour of an object: constant per id, and clearly different for consecutive ids. Never green or warm, as verdicts are.
    #[must_use]
    pub fn of_number(number: u32) -> Self {
        Self::OBJECTS[number as usize % Self::OBJECTS.len()]
    }

    /// Black on bright colours, white on dark ones.
    #[must_use]
    pub(crate) fn ink(self) -> Self {
        let luma = 77 * u32::from(self.0) + 150 * u32::from(self.1) + 29 * u32::from(self.2);
        if luma > 128 * 256 {
            Self::BLACK
        } else {
            Self::WHITE
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    const VERDICTS: [Colour; 6] = [
        Colour::STATIC,
        Colour::SEMANTIC,
        Colour::EPIPOLAR,
        Colour::DEPTH,
        Colour::RIGID,
        Colour::HISTORY,
    ];

    fn distance(a: Colour, b: Colour) -> f64 {
        let d = |a: u8, b: u8| (f64::from(a) - f64::from(b)).powi(2);
        (d(a.0, b.0) + d(a.1, b.1) + d(a.2, b.2)).sqrt()
    }

    /// The colour as seen without the cones for long (0) or medium (1) wavelengths. Source: Machado, Oliveira, Fernandes, A
    /// physiologically-based model for simulation of color vision deficiency, 2009, severity 1; applied to encoded values.
    fn seen(colour: Colour, missing: usize) -> Colour {
        const MATRICES: [[[f64; 3]; 3]; 2] = [
            [
                [0.152_286, 1.052_583, -0.204_868],
                [0.114_503, 0.786_281, 0.099_216],
                [-0.003_882, -0.048_116, 1.051_998],
            ],
            [
                [0.367_322, 0.860_646, -0.227_968],
                [0.280_085, 0.672_501, 0.047_413],
                [-0.011_820, 0.042_940, 0.968_881],
            ],
        ];
        let [r, g, b] = [colour.0, colour.1, colour.2].map(f64::from);
        let [r, g, b] = MATRICES[missing].map(|m| (m[0] * r + m[1] * g + m[2] * b).round() as u8);
        Colour(r, g, b)
    }

    #[test]
    fn consecutive_numbers_have_distinct_colours() {
        for n in 0..200 {
            for step in 1..4 {
                let (a, b) = (Colour::of_number(n), Colour::of_number(n + step));
                assert!(distance(a, b) > 60.0, "{n} {step}: {a:?} {b:?}");
            }
        }
        assert_eq!(Colour::of_number(u32::MAX), Colour::of_number(7));
    }

    #[test]
    fn object_colours_differ_from_verdict_colours() {
        for object in Colour::OBJECTS {
            for verdict in VERDICTS {
                let d = distance(object, verdict);
                assert!(d > 100.0, "{object:?} {verdict:?}: {d}");
                for missing in 0..2 {
                    let d = distance(seen(object, missing), seen(verdict, missing));
                    assert!(d > 75.0, "{object:?} {verdict:?} without {missing}: {d}");
                }
            }
        }
    }

    #[test]
    fn verdict_colours_are_distinct() {
        for (i, a) in VERDICTS.iter().enumerate() {
            for b in VERDICTS[..i].iter().chain(&[Colour::UNUSED]) {
                assert!(distance(*a, *b) > 60.0, "{a:?} {b:?}");
            }
        }
        // Static and rejected features differ with red-green colour blindness too.
        for rejected in &VERDICTS[1..] {
            for missing in 0..2 {
                let d = distance(seen(Colour::STATIC, missing), seen(*rejected, missing));
                assert!(d > 60.0, "{rejected:?} without {missing}: {d}");
            }
        }
    }
}
