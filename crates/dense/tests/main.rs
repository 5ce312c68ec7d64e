//! Tests of the public interface.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod bytes;
mod corrected_things;
mod following;
mod merging;
mod people;
mod room;
mod things;
