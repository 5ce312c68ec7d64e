//! Archives that are pulled from a server on loopback.

#![allow(clippy::unwrap_used)] // Helpers of tests are not recognised as tests.

mod broken;
mod hostile;
mod packed;
mod pulled;
