//! Keyframes, landmarks, covisibility, and immutable views of them.
