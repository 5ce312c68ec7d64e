//! Detectors and objects, seen from outside.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod objects;
mod scripted;
mod weights;
