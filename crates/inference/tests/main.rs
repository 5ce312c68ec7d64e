//! Networks read, checked, run and kept: the tests of the crate from outside.

// A test may look for its data and its library; the crate may not.
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
