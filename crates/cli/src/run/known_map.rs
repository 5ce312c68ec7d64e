//! The map file that a run starts from.

use crate::console;
use crate::failure::Failure;
use crate::map::{file, kept, readout};
use std::path::Path;
use stillpoint::dense::{DenseMap, ThingMap};
use stillpoint::geometry::Camera;
use stillpoint::map::Map;
use stillpoint::slam::{Config, MapUse, StartError, Up};

#[derive(Clone, Copy)]
pub(crate) struct KnownMap<'a> {
    pub(crate) path: &'a Path,
    pub(crate) map_use: MapUse,
}

/// A map loaded before the first frame.
pub(crate) struct Known {
    pub(crate) map: Map,
    pub(crate) map_use: MapUse,
    pub(crate) dense: Option<DenseMap>,
    pub(crate) things: Option<ThingMap>,
    pub(crate) up: Option<Up>,
}

impl<'a> KnownMap<'a> {
    pub(crate) fn of(load_map: Option<&'a Path>, localize: Option<&'a Path>) -> Option<Self> {
        let (path, map_use) = match (load_map, localize) {
            (Some(path), _) => (path, MapUse::Grow),
            (None, Some(path)) => (path, MapUse::Localize),
            (None, None) => return None,
        };
        Some(Self { path, map_use })
    }

    /// Reads the map, and sets the camera parameters that it stores. `ids` is the number of keyframe ids that the run may add, if the map
    /// is to be saved.
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
