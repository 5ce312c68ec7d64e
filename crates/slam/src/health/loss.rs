//! Causes of tracking loss, described for the person holding the camera.

use crate::report::{FrameCounts, LostReason};
use stillpoint_imaging::{FrameId, RgbdFrame};

/// Mean grey level below which an image without contrast is black, and as far from 255 white: chosen, a sixteenth of
/// the 256 levels. An image has no contrast if the standard deviation of its pixels is below half of that.
const BLACK: f64 = 16.0;
/// Share of pixels with depth below which the depth image counts as empty: a working sensor measures some at every
/// edge. Chosen: one pixel in twenty is far below any view of a room.
const NO_DEPTH: f64 = 0.05;
/// Share of moving keypoints from which a crowd is reported as the cause: the majority, by definition.
const CROWD: f64 = 0.5;
/// Distance between sampled pixels along x and y, px: chosen, as the 4800 samples of 640x480 give a share to 0.7 % (one
/// standard deviation of a binomial share of a half).
const STEP: usize = 8;

/// An ongoing tracking loss.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct Loss {
    /// Its first frame.
    pub since: FrameId,
    /// Duration, s of the camera's time.
    pub seconds: f64,
    /// The step of tracking that failed in this frame.
    pub reason: LostReason,
    /// Most likely cause.
    pub cause: LossCause,
    /// Whether a map exists in which the camera can relocalise.
    pub can_recognise: bool,
}

/// Cause of a tracking loss, with the figures that show it.
#[derive(Clone, Copy, Debug, PartialEq)]
#[non_exhaustive]
pub enum LossCause {
    /// The image is black: no light, or a covered lens.
    Dark {
        /// Keypoints in the image.
        keypoints: u32,
        /// Minimum number of keypoints for a pose.
        needed: u32,
    },
    /// The image is white: too much light.
    Dazzled {
        /// Keypoints in the image.
        keypoints: u32,
        /// Minimum number of keypoints for a pose.
        needed: u32,
    },
    /// Too little texture: a blank wall, or blur.
    Blank {
        /// Keypoints in the image.
        keypoints: u32,
        /// Minimum number of keypoints for a pose.
        needed: u32,
    },
    /// The depth image is empty.
    NoDepth {
        /// Share of the pixels that have depth.
        pixels: f64,
    },
    /// Too few keypoints have depth.
    FewDepths {
        /// Keypoints with depth.
        keypoints: u32,
        /// Minimum number to start a map.
        needed: u32,
    },
    /// Most of the image moves.
    Crowd {
        /// Share of the keypoints that move, or lie in boxes of people and the like.
        moving: f64,
    },
    /// The view does not match the map.
    Unknown {
        /// Keypoints matched to the map.
        matches: u32,
        /// Minimum number for a pose.
        needed: u32,
    },
    /// The image repeats the previous one.
    Repeated,
    /// Matches do not agree on one pose.
    Contradiction {
        /// Matches that agree.
        agreed: u32,
        /// Matches.
        matches: u32,
        /// Minimum number of agreeing matches for a pose.
        needed: u32,
    },
}

impl LossCause {
    /// Suggested action.
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

    fn is_about_places(&self) -> bool {
        matches!(self, Self::Unknown { .. } | Self::Contradiction { .. })
    }
}

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

/// One line, e.g. `lost for 1.2 s: the image is black or covered (3 keypoints; 30 needed); uncover the lens or make
/// light, and show it a place that it has seen`.
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

/// Image statistics from every eighth pixel of every eighth row.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub(super) struct Look {
    mean: f64,
    /// Standard deviation of the grey levels.
    contrast: f64,
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

pub(super) struct Clues<'a> {
    pub(super) reason: LostReason,
    pub(super) counts: &'a FrameCounts,
    pub(super) look: Look,
    /// Share of the keypoints on moving objects.
    pub(super) moving: f64,
    /// Minimum number of keypoints (with depth, to start a map) for a pose.
    pub(super) needed: u32,
}

/// Most likely cause of the loss. Properties of the image take precedence over the failed tracking step.
pub(super) fn cause(clues: &Clues<'_>) -> LossCause {
    let Clues {
        reason,
        counts,
        look,
        moving,
        needed,
    } = *clues;
    let keypoints = counts.keypoints;
    let is_flat = look.contrast < 0.5 * BLACK;
    if is_flat && look.mean < BLACK {
        return LossCause::Dark { keypoints, needed };
    }
    if is_flat && look.mean > 255.0 - BLACK {
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
