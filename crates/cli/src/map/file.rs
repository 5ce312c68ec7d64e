//! Map files on disk: validated when read, written atomically.

use crate::failure::Failure;
use crate::output::StreamedFile;
use serde::{Deserialize, Serialize};
use std::io::{Read, Write};
use std::path::Path;
use stillpoint::datasets::open_regular;
use stillpoint::geometry::{Camera, Vec2};
use stillpoint::map::{Extension, Map, MapFile};
use stillpoint::slam::{Config, Timing, Up};

/// Maximum size of a map file, bytes: that of a map of 100 000 keyframes. It is read into memory as a whole.
const LARGEST: u64 = 8 << 30;

/// Maximum distance between the projections of a direction by two cameras, px: recalibrating a camera changes less, another camera differs
/// by more.
const CAMERA_TOLERANCE: f64 = 5.0;

/// Maximum number of keyframe ids in a map file, one for each frame that went into it.
const MOST_IDS: usize = 1 << 24;

pub(crate) struct Loaded {
    pub(crate) file: MapFile,
    pub(crate) bytes: u64,
}

pub(crate) enum Refusal {
    System(Failure),
    /// The contents are not a valid map.
    Content(String),
}

impl From<Refusal> for Failure {
    fn from(refusal: Refusal) -> Self {
        match refusal {
            Refusal::System(failure) => failure,
            Refusal::Content(message) => Self::input(message),
        }
    }
}

pub(crate) fn load(path: &Path) -> Result<Loaded, Failure> {
    examine(path).map_err(Failure::from)
}

/// Reads a map file; distinguishes unreadable files from invalid ones.
pub(crate) fn examine(path: &Path) -> Result<Loaded, Refusal> {
    let system = |e: std::io::Error| {
        Refusal::System(Failure::input(format!(
            "{}: expected to read a map file, found: {e}; check that it exists and may be read",
            path.display()
        )))
    };
    let content = |e: &dyn std::fmt::Display| Refusal::Content(format!("{}: {e}", path.display()));
    let mut file = open_regular(path).map_err(system)?;
    let mut bytes = Vec::new();
    let mut read = |bytes: &mut Vec<u8>, most: u64| {
        let read = (&mut file).take(most).read_to_end(bytes);
        read.map_err(system)
    };
    // Reads the header first, so that other files, and devices without an end, are not read any further.
    read(&mut bytes, MapFile::HEADER_BYTES as u64)?;
    let length = MapFile::length(&bytes).map_err(|e| content(&e))?;
    if length > LARGEST {
        return Err(content(&format!(
            "expected a map file of at most {LARGEST} bytes, found one of {length}; this program reads maps as a whole"
        )));
    }
    // One byte more, to detect excess data.
    let rest = (length + 1).saturating_sub(bytes.len() as u64);
    read(&mut bytes, rest)?;
    Ok(Loaded {
        file: MapFile::from_bytes(&bytes).map_err(|e| content(&e))?,
        bytes: bytes.len() as u64,
    })
}

impl Loaded {
    /// Readout of the map's camera and its standard deviation, s, if known.
    pub(crate) fn readout(&self) -> Option<[f64; 2]> {
        Timing::readout_in(self.file.extension(Timing::EXTENSION)?)
    }

    /// The up direction, if known.
    pub(crate) fn up(&self) -> Option<Up> {
        Up::from_bytes(self.file.extension(Up::EXTENSION)?)
    }
}

/// Checks that a system with this configuration and camera can resume or localise in a map.
///
/// # Errors
/// Features of another pyramid, or images of another camera.
pub(crate) fn check_fits(
    path: &Path,
    map: &Map,
    config: &Config,
    camera: &Camera,
) -> Result<(), Failure> {
    let features = config.features.orb();
    let (levels, factor) = (features.levels, features.scale_factor);
    let scales = map.level_scales();
    if scales != Map::new(levels, factor).level_scales() {
        let found = scales.get(1).copied().unwrap_or(1.0);
        return Err(Failure::input(format!(
            "{}: expected a map of features on {levels} levels with a factor of {factor}, found {} levels with a factor of {found}; make the map again",
            path.display(),
            scales.len(),
        )));
    }
    match misfit(&[camera], &cameras(map)) {
        None => Ok(()),
        Some(misfit) => Err(Failure::input(format!(
            "{}: expected a map from this camera {misfit}; name the camera of the map with --camera, or make the map again",
            path.display()
        ))),
    }
}

