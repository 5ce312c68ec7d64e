//! The room without the people: surface, mesh and grids, fused from what does not move.
//!
//! Answers: where surfaces are, where space is free, and what a robot may drive by. A subscriber ([`Dense`]) takes the events of a run and
//! follows its corrections; nothing goes back. It opens no files and starts no threads: it writes to a writer that the caller passes, and
//! a program with a live camera runs it on a thread of its own.

mod arrivals;
#[cfg(target_arch = "x86_64")]
mod avx2;
mod block;
mod bytes;
mod cells;
mod config;
mod course;
mod dense;
mod flat;
mod floor;
mod fuser;
mod kept;
mod merge;
mod mesh;
mod moving;
#[cfg(target_arch = "aarch64")]
mod neon;
mod observation;
mod octomap;
mod pixels;
mod plan;
mod poses;
mod rooms;
mod things;
mod touch;
mod volume;
mod voxels;
mod window;
mod world;

pub use bytes::DenseBytesError;
pub use config::{DenseConfig, DenseConfigError};
pub use dense::{Dense, DenseCounts};
pub use flat::FlatPlan;
pub use floor::Floor;
pub use fuser::Fuser;
pub use merge::DenseMergeError;
pub use mesh::{Mesh, MeshOptions};
pub use plan::{Plan, PlanOptions};
pub use poses::FinalPose;
pub use rooms::{Ground, rooms};
pub use things::{Room, Thing, ThingBytesError, ThingMap, Things, ThingsConfig, UprightBox};
pub use world::{DenseMap, Occupancy};
