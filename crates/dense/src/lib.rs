//! The static scene without people: surface, mesh and grids.
//!
//! A subscriber ([`Dense`]) receives the events of a run and follows its corrections; it does not influence the run. It opens no files and
//! starts no threads: output goes to a writer of the caller, and a program with a live camera runs it on a separate thread.

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
