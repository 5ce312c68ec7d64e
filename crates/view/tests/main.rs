//! Pictures and animations.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod animation;
mod overlay;
