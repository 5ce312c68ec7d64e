//! Rotations, rigid motions, cameras and alignment.

#![allow(clippy::unwrap_used)] // Clippy does not recognise test helpers as tests.

mod laws;
mod lens;
