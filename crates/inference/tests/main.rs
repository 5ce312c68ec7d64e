//! Networks read, checked, run and cached: tests from outside the crate.

// Tests may search for data and libraries; the crate may not.
#![allow(clippy::disallowed_methods, clippy::print_stderr, clippy::unwrap_used)]

mod cache;
mod cards;
mod common;
mod detector;
mod detr;
mod golden;
mod graphs;
mod install;
#[cfg(feature = "onnxruntime")]
mod runtimes;
