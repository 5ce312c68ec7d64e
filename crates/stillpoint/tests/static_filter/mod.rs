//! The static filter in the whole system: rooms with people in them, and real recordings.

#![allow(clippy::print_stdout)] // `--nocapture` shows what was measured beside each bound.

mod beginnings;
mod determinism;
mod late;
mod rates;
mod real;
mod scenes;
mod starvation;
mod world;