/// Checks that two maps are of one camera, so that they can be merged.
///
/// # Errors
/// Different cameras or features.
pub(crate) fn check_alike([first, second]: [&Path; 2], [a, b]: [&Map; 2]) -> Result<(), Failure> {
    match misfit(&cameras(a), &cameras(b)) {
        None => Ok(()),
        Some(misfit) => Err(Failure::input(format!(
            "{}: expected a map from the camera of {} {misfit}; only maps of one camera can be one map",
            second.display(),
            first.display()
        ))),
    }
}

/// The distinct cameras of a map; usually one.
fn cameras(map: &Map) -> Vec<&Camera> {
    let mut cameras: Vec<&Camera> = Vec::new();
    for k in map.view().keyframes() {
        if !cameras.contains(&&k.data.camera) {
            cameras.push(&k.data.camera);
        }
    }
    cameras
}

/// Describes the difference if one of `others` matches none of `expected`.
fn misfit(expected: &[&Camera], others: &[&Camera]) -> Option<String> {
    let pairs = expected
        .iter()
        .flat_map(|a| others.iter().map(move |b| (a, b)));
    pairs.into_iter().find_map(|(a, b)| {
        let distance = distance(a, b);
        let found = match distance {
            Some(d) if d <= CAMERA_TOLERANCE => return None,
            Some(d) => format!("one in which points are up to {d:.1} px elsewhere"),
            None => format!("images of {}x{} px", b.width, b.height),
        };
        Some(format!(
            "({}x{} px, fx {:.1}), found {found} (fx {:.1})",
            a.width, a.height, a.fx, b.fx
        ))
    })
}

/// Checks that a map can still be saved after `more` frames, each of which may take a keyframe id.
///
/// # Errors
/// Too many ids.
pub(crate) fn check_room(path: &Path, map: &Map, more: usize) -> Result<(), Failure> {
    let used = map.view().keyframe_bound();
    if used.saturating_add(more) <= MOST_IDS {
        return Ok(());
    }
    Err(Failure::input(format!(
        "{}: expected a map with room for {more} more keyframe ids, of which a map file has {MOST_IDS}, found {used} in use; begin a new map, or go on without saving this one",
        path.display()
    )))
}

/// Maximum distance between the projections of the same direction by two cameras, px; `None` when their image sizes differ.
fn distance(a: &Camera, b: &Camera) -> Option<f64> {
    if (a.width, a.height) != (b.width, b.height) {
        return None;
    }
    let mut most: f64 = 0.0;
    for i in 0..=8 {
        for j in 0..=8 {
            let share = |i: i32, side: u32| f64::from(side - 1) * f64::from(i) / 8.0;
            let raw = Vec2::new(share(i, a.width), share(j, a.height));
            let ray = |c: &Camera| c.ray(c.undistort(raw));
            most = most.max((ray(a) - ray(b)).norm() * a.fx.max(a.fy));
        }
    }
    Some(most)
}

#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
pub(crate) struct SavedMap {
    pub(crate) path: String,
    pub(crate) bytes: u64,
    pub(crate) keyframes: usize,
    pub(crate) landmarks: usize,
}

/// A map file before it is committed.
pub(crate) struct MapOutput {
    file: StreamedFile,
    path: String,
}

impl MapOutput {
    /// Starts the file before the run, so that an unwritable path is reported early. An existing file stays unchanged until then. `option`
    /// named it.
    pub(crate) fn create(path: &Path, option: &'static str) -> Result<Self, Failure> {
        Ok(Self {
            file: StreamedFile::create(path, option)?,
            path: path.display().to_string(),
        })
    }

