//! State of a frame, as in `frames.csv` and reports.

use crate::report::{FrameReport, Outcome};

/// State of a frame. The numbers are column numbers of a report.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
#[repr(u8)]
pub enum FrameState {
    /// No pose was found, or it was withdrawn.
    Lost = 0,
    /// It started a map.
    Begun = 1,
    /// Its pose was measured.
    Tracked = 2,
    /// The camera was relocalised.
    Relocalised = 3,
    /// It has a pose, but it was undecided whether that follows the static scene or a moving object.
    Undecided = 4,
    /// Its rotation was propagated by a gyroscope, or its pose by wheel odometry.
    Carried = 5,
}

impl FrameState {
    /// Minimum number of inliers of a pose: poses with fewer may agree by chance; they are not written, and their
    /// frames count as lost. As in the local map of ORB-SLAM2 (Mur-Artal and Tardos, T-RO 2017).
    pub const MIN_INLIERS: u32 = 30;

    /// All states, by number.
    pub const ALL: [Self; 6] = [
        Self::Lost,
        Self::Begun,
        Self::Tracked,
        Self::Relocalised,
        Self::Undecided,
        Self::Carried,
    ];

    /// Name of the state.
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

    /// Parses a name.
    #[must_use]
    pub fn from_name(name: &str) -> Option<Self> {
        Self::ALL.into_iter().find(|state| state.name() == name)
    }
}

impl FrameReport {
    /// The state, as far as known at this frame.
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

    /// Why the state is [`FrameState::Lost`]; `None` in other states.
    #[must_use]
    pub fn loss(&self) -> Option<String> {
        let lost = self.state() == FrameState::Lost;
        lost.then(|| match self.outcome {
            Outcome::Lost { reason, .. } => reason.to_string(),
            _ => format!("fewer than {} inliers", FrameState::MIN_INLIERS),
        })
    }
}
