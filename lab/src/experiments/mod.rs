//! Experiments: one module per question, each with its arguments and a function `run`. What an experiment prints is its result.

pub(crate) mod readout;
