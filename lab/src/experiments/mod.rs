//! Experiments: one module per question, with arguments and a function `run`, which prints the result.

pub(crate) mod allocations;
pub(crate) mod closing;
pub(crate) mod covariance;
pub(crate) mod crowds;
pub(crate) mod dense;
pub(crate) mod detectors;
pub(crate) mod difficulty;
pub(crate) mod epipolar;
pub(crate) mod frame_time;
pub(crate) mod kernels;
pub(crate) mod loops;
pub(crate) mod objects;
pub(crate) mod place;
pub(crate) mod readout;
pub(crate) mod scale;
pub(crate) mod sensors;
mod shared;
pub(crate) mod soak;
pub(crate) mod things;
