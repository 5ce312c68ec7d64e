//! Tests of the whole system and of the workspace.

#![allow(clippy::unwrap_used)] // Clippy does not recognise test helpers as tests.

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
