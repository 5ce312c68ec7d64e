//! Robustness on simulated recordings: no panics, no hangs, no lost maps, and events that report the problem. The table
//! of all cases is in docs/robustness.md.

#![allow(clippy::print_stdout)] // `--nocapture` shows the measurements.

mod corrupt;
mod detector;
mod files;
mod images;
mod people;
mod place;
mod stream;
mod world;
