//! Features, matches and flow, on synthetic and recorded images.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod common;
mod extraction;
mod flow;
mod flow_truth;
mod matching;
mod real;
