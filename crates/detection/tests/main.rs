//! Detectors and objects through the public interface.

#![allow(clippy::unwrap_used)] // Clippy does not recognise test helpers as tests.

mod objects;
mod scripted;
mod weights;
