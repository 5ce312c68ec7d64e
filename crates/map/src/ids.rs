//! Identifiers, never reused.

use std::num::NonZeroU32;

/// A keyframe: the number of its frame.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct KeyframeId(pub u32);

/// A landmark, numbered from 0 in the order of creation. Stored as its number plus one, so that `Option<LandmarkId>`,
/// needed for every feature of a keyframe, takes four bytes instead of eight.
#[derive(Clone, Copy, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct LandmarkId(NonZeroU32);

/// A submap: the id of its first keyframe. Keyframes of one submap share a frame of reference; the relative pose of two
/// submaps is unknown until a place of one is recognised in the other and they are joined.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, PartialOrd, Ord, Hash)]
pub struct SubmapId(pub u32);

impl KeyframeId {
    /// As an index into arrays.
    #[must_use]
    pub fn index(self) -> usize {
        self.0 as usize
    }
}

impl LandmarkId {
    /// The landmark with a number. The two largest numbers, which no map reaches, give the same id.
    #[must_use]
    pub const fn new(number: u32) -> Self {
        Self(NonZeroU32::MIN.saturating_add(number))
    }

    /// Its number.
    #[must_use]
    pub const fn number(self) -> u32 {
        self.0.get() - 1
    }

    /// As an index into arrays.
    #[must_use]
    pub const fn index(self) -> usize {
        self.number() as usize
    }
}

impl Default for LandmarkId {
    fn default() -> Self {
        Self::new(0)
    }
}

impl std::fmt::Debug for LandmarkId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.debug_tuple("LandmarkId").field(&self.number()).finish()
    }
}

impl std::fmt::Display for KeyframeId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

impl std::fmt::Display for LandmarkId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.number())
    }
}

impl std::fmt::Display for SubmapId {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}", self.0)
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn optional_landmark_id_takes_four_bytes() {
        assert_eq!(size_of::<Option<LandmarkId>>(), 4);
        for number in [0, 1, 7, u32::MAX - 1] {
            assert_eq!(LandmarkId::new(number).number(), number);
        }
        assert!(LandmarkId::new(3) < LandmarkId::new(4));
        let shown = format!("{0:?} {0}", LandmarkId::new(5));
        assert_eq!(shown, "LandmarkId(5) 5");
        assert_eq!(LandmarkId::default(), LandmarkId::new(0));
        assert_eq!(LandmarkId::new(u32::MAX), LandmarkId::new(u32::MAX - 1));
    }
}
