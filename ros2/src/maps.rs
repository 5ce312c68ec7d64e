//! Map files.

use crate::run::write;
use std::io::Read;
use std::path::Path;
use stillpoint::datasets::open_regular;
use stillpoint::geometry::Camera;
use stillpoint::map::{Map, MapFile};
use stillpoint::slam::{Config, SensorConfig, Timing};

/// Maximum size of a map file, which is read as a whole, bytes.
const LARGEST: u64 = 8 << 30;
/// Maximum difference of calibrations of one camera, as a share of the focal length: recalibrations differ by less.
const TOLERANCE: f64 = 0.02;

/// Minimum standard deviation of a loaded readout time, s.
const LEAST_SIGMA: f64 = 0.001;

/// Reads a map, and the readout time of its camera with its standard deviation, s.
///
/// # Errors
/// Unreadable files.
pub fn load(path: &Path) -> Result<(Map, Option<[f64; 2]>), String> {
    let refuse = |e: &dyn std::fmt::Display| format!("{}: {e}", path.display());
    let unread = |e: std::io::Error| {
        format!(
            "{}: expected to read a map file, found: {e}; check map_file",
            path.display()
        )
    };
    let mut file = open_regular(path).map_err(unread)?;
    let mut bytes = Vec::new();
    let begin = MapFile::HEADER_BYTES as u64;
    (&mut file)
        .take(begin)
        .read_to_end(&mut bytes)
        .map_err(unread)?;
    let length = MapFile::length(&bytes).map_err(|e| refuse(&e))?;
    if length > LARGEST {
        return Err(refuse(&format!(
            "expected a map file of at most {LARGEST} bytes, found one of {length}"
        )));
    }
    let rest = (length + 1).saturating_sub(bytes.len() as u64);
    (&mut file)
        .take(rest)
        .read_to_end(&mut bytes)
        .map_err(unread)?;
    let read = MapFile::from_bytes(&bytes).map_err(|e| refuse(&e))?;
    let readout = read
        .extension(Timing::EXTENSION)
        .and_then(Timing::readout_in);
    Ok((read.map, readout))
}

/// Initialises the readout time from a map, unless the configuration sets it; as in the command line, for replays.
pub fn start_with(config: &mut Config, known: Option<[f64; 2]>) {
    let (own, usual) = (&mut config.sensor, SensorConfig::default());
    let untouched = own.readout == usual.readout && own.readout_sigma == usual.readout_sigma;
    if let Some([readout, sigma]) = known.filter(|_| own.self_calibrate && untouched) {
        (own.readout, own.readout_sigma) = (readout, sigma.max(LEAST_SIGMA));
    }
}

/// Writes a map; returns a summary.
///
/// # Errors
/// A map without keyframes, or a failure of the system.
pub fn save(map: &Map, path: &Path) -> Result<String, String> {
    let view = map.view();
    if view.keyframe_count() == 0 {
        return Err(format!(
            "{}: expected a map to save, found no keyframe; what was there is untouched",
            path.display()
        ));
    }
    let bytes = map
        .to_bytes(&[])
        .map_err(|e| format!("{}: {e}", path.display()))?;
    write(path, &bytes)?;
    Ok(format!(
        "{} keyframes and {} landmarks in {}",
        view.keyframe_count(),
        view.landmark_count(),
        path.display()
    ))
}

/// Checks that a map is of this camera.
///
/// # Errors
/// It is of another one.
pub fn check_fits(map: &Map, camera: &Camera) -> Result<(), String> {
    for keyframe in map.view().keyframes() {
        let other = &keyframe.data.camera;
        let far = |a: f64, b: f64| (a - b).abs() > TOLERANCE * camera.fx;
        let differs = (other.width, other.height) != (camera.width, camera.height)
            || far(other.fx, camera.fx)
            || far(other.fy, camera.fy)
            || far(other.cx, camera.cx)
            || far(other.cy, camera.cy);
        if differs {
            return Err(format!(
                "expected a map from this camera ({}x{} px, fx {:.1}), found one from another ({}x{} px, fx {:.1}); make the map again",
                camera.width, camera.height, camera.fx, other.width, other.height, other.fx
            ));
        }
    }
    Ok(())
}
