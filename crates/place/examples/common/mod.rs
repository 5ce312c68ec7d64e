//! What both programs share: recordings as keyframes, with the overlap of their views, and the training of vocabularies.
#![allow(dead_code)] // Each of the two programs uses a part.

pub(crate) mod train;
pub(crate) mod world;

/// Where real recordings are: in the folder that STILLPOINT_DATA names, else in `../shared/data` beside the workspace.
// A program may look for its data; the library may not.
#[allow(clippy::disallowed_methods)]
pub(crate) fn data_folder() -> std::path::PathBuf {
    std::env::var_os("STILLPOINT_DATA").map_or_else(
        || concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data").into(),
        Into::into,
    )
}
