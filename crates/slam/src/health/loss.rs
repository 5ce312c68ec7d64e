//! Why the camera is lost, in words that somebody who holds it can use.

use crate::report::{FrameCounts, LostReason};
use stillpoint_imaging::{FrameId, RgbdFrame};

/// Mean grey level below which an image without contrast is black: chosen, a sixteenth of the 256 levels.
const BLACK: f64 = 16.0;
/// Mean grey level above which an image without contrast is white: 255 less [`BLACK`].
const WHITE: f64 = 239.0;
/// An image has no contrast where the standard deviation of its pixels is below this, grey levels: half of [`BLACK`], so that a dark image with some
/// contrast is not called black; chosen.
const FLAT: f64 = 8.0;
/// Share of the pixels with depth below which there is none: a sensor at work has some at every edge. Chosen: one pixel in twenty is far below what
/// any view of a room gives.
const NO_DEPTH: f64 = 0.05;
/// Share of the keypoints that move from which on nothing else is worth telling: the majority, by definition.
const CROWD: f64 = 0.5;
/// Pixels between two that are looked at, along x and y: chosen, as the 4800 pixels of 640x480 that remain tell a share to 0.7 % (one standard
/// deviation of a binomial share of a half).
const STEP: usize = 8;

/// A loss that lasts.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Its first frame.
    pub since: FrameId,
    /// How long it has lasted, s of the camera's time.
    pub seconds: f64,
    /// Which step of tracking gave up in this frame.
    pub reason: LostReason,
    /// What is most likely the cause.
    pub cause: LossCause,
    /// Whether there is a map, so that a place can be recognised.
    pub can_recognise: bool,
}

/// What makes a camera lost, with what tells it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LossCause {
    /// The image is black: no light, or a covered lens.
    Dark {
        /// Keypoints in the image.
        keypoints: u32,
        /// Keypoints without which there is no pose.
        needed: u32,
    },
    /// The image is white: too much light.
    Dazzled {
        /// Keypoints in the image.
        keypoints: u32,
        /// Keypoints without which there is no pose.
        needed: u32,
    },
    /// The image shows too little texture: a blank wall, or blur.
    Blank {
        /// Keypoints in the image.
        keypoints: u32,
        /// Keypoints without which there is no pose.
        needed: u32,
    },
    /// The depth image is empty.
    NoDepth {
        /// Share of the pixels that have a depth.
        pixels: f64,
    },
    /// Too few keypoints have a depth.
    FewDepths {
        /// Keypoints that have one.
        keypoints: u32,
        /// Those without which no map begins.
        needed: u32,
    },
    /// Most of what is seen moves.
    Crowd {
        /// Share of the keypoints that move, or lie in boxes of people and the like.
        moving: f64,
    },
    /// What is seen is not in the map.
    Unknown {
        /// Keypoints that match something known.
        matches: u32,
        /// Those without which there is no pose.
        needed: u32,
    },
    /// The image is that of the frame before.
    Repeated,
    /// Matches do not agree on one pose.
    Contradiction {
        /// Matches that agree.
        agreed: u32,
        /// Matches.
        matches: u32,
        /// Those without which no pose counts.
        needed: u32,
    },
}

impl LossCause {
    /// What helps.
    #[must_use]
    pub fn remedy(&self) -> &'static str {
        match self {
            Self::Dark { .. } => "uncover the lens or make light",
            Self::Dazzled { .. } => "turn away from the light",
            Self::Blank { .. } => "hold the camera still or turn it to more texture",
            Self::NoDepth { .. } => "check the depth sensor and its range",
            Self::FewDepths { .. } => {
                "turn the camera to surfaces within reach of its depth sensor"
            }
            Self::Crowd { .. } => "let them pass or turn the camera away from them",
            Self::Repeated => "start the camera or its driver again if that lasts",
            Self::Unknown { .. } => "go back to a place that it has seen",
            Self::Contradiction { .. } => "hold the camera still at a place that it has seen",
        }
    }

    /// Whether the remedy speaks of known places itself.
    fn is_about_places(&self) -> bool {
        matches!(self, Self::Unknown { .. } | Self::Contradiction { .. })
    }
}

/// A share as a whole number of percent.
pub(super) fn percent(share: f64) -> f64 {
    libm::round(100.0 * share)
}

