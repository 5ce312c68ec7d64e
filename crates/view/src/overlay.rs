//! Data drawn over a frame. All coordinates are pixels of the raw image; the centre of the first pixel is (0, 0).

use crate::Colour;
use stillpoint_detection::BoundingBox;
use stillpoint_imaging::GrayImage;

/// State of a feature.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Mark {
    /// Static: a small disc.
    Static,
    /// Rejected, in the colour of the reason: a ring with a dot.
    Dynamic(Colour),
    /// Unused: a dot.
    Unused,
}

/// A feature: column, row, px, and state.
pub type Keypoint = (f32, f32, Mark);

/// A box with a label.
#[derive(Clone, Debug, PartialEq)]
pub struct OverlayBox {
    /// Position, px.
    pub bounds: BoundingBox,
    /// Label, such as `person 3 0.8 m/s`.
    pub label: String,
    /// Colour of the frame and of the label's background.
    pub colour: Colour,
    /// Predicted without a detection: dashed.
    pub coasting: bool,
    /// Unimportant: a thin pale frame, whatever its colour.
    pub quiet: bool,
}

/// Everything drawn over one frame.
#[derive(Clone, Copy, Debug, Default, PartialEq)]
pub struct Overlay<'a> {
    /// Features.
    pub keypoints: &'a [Keypoint],
    /// Objects.
    pub boxes: &'a [OverlayBox],
    /// Moving regions, which are tinted and outlined: a mask of the frame's size, above 127 where something moves.
    pub region: Option<&'a GrayImage>,
    /// One or two words on a coloured background before the caption: the state.
    pub badge: Option<(&'a str, Colour)>,
    /// A line under the image; empty for none.
    pub caption: &'a str,
    /// Whether a legend is added under the image.
    pub legend: bool,
}
