//! Tests of the public interface.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod bytes;
mod corrected_things;
mod following;
mod merging;
mod people;
mod room;
mod things;
