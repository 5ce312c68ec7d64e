//! Pictures and animations.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod animation;
mod overlay;
