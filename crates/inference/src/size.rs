//! Input sizes of a network, and their choice for an image.

use serde::{Deserialize, Serialize};

/// Width and height of a network's input, px.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Size {
    pub(super) width: usize,
    pub(super) height: usize,
}

impl std::fmt::Display for Size {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        write!(f, "{}x{}", self.width, self.height)
    }
}

/// Selects the input size of a network.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum InputSize {
    /// The model's own.
    Model,
    /// The model's longer side, and the other side by the image's aspect: padding a 4:3 image to a square costs a quarter of the work. The
    /// model's own size if its graph allows no other.
    #[default]
    Fit,
    /// This one, px. Sides are multiples of the head's coarsest stride (32 for most); a graph that allows only its own size is refused.
    Fixed {
        /// Width, px.
        width: usize,
        /// Height, px.
        height: usize,
    },
}

/// The input for an image of `width` x `height`: its longer side as the model's, the other one by the aspect, rounded up to a multiple of
/// `alignment`.
pub(super) fn fitted(own: Size, width: usize, height: usize, alignment: usize) -> Size {
    let longest = own.width.max(own.height);
    let shorter = |short: usize, long: usize| {
        (short * longest)
            .div_ceil(long.max(1))
            .next_multiple_of(alignment)
            .min(longest)
    };
    if width >= height {
        Size {
            width: longest,
            height: shorter(height, width),
        }
    } else {
        Size {
            width: shorter(width, height),
            height: longest,
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn shorter_input_side_follows_the_image_aspect() {
        let own = Size {
            width: 416,
            height: 416,
        };
        for ((width, height), expected) in [
            ((640, 480), (416, 320)),
            ((480, 640), (320, 416)),
            ((1920, 1080), (416, 256)),
            ((500, 500), (416, 416)),
            ((1, 1), (416, 416)),
            ((2000, 1), (416, 32)),
            ((1, 2000), (32, 416)),
        ] {
            let found = fitted(own, width, height, 32);
            assert_eq!((found.width, found.height), expected, "{width}x{height}");
        }
    }
}
