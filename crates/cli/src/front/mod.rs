//! Functions of the command line for front ends in other languages, so that arguments mean the same there.
//!
//! Resolves configuration, detector and map arguments, selects the poses of a trajectory, and writes result folders. Prints nothing.

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

/// A request that cannot be met: expectation, finding, location and remedy.
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

/// Limits terminal output to errors; [`crate::run`] sets it again from its arguments.
pub fn keep_quiet() {
    console::set_verbosity(true, 0);
}

/// The configuration of a TOML file, if given, overridden by values in the form of `--set`; validated.
///
/// # Errors
/// [`Refused`] for an unreadable file, unknown keys, and values out of range.
pub fn config(file: Option<&Path>, set: &[String]) -> Result<Config, Refused> {
    let args = ConfigArgs {
        config: file.map(Path::to_owned),
        set: set.to_owned(),
        seed: None,
    };
    Ok(config::resolve(&args)?)
}

/// A configuration as commented TOML, as by `config print`.
///
/// # Errors
/// [`Refused`] where TOML cannot express it.
pub fn config_text(config: &Config) -> Result<String, Refused> {
    Ok(config::to_text(config)?)
}

/// The instruction set, from the environment or detected.
///
/// # Errors
/// [`Refused`] for an invalid value of `STILLPOINT_SIMD`.
pub fn simd() -> Result<Simd, Refused> {
    Ok(config::simd()?)
}

/// Worker threads per frame, from the environment or as many as there are spare cores.
///
/// # Errors
/// [`Refused`] for an invalid value of `STILLPOINT_WORKERS`, and if the threads cannot be started.
pub fn workers(live: bool) -> Result<Workers, Refused> {
    Ok(config::workers(live)?)
}

/// The detector for a `--detector` argument, and whether it needs colour. `auto` is the command line's default: a model of the cache if
/// there is one.
///
/// # Errors
/// [`Refused`] for unknown detectors and unusable models.
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

/// The digest by which a batch identifies a recording, and its size in bytes.
///
/// # Errors
/// A folder or file that cannot be read.
pub fn input_digest(path: &Path) -> std::io::Result<(String, u64)> {
    let digest = crate::batch::digest::of_input(path)?;
    Ok((digest.sha256, digest.bytes))
}

/// Reads a map file to start a run of this camera from, with its dense map if there is one, and sets the camera parameters that the map
/// knows in `config`.
///
/// # Errors
/// [`Refused`] for invalid files, and for maps of other features or of another camera.
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

/// Writes a map file atomically, with the estimated camera timing and the dense map, if given.
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
