//! Errors of encoding and writing.

/// An image could not be encoded or written.
#[derive(Debug, thiserror::Error)]
pub enum ViewError {
    /// An image without pixels.
    #[error("expected a picture of at least 1 x 1 px, found {0} x {1}")]
    Empty(usize, usize),
    /// An image too large for an animation.
    #[error("expected frames of an animation of at most 65535 x 65535 px, found {0} x {1}")]
    Large(usize, usize),
    /// Frames of an animation differ in size.
    #[error(
        "expected all frames of an animation to have {} x {} px as the first, found {} x {}; give all of them a caption or none",
        expected.0, expected.1, found.0, found.1
    )]
    Size {
        /// Width and height of the first frame, px.
        expected: (usize, usize),
        /// Width and height of this one, px.
        found: (usize, usize),
    },
    /// An animation without frames was finished.
    #[error("expected an animation of at least one frame, found none")]
    NoFrames,
    /// The PNG encoder failed.
    #[error("expected to encode the picture as PNG, found: {0}")]
    Encode(#[from] png::EncodingError),
    /// The GIF encoder failed.
    #[error("expected to encode the animation as GIF, found: {0}")]
    Animate(#[from] gif::EncodingError),
    /// The WebP encoder failed.
    #[error("expected to encode the pictures as WebP, found: {0}")]
    Webp(String),
    /// Writing failed.
    #[error("expected to write the picture, found: {0}")]
    Write(#[from] std::io::Error),
}
