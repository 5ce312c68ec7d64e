//! Rooms, people and the camera that looks at them.

#![allow(clippy::unwrap_used)] // Clippy does not recognise helpers as tests.

mod detections;
mod equal_rooms;
mod geometry;
mod hard_crowds;
#[cfg(all(unix, feature = "kept"))]
mod kept;
mod people;
mod shutter;
mod simulator;
