//! The static filter in the whole system: simulated rooms with people, and real recordings.

#![allow(clippy::print_stdout)] // `--nocapture` shows the measurements.

mod beginnings;
mod determinism;
mod late;
mod rates;
mod real;
mod scenes;
mod starvation;
mod world;
