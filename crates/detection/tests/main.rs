//! Detectors and objects, seen from outside.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod objects;
mod onnx;
mod onnx_cards;
#[cfg(feature = "onnx")]
mod onnx_common;
mod onnx_golden;
mod onnx_graphs;
mod runtimes;
mod scripted;
mod weights;
