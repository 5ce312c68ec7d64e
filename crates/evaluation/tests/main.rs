//! Figures and plots of trajectories, and figures of tracks.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod golden;
mod laws;
mod objects;
mod plots;
