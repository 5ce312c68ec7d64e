//! The extensions of a map file: surface and objects.

use crate::failure::Failure;
use crate::map::file::Loaded;
use std::path::Path;
use stillpoint::dense::{DenseMap, ThingMap};
use stillpoint::imaging::Simd;

pub(crate) fn surface(loaded: &Loaded, path: &Path) -> Result<Option<DenseMap>, Failure> {
    let bytes = loaded.file.extension(DenseMap::EXTENSION);
    let map = bytes.map(|b| DenseMap::from_bytes(b, Simd::detect()));
    map.transpose()
        .map_err(|e| Failure::input(format!("{}: {e}", path.display())))
}

pub(crate) fn things(loaded: &Loaded, path: &Path) -> Result<Option<ThingMap>, Failure> {
    let bytes = loaded.file.extension(ThingMap::EXTENSION);
    let map = bytes.map(ThingMap::from_bytes);
    map.transpose()
        .map_err(|e| Failure::input(format!("{}: {e}", path.display())))
}
