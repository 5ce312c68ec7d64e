//! Errors and plots of trajectories, and scores of tracks.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod golden;
mod laws;
mod objects;
mod plots;
