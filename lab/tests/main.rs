//! Tests of the program `lab`, all in one binary.
#![allow(clippy::unwrap_used)]

mod experiments;