    /// Writes the map with the estimated camera timing and the given extensions, and moves it into place.
    pub(crate) fn save(
        mut self,
        map: &Map,
        timing: Option<&Timing>,
        more: Vec<Extension>,
    ) -> Result<SavedMap, Failure> {
        let view = map.view();
        if view.keyframe_count() == 0 {
            return Err(Failure::criteria(format!(
                "{}: expected a map to save, found no keyframe; what was there is untouched",
                self.path
            )));
        }
        let extensions: Vec<Extension> = timing
            .into_iter()
            .map(Timing::to_extension)
            .chain(more)
            .collect();
        let bytes = map
            .to_bytes(&extensions)
            .map_err(|e| Failure::criteria(format!("{}: {e}", self.path)))?;
        self.file.write(|w| w.write_all(&bytes))?;
        self.file.finish()?;
        Ok(SavedMap {
            path: self.path,
            bytes: bytes.len() as u64,
            keyframes: view.keyframe_count(),
            landmarks: view.landmark_count(),
        })
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use std::sync::Arc;
    use stillpoint::features::FeatureGrid;
    use stillpoint::geometry::Se3;
    use stillpoint::map::{KeyframeData, KeyframeId};

    fn camera() -> Camera {
        Camera::pinhole(640, 480, [525.0, 525.0, 319.5, 239.5])
    }

    fn map() -> Map {
        map_of(camera())
    }

    fn map_of(camera: Camera) -> Map {
        let data = KeyframeData {
            stamp: 1.0,
            camera,
            keypoints: Vec::new(),
            positions: Vec::new(),
            sigma_px: Vec::new(),
            depths: Vec::new(),
            depth_sigmas: Vec::new(),
            descriptors: Arc::default(),
            mappable: Vec::new(),
            grid: FeatureGrid::build(&[], &[], KeyframeData::grid_bounds(&camera)),
        };
        let features = Config::default().features.orb();
        let mut map = Map::new(features.levels, features.scale_factor);
        map.insert_keyframe(KeyframeId(0), Arc::new(data), Se3::identity(), None);
        map
    }

    fn fits(change: impl FnOnce(&mut Config, &mut Camera)) -> Result<(), String> {
        let (mut config, mut camera) = (Config::default(), camera());
        change(&mut config, &mut camera);
        let path = Path::new("desk.spmap");
        check_fits(path, &map(), &config, &camera).map_err(|e| e.to_string())
    }

    #[test]
    fn map_requires_matching_camera_and_features() {
        assert_eq!(fits(|_, _| {}), Ok(()));
        // As after another calibration.
        assert_eq!(fits(|_, c| c.fx += 3.0), Ok(()));
        let refuse = |change: fn(&mut Config, &mut Camera), words: &[&str]| {
            let e = fits(change).unwrap_err();
            for word in ["desk.spmap", "expected", "found"].iter().chain(words) {
                assert!(e.contains(word), "{word:?} is not in {e}");
            }
        };
        for (levels, factor) in [(8, 1.2), (5, 1.5)] {
            let (path, map) = (Path::new("desk.spmap"), Map::new(levels, factor));
            let e = check_fits(path, &map, &Config::default(), &camera()).unwrap_err();
            let found = format!("found {levels} levels with a factor of {factor}; make");
            assert!(e.to_string().contains(&found), "{e}");
        }
        refuse(|_, c| c.width = 320, &["640x480", "--camera"]);
        refuse(|_, c| c.fx = 480.0, &["px elsewhere", "--camera"]);
        refuse(|_, c| c.distortion.k1 = 0.3, &["px elsewhere"]);
    }

    #[test]
    fn merging_needs_maps_of_one_camera() {
        let paths = [Path::new("a.spmap"), Path::new("b.spmap")];
        let alike = |c: Camera| check_alike(paths, [&map(), &map_of(c)]).map_err(|e| e.to_string());
        let camera = camera();
        assert_eq!(alike(camera), Ok(()));
        let fx = camera.fx + 3.0;
        assert_eq!(alike(Camera { fx, ..camera }), Ok(()));
        let e = alike(Camera {
            fx: 480.0,
            ..camera
        })
        .unwrap_err();
        for word in [
            "b.spmap: expected",
            "camera of a.spmap",
            "fx 525.0",
            "px elsewhere",
            "fx 480.0",
        ] {
            assert!(e.contains(word), "{word:?} is not in {e}");
        }
        let width = 320;
        let e = alike(Camera { width, ..camera }).unwrap_err();
        assert!(e.contains("images of 320x480 px"), "{e}");
    }

    #[test]
    fn map_without_free_ids_is_refused() {
        let path = Path::new("desk.spmap");
        assert!(check_room(path, &map(), MOST_IDS - 1).is_ok());
        let e = check_room(path, &map(), MOST_IDS).unwrap_err().to_string();
        assert!(
            e.contains("desk.spmap: expected") && e.contains("found 1 in use"),
            "{e}"
        );
    }

    #[test]
    fn empty_map_does_not_replace_a_saved_one() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("desk.spmap");
        let timing = Timing {
            readout: 0.02,
            readout_sigma: 0.0005,
            depth_delay: 0.0,
        };
        let saved = MapOutput::create(&path, "--save-map")
            .unwrap()
            .save(&map(), Some(&timing), Vec::new())
            .unwrap();
        assert_eq!((saved.keyframes, saved.landmarks), (1, 0));
        assert_eq!(saved.bytes, path.metadata().unwrap().len());
        let e = MapOutput::create(&path, "--save-map").unwrap().save(
            &Map::new(5, 1.45),
            None,
            Vec::new(),
        );
        assert!(e.unwrap_err().to_string().contains("no keyframe"));
        let loaded = load(&path).ok().unwrap();
        assert_eq!(loaded.bytes, saved.bytes);
        assert_eq!(loaded.readout(), Some([0.02, 0.0005]));
    }
}
