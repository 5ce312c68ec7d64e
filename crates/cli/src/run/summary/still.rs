//! Repeated images, for `summary.json`.

use super::LostStretch;
use serde::{Deserialize, Serialize};
use stillpoint::imaging::Still;

/// Which images are repeated.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "snake_case")]
pub(crate) enum StillJson {
    /// The depth image: its frames were tracked without depth.
    #[default]
    Depth,
    /// The colour image: its frames have no pose.
    Colour,
    /// Both, because the stream hung: its frames have no pose.
    Frame,
    /// Both, from a source without noise that stands still.
    Rest,
}

impl From<Still> for StillJson {
    fn from(what: Still) -> Self {
        match what {
            Still::Depth => Self::Depth,
            Still::Colour => Self::Colour,
            Still::Frame => Self::Frame,
            Still::Rest => Self::Rest,
        }
    }
}

#[derive(Clone, Debug, Default, PartialEq, Serialize, Deserialize)]
pub(crate) struct StillStretch {
    pub(crate) what: StillJson,
    pub(crate) first: u32,
    pub(crate) last: u32,
    pub(crate) frames: u32,
    /// Duration, s.
    pub(crate) seconds: f64,
}

impl StillStretch {
    /// Number of frames without a pose for this reason.
    pub(crate) fn passed_over(&self) -> usize {
        let none = matches!(self.what, StillJson::Colour | StillJson::Frame);
        if none {
            (self.last - self.first + 1) as usize
        } else {
            0
        }
    }

    /// Whether it explains why frames have no pose.
    pub(crate) fn explains(&self, lost: &LostStretch) -> bool {
        self.passed_over() > 0 && self.first <= lost.first && lost.last <= self.last
    }
}

impl std::fmt::Display for StillStretch {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let (what, therefore) = match self.what {
            StillJson::Depth => ("the depth image", "they were tracked without depth"),
            StillJson::Colour => ("the colour image", "they are no new views and have no pose"),
            StillJson::Frame => (
                "the whole frame",
                "the stream hung; they are no new views and have no pose",
            ),
            StillJson::Rest => (
                "the whole frame",
                "there is no noise in it, so that the camera was at rest or the stream was paused",
            ),
        };
        write!(
            f,
            "{what} stood still in frames {} to {} ({} frames, {:.2} s): {therefore}",
            self.first, self.last, self.frames, self.seconds
        )
    }
}
