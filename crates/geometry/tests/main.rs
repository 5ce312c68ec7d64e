//! Rotations, rigid motions, cameras and alignment.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod laws;
mod lens;
