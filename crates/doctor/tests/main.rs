//! Tests of the public interface: one binary.

mod common;
mod recorded;
mod simulated;
