//! Solvers on synthetic data with known results.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod absolute_pose;
mod bundle_adjustment;
mod camera_motion;
mod jacobians;
mod pose;
mod pose_covariance;
mod pose_graph;
mod rigid;
mod sampling;
mod two_view;
mod votes;
