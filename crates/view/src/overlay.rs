//! What is drawn over a frame, as plain data. All coordinates are pixels of the raw image; the centre of the first pixel is
//! (0, 0).

use crate::Colour;
use stillpoint_detection::BoundingBox;
use stillpoint_imaging::GrayImage;

/// What became of a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Taken for static: a small disc.
    Static,
    /// Rejected, in the colour of the reason: a ring with a dot.
    Dynamic(Colour),
    /// Not used: a dot.
    Unused,
}

/// A feature: column, row, px, and what became of it.
pub type Keypoint = (f32, f32, Mark);

/// A box with a label.
#[derive(Clone, Debug, PartialEq)]
pub struct OverlayBox {
    /// Where it is, px.
    pub bounds: BoundingBox,
    /// What is written over it, such as `person 3 0.8 m/s`.
    pub label: String,
    /// Colour of the frame and of the plate behind the label.
    pub colour: Colour,
    /// Not seen now, but propagated: the frame is dashed.
    pub coasting: bool,
    /// Nothing to look at: a thin pale frame, whatever its colour.
    pub quiet: bool,
}

/// Everything that is drawn over one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overlay<'a> {
    /// Features.
    pub keypoints: &'a [Keypoint],
    /// Objects.
    pub boxes: &'a [OverlayBox],
    /// Regions that move, which are tinted and outlined: a mask of the frame's size, above 127 where something moves.
    pub region: Option<&'a GrayImage>,
    /// One or two words on a plate of a colour, before the caption: whether all is well.
    pub badge: Option<(&'a str, Colour)>,
    /// The state, in a line under the image; empty for none.
    pub caption: &'a str,
    /// Whether lines under the image say what the marks mean.
    pub legend: bool,
}
