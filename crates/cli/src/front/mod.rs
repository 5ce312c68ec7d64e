//! What front ends in other languages take over from the command line, so that the same words mean the same there.
//!
//! Answers: which configuration, detector or map a user's words name, which poses make a trajectory, and what a result folder holds. Says nothing on the terminal.

mod result;

use crate::args::ConfigArgs;
use crate::args::models::DetectorArgs;
use crate::config;
use crate::console;
use crate::detector;
use crate::failure::Failure;
use crate::map::file::{self, MapOutput};
use crate::map::{kept, readout};
use crate::run::submaps::by_submap;
use std::path::Path;
use stillpoint::datasets::StampedPose;
use stillpoint::dense::DenseMap;
use stillpoint::detection::Detector;
use stillpoint::geometry::Camera;
use stillpoint::imaging::{Simd, Workers};
use stillpoint::map::{Extension, Map, MapView};
use stillpoint::slam::{Config, Timing, Trajectory, TrajectoryEntry};

pub use result::{Driven, ResultRecorder};

/// What a user asked for cannot be had: what was expected, what was found, where, and what to do.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Refused(String);

impl std::fmt::Display for Refused {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        f.write_str(&self.0)
    }
}

impl std::error::Error for Refused {}

impl From<Failure> for Refused {
    fn from(failure: Failure) -> Self {
        Self(failure.to_string())
    }
}

/// From now on nothing but errors is said on the terminal; [`crate::run`] says again what its arguments ask for.
pub fn keep_quiet() {
    console::set_verbosity(true, 0);
}

/// The configuration of a file (TOML), if one is named, with values as `--set` takes them laid over it; checked.
///
/// # Errors
/// [`Refused`] for a file that cannot be read, for unknown keys, and for values out of range.
pub fn config(file: Option<&Path>, set: &[String]) -> Result<Config, Refused> {
    let args = ConfigArgs {
        config: file.map(Path::to_owned),
        set: set.to_owned(),
        seed: None,
    };
    Ok(config::resolve(&args)?)
}

/// A configuration as commented TOML, as `config print` shows it.
///
/// # Errors
/// [`Refused`] where TOML cannot express it.
pub fn config_text(config: &Config) -> Result<String, Refused> {
    Ok(config::to_text(config)?)
}

/// The instruction set that the environment asks for, as in the command line.
///
/// # Errors
/// [`Refused`] for a value of `STILLPOINT_SIMD` that is none.
pub fn simd() -> Result<Simd, Refused> {
    Ok(config::simd()?)
}

/// Threads that share the work on a frame: as the environment says, else as many as there are cores to spare.
///
/// # Errors
/// [`Refused`] for a value of `STILLPOINT_WORKERS` that is none, and where the system has no more threads.
pub fn workers(live: bool) -> Result<Workers, Refused> {
    Ok(config::workers(live)?)
}

/// What `--detector` names, and whether it looks at colours. `auto` is what the command line takes when nothing is named: a model of the
/// cache if there is one.
///
/// # Errors
/// [`Refused`] for names of no detector and for models that cannot be used.
pub fn detector(argument: &str) -> Result<(Option<Box<dyn Detector>>, bool), Refused> {
    let args = DetectorArgs {
        detector: (argument != "auto").then(|| argument.to_owned()),
        detector_threads: 1,
        ..DetectorArgs::default()
    };
    let settled = detector::settle(&args)?;
    let loaded = detector::load_untried(&settled, &args)?;
    Ok((loaded.detector, settled.needs_colour()))
}

/// The digest of a recording, by which a batch knows it, and its bytes.
///
/// # Errors
/// A folder or file that cannot be read.
pub fn input_digest(path: &Path) -> std::io::Result<(String, u64)> {
    let digest = crate::batch::digest::of_input(path)?;
    Ok((digest.sha256, digest.bytes))
}

/// Reads a map file that a run with this camera begins with, and tells the configuration what it knows of the camera. With it comes the
/// surface that was kept with it, if there is one.
///
/// # Errors
/// [`Refused`] for files that are no map, and for maps of other features or of another camera.
pub fn load_map(
    path: &Path,
    config: &mut Config,
    camera: &Camera,
) -> Result<(Map, Option<DenseMap>), Refused> {
    let loaded = file::load(path)?;
    let dense = kept::surface(&loaded, path)?;
    readout::start_with(config, loaded.readout());
    let map = loaded.file.map;
    file::check_fits(path, &map, config, camera)?;
    Ok((map, dense))
}

/// Writes a map file, as a whole or not at all, with what is known of the camera's timing, and with the surface if there is one.
///
/// # Errors
/// [`Refused`] for a map without keyframes, and when it cannot be written.
pub fn save_map(
    path: &Path,
    map: &Map,
    timing: Option<&Timing>,
    dense: Option<&DenseMap>,
) -> Result<(), Refused> {
    let extension = dense.map(|d| Extension {
        name: DenseMap::EXTENSION.to_owned(),
        bytes: d.to_bytes(),
    });
    MapOutput::create(path, "the path")?.save(map, timing, extension.into_iter().collect())?;
    Ok(())
}

/// The frames of `trajectory.txt` with their final poses: those of the submap with most frames.
#[must_use]
pub fn final_poses(trajectory: &Trajectory, view: &MapView) -> Vec<(TrajectoryEntry, StampedPose)> {
    let first = by_submap(trajectory, view).into_iter().next();
    first.map(|(_, poses)| poses).unwrap_or_default()
}
