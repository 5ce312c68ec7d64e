//! Archives downloaded from a loopback server.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod broken;
mod hostile;
mod packed;
mod pulled;
