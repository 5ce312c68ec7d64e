//! Figures and plots of trajectories.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod golden;
mod laws;
mod plots;
