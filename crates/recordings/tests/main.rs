//! Tests of the public interface.
#![allow(missing_docs, clippy::unwrap_used)]

mod cameras;
mod clocks;
mod damage;
mod edited;
mod encodings;
mod files;
mod hostile;
mod inertial;
mod lies;
mod mutations;
mod odometry;
mod orbbec;
mod registration;
#[cfg(feature = "sqlite")]
mod sqlite;
mod structured;
mod writers;
