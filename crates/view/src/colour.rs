//! Colours with a meaning, the same in every picture.

/// An RGB colour.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

impl Colour {
    /// Paper.
    pub const WHITE: Self = Self(255, 255, 255);
    /// Ink.
    pub const BLACK: Self = Self(0, 0, 0);
    /// A feature that is static: used for the pose.
    pub const STATIC: Self = Self(46, 204, 86);
    /// A feature that nothing was decided about, or that was not used.
    pub const UNUSED: Self = Self(150, 158, 170);
    /// Rejected for the object it lies on.
    pub const SEMANTIC: Self = Self(240, 62, 62);
    /// Rejected for its distance from the epipolar line.
    pub const EPIPOLAR: Self = Self(255, 153, 31);
    /// Rejected for its depth.
    pub const DEPTH: Self = Self(224, 86, 253);
    /// Rejected because its motion is not that of the rigid scene.
    pub const RIGID: Self = Self(255, 221, 51);
    /// Rejected for what its landmark did before.
    pub const HISTORY: Self = Self(52, 172, 255);

    /// The colour of a thing with a number, such as an object or a segment: the same number always gets the same colour,
    /// and numbers that follow each other differ clearly (steps of the golden ratio). Hues from yellow-green to green are
    /// left out: green is what is static.
    #[must_use]
    pub fn of_number(number: u32) -> Self {
        // The hue circle has 1536 steps here, 6 ramps of 256 from red; 384 of them around green are left out.
        const FIRST: u64 = 704;
        const USED: u64 = 1152;
        let step = u64::from(number) * 381_966 * USED / 1_000_000 % USED;
        let hue = (FIRST + step) % 1536;
        let (ramp, up) = ((hue / 256) as u8, (hue % 256) as u8);
        let down = 255 - up;
        match ramp {
            0 => Self(255, up, 0),
            1 => Self(down, 255, 0),
            2 => Self(0, 255, up),
            3 => Self(0, down, 255),
            4 => Self(up, 0, 255),
            _ => Self(255, 0, down),
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn distance(a: Colour, b: Colour) -> i32 {
        let d = |a: u8, b: u8| (i32::from(a) - i32::from(b)).abs();
        d(a.0, b.0) + d(a.1, b.1) + d(a.2, b.2)
    }

    #[test]
    fn neighbours_in_number_differ() {
        for n in 0..200 {
            for step in 1..4 {
                let (a, b) = (Colour::of_number(n), Colour::of_number(n + step));
                assert!(distance(a, b) > 100, "{n} {step}: {a:?} {b:?}");
            }
        }
        for n in (0..2000).chain([u32::MAX]) {
            assert!(distance(Colour::of_number(n), Colour::STATIC) > 150, "{n}");
        }
    }

    #[test]
    fn meanings_differ() {
        let all = [
            Colour::STATIC,
            Colour::UNUSED,
            Colour::SEMANTIC,
            Colour::EPIPOLAR,
            Colour::DEPTH,
            Colour::RIGID,
            Colour::HISTORY,
        ];
        for (i, a) in all.iter().enumerate() {
            for b in &all[..i] {
                assert!(distance(*a, *b) > 60, "{a:?} {b:?}");
            }
        }
    }
}
