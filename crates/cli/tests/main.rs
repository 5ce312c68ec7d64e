//! Tests of the command line program.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod ablation;
mod accuracy;
mod bad_arguments;
mod bad_input;
mod bad_output;
mod batch;
mod batch_bad;
mod clocks;
mod common;
mod config_docs;
mod datasets_pull;
mod demo;
mod dense;
mod detect;
mod doctor;
mod dynamic;
mod end_to_end;
mod golden;
mod live;
mod live_page;
mod malicious_models;
mod map;
mod map_dense;
mod map_kill;
mod map_use;
mod masks;
mod models;
mod models_pull;
mod objects;
mod packaging;
mod readme;
mod record;
mod recordings;
mod render;
mod report;
mod report_looks;
mod suite;
mod things;
mod variants;
