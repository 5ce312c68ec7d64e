//! Stages on synthetic maps.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod closing;
mod dynamic_mask;
mod outlines;
mod repeated_patterns;
