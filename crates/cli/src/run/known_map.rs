//! A map file that a run begins with.

use crate::console;
use crate::failure::Failure;
use crate::map::{file, kept, readout};
use std::path::Path;
use stillpoint::dense::{DenseMap, ThingMap};
use stillpoint::geometry::Camera;
use stillpoint::map::Map;
use stillpoint::slam::{Config, MapUse, StartError, Up};

/// A map file to begin with.
#[derive(Clone, Copy)]
pub(crate) struct KnownMap<'a> {
    pub(crate) path: &'a Path,
    pub(crate) map_use: MapUse,
}

/// A map that is there before the first frame.
pub(crate) struct Known {
    pub(crate) map: Map,
    pub(crate) map_use: MapUse,
    /// The surface that was kept with it.
    pub(crate) dense: Option<DenseMap>,
    /// The things that were kept with it.
    pub(crate) things: Option<ThingMap>,
    /// Which way is up in it, where that was known.
    pub(crate) up: Option<Up>,
}

impl<'a> KnownMap<'a> {
    /// As the arguments have it.
    pub(crate) fn of(load_map: Option<&'a Path>, localize: Option<&'a Path>) -> Option<Self> {
        let (path, map_use) = match (load_map, localize) {
            (Some(path), _) => (path, MapUse::Grow),
            (None, Some(path)) => (path, MapUse::Localize),
            (None, None) => return None,
        };
        Some(Self { path, map_use })
    }

    /// Reads it, and has the run begin with what it knows of the camera. `ids` is how many keyframe ids the run may add, if it is to be saved.
    pub(crate) fn load(
        &self,
        config: &mut Config,
        camera: &Camera,
        ids: Option<usize>,
    ) -> Result<Known, Failure> {
        let Self { path, map_use } = *self;
        let loaded = file::load(path)?;
        let dense = kept::surface(&loaded, path)?;
        let things = kept::things(&loaded, path)?;
        let up = loaded.up();
        readout::start_with(config, loaded.readout());
        let map = loaded.file.map;
        file::check_fits(path, &map, config, camera)?;
        if map_use == MapUse::Localize && map.view().keyframe_count() == 0 {
            return Err(Failure::input(format!(
                "{}: {}",
                path.display(),
                StartError::Empty
            )));
        }
        if let Some(ids) = ids {
            file::check_room(path, &map, ids)?;
        }
        console::info(&format!(
            "{} map {} with {} keyframes and {} landmarks",
            match map_use {
                MapUse::Grow => "resuming",
                MapUse::Localize => "finding the camera in",
            },
            path.display(),
            map.view().keyframe_count(),
            map.view().landmark_count()
        ));
        Ok(Known {
            map,
            map_use,
            dense,
            things,
            up,
        })
    }
}