impl std::fmt::Display for LossCause {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let few = |keypoints: u32, needed: u32| format!("({keypoints} keypoints; {needed} needed)");
        match *self {
            Self::Dark { keypoints, needed } => {
                write!(
                    f,
                    "the image is black or covered {}",
                    few(keypoints, needed)
                )
            }
            Self::Dazzled { keypoints, needed } => {
                write!(
                    f,
                    "the image is white, too much light {}",
                    few(keypoints, needed)
                )
            }
            Self::Blank { keypoints, needed } => write!(
                f,
                "the image shows too little texture, or is blurred {}",
                few(keypoints, needed)
            ),
            Self::NoDepth { pixels } => {
                write!(f, "no depth: {} % of the pixels have one", percent(pixels))
            }
            Self::FewDepths { keypoints, needed } => write!(
                f,
                "too few keypoints have a depth ({keypoints}; {needed} needed)"
            ),
            Self::Crowd { moving } => write!(
                f,
                "people or things that move fill the image: {} % of the keypoints are on them",
                percent(moving)
            ),
            Self::Repeated => write!(f, "the image stands still: it is that of the frame before"),
            Self::Unknown { matches, needed } => write!(
                f,
                "what is seen is not known ({matches} matches; {needed} needed)"
            ),
            Self::Contradiction {
                agreed,
                matches,
                needed,
            } => write!(
                f,
                "too few matches agree on where the camera is ({agreed} of {matches}; {needed} needed)"
            ),
        }
    }
}

/// One line, e.g. `lost for 1.2 s: the image is black or covered (3 keypoints; 30 needed); uncover the lens or make light, and
/// show it a place that it has seen`.
impl std::fmt::Display for Loss {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        let Self { seconds, cause, .. } = self;
        write!(f, "lost for {seconds:.1} s: {cause}; {}", cause.remedy())?;
        if self.can_recognise && !cause.is_about_places() {
            write!(f, ", and show it a place that it has seen")?;
        }
        Ok(())
    }
}

/// What an image looks like from afar, by every eighth pixel of every eighth row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Look {
    /// Mean grey level.
    mean: f64,
    /// Standard deviation of the grey levels.
    contrast: f64,
    /// Share of the pixels that have a depth.
    pub(super) depth: f64,
}

impl Look {
    pub(super) fn at(frame: &RgbdFrame) -> Self {
        let (gray, depth) = (&frame.gray, &frame.depth);
        let (mut n, mut sum, mut squares) = (0_u64, 0_u64, 0_u64);
        for y in (STEP / 2..gray.height()).step_by(STEP) {
            for v in gray.row(y).iter().skip(STEP / 2).step_by(STEP) {
                let v = u64::from(*v);
                (n, sum, squares) = (n + 1, sum + v, squares + v * v);
            }
        }
        let (mut pixels, mut measured) = (0_u64, 0_u64);
        let rows = depth.data().chunks_exact(depth.width().max(1));
        for row in rows.skip(STEP / 2).step_by(STEP) {
            for z in row.iter().skip(STEP / 2).step_by(STEP) {
                (pixels, measured) = (pixels + 1, measured + u64::from(*z > 0.0));
            }
        }
        let share = |part: u64, all: u64| part as f64 / all.max(1) as f64;
        let mean = share(sum, n);
        Self {
            mean,
            contrast: (share(squares, n) - mean * mean).max(0.0).sqrt(),
            depth: share(measured, pixels),
        }
    }
}

/// What is known of a frame without a pose.
pub(super) struct Clues<'a> {
    pub(super) reason: LostReason,
    pub(super) counts: &'a FrameCounts,
    pub(super) look: Look,
    /// Share of the keypoints that lie on what moves.
    pub(super) moving: f64,
    /// Keypoints, or of these the ones with depth, without which there is no pose.
    pub(super) needed: u32,
}

/// What makes the camera lost: what can be seen in the image comes before what tracking made of it.
pub(super) fn cause(clues: &Clues<'_>) -> LossCause {
    let Clues {
        reason,
        counts,
        look,
        moving,
        needed,
    } = *clues;
    let keypoints = counts.keypoints;
    if look.contrast < FLAT && look.mean < BLACK {
        return LossCause::Dark { keypoints, needed };
    }
    if look.contrast < FLAT && look.mean > WHITE {
        return LossCause::Dazzled { keypoints, needed };
    }
    match reason {
        LostReason::Repeated => LossCause::Repeated,
        LostReason::FewFeatures => LossCause::Blank { keypoints, needed },
        _ if look.depth < NO_DEPTH => LossCause::NoDepth { pixels: look.depth },
        LostReason::FewDepths => LossCause::FewDepths {
            keypoints: counts.with_depth,
            needed,
        },
        _ if moving >= CROWD => LossCause::Crowd { moving },
        LostReason::FewMatches => LossCause::Unknown {
            matches: counts.frame_matches,
            needed,
        },
        LostReason::FewInliers | LostReason::AgainstGyro | LostReason::AgainstOdometry => {
            LossCause::Contradiction {
                agreed: counts.inliers,
                matches: counts.map_matches,
                needed,
            }
        }
    }
}

#[cfg(test)]
mod tests;
