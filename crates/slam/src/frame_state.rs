//! What became of a frame, in one word: the same in `frames.csv`, under pictures and on pages.

use crate::report::{FrameReport, Outcome};

/// What became of a frame. The numbers are those of the columns of a page.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum FrameState {
    /// No pose was found, or it was withdrawn.
    Lost = 0,
    /// It began a map.
    Begun = 1,
    /// Its pose was measured.
    Tracked = 2,
    /// The camera was found again.
    Relocalised = 3,
    /// It has a pose, from a time at which it was undecided who moves.
    Undecided = 4,
    /// Its direction was carried by a gyroscope, or its pose by wheels.
    Carried = 5,
}

impl FrameState {
    /// Fewer landmarks may agree on a pose by chance, a number: such poses are not written, and their frames count as lost. ORB-SLAM2 (Mur-Artal and Tardos,
    /// T-RO 2017) asks for as many in its local map.
    pub const MIN_INLIERS: u32 = 30;

    /// All states, by their numbers.
    pub const ALL: [Self; 6] = [
        Self::Lost,
        Self::Begun,
        Self::Tracked,
        Self::Relocalised,
        Self::Undecided,
        Self::Carried,
    ];

    /// Its word.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Lost => "lost",
            Self::Begun => "initialised",
            Self::Tracked => "tracked",
            Self::Relocalised => "relocalised",
            Self::Undecided => "undecided",
            Self::Carried => "carried",
        }
    }

    /// From its word.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }
}

impl FrameReport {
    /// What became of the frame, as far as that is known at this frame.
    #[must_use]
    pub fn state(&self) -> FrameState {
        let is_thin = self.counts.inliers < FrameState::MIN_INLIERS;
        match self.outcome {
            Outcome::Lost { .. } => FrameState::Lost,
            Outcome::Tracked | Outcome::Relocalised { .. } if is_thin => FrameState::Lost,
            _ if self.is_undecided() => FrameState::Undecided,
            Outcome::Initialised => FrameState::Begun,
            Outcome::Carried { .. } => FrameState::Carried,
            Outcome::Tracked => FrameState::Tracked,
            Outcome::Relocalised { .. } => FrameState::Relocalised,
        }
    }

    /// Why its state is [`FrameState::Lost`]; none in other states.
    #[must_use]
    pub fn loss(&self) -> Option<String> {
        let lost = self.state() == FrameState::Lost;
        lost.then(|| match self.outcome {
            Outcome::Lost { reason, .. } => reason.to_string(),
            _ => format!("fewer than {} inliers", FrameState::MIN_INLIERS),
        })
    }
}
