//! Tests of this crate, one module per topic.

mod camera;
