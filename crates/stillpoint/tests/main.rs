//! The whole system, and the workspace that it is made of.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod accuracy;
mod allocations;
mod breakage;
mod counting;
mod covariance;
mod dependencies;
mod documents;
mod front_ends;
mod inertial;
mod layout;
mod looping;
mod modules;
mod odometry;
mod packaging;
mod relocalisation;
mod rendered;
mod static_filter;
