//! What happens when things break, on simulated recordings: no panic, nothing hangs, no map is lost, and events say what was wrong.
//! The table of all cases is in docs/robustness.md.

#![allow(clippy::print_stdout)] // `--nocapture` shows what was measured beside each bound.

mod corrupt;
mod detector;
mod files;
mod images;
mod people;
mod place;
mod stream;
mod world;
