//! Inputs of a bench: data set folders, recordings, and simulated scenes, which are written to temporary folders.

use crate::args::InputArgs;
use crate::bench::runner::program;
use crate::console;
use crate::demo::detector::errors_in_words;
use crate::detector::{self, Settled};
use crate::failure::Failure;
use std::path::{Path, PathBuf};
use std::process::Stdio;
use stillpoint::simulator::{Simulator, SimulatorConfig};

/// Prefix of simulated scenes among the paths.
const PREFIX: &str = "sim:";
/// Why a scene has no detector.
const NOBODY: &str = "nobody is in the scene";

#[derive(Clone, Debug, PartialEq, Eq)]
pub(crate) enum Source {
    Folder(PathBuf),
    Scene(String),
}

impl Source {
    /// Distinguishes scenes from paths; refuses invalid ones before anything runs.
    pub(crate) fn of(path: &Path) -> Result<Self, Failure> {
        let scene = path.to_str().and_then(|p| p.strip_prefix(PREFIX));
        match scene {
            // A folder whose name starts with the prefix can be given as `./name`.
            Some(scene) => {
                // Building the scene checks its name.
                let config = SimulatorConfig {
                    scene: scene.to_owned(),
                    frames: Some(1),
                    ..SimulatorConfig::default()
                };
                Simulator::new(&config).map_err(Failure::input)?;
                Ok(Self::Scene(scene.to_owned()))
            }
            None if path.is_dir() || path.is_file() => Ok(Self::Folder(path.to_owned())),
            None => {
                let found = if path.exists() { "neither" } else { "nothing" };
                Err(Failure::input(format!(
                    "{}: expected a data set folder, a recording or {PREFIX}SCENE, found {found}",
                    path.display()
                )))
            }
        }
    }

    /// Provides a folder that can be run. A scene is simulated with `seed`, below `out`. Unless `--detector` is given, its runs use the
    /// simulator's own detections, or none in a scene without people; never a model that happens to be in the cache.
    ///
    /// # Errors
    /// A simulation that could not be written.
    pub(crate) fn prepare(
        &self,
        input: &InputArgs,
        settled: &Settled,
        out: &Path,
        seed: u64,
    ) -> Result<Prepared, Failure> {
        let scene = match self {
            Self::Folder(path) => return Ok(Prepared::of(path.clone(), input, settled)),
            Self::Scene(scene) => scene,
        };
        let temporary = Temporary(out.join(format!(".simulated-{}", std::process::id())));
        let path = temporary.0.join(scene);
        let frames = input.max_frames.map(|n| n + input.start as u64);
        simulate(scene, &path, frames, seed)?;
        let script = path.join("detections.csv");
        let mut input = input.clone();
        // The simulated folder holds its camera file.
        input.camera = None;
        let mut prepared = if input.detector.detector.is_some() {
            Prepared::of(path, &input, settled)
        } else if script.is_file() {
            Prepared {
                blind: false,
                words: errors_in_words(),
                input: input.with_detector(format!("scripted:{}", script.display())),
                path,
                _temporary: None,
            }
        } else {
            // Without people there is no file of detections.
            Prepared::of(path, &input, &Settled::none(NOBODY))
        };
        prepared._temporary = Some(temporary);
        Ok(prepared)
    }
}

/// Chooses the detector once, so that all runs use the same. If all inputs are scenes and no detector is given, the model cache is not
/// read.
///
/// # Errors
/// An unknown detector, a cache that cannot be read.
pub(crate) fn settle(sources: &[Source], input: &InputArgs) -> Result<Settled, Failure> {
    let folders = sources.iter().any(|s| matches!(s, Source::Folder(_)));
    if !folders && input.detector.detector.is_none() {
        return Ok(Settled::none(NOBODY));
    }
    let settled = detector::settle(&input.detector)?;
    settled.announce();
    Ok(settled)
}

/// A folder that can be run, and the options of its runs.
#[derive(Debug)]
pub(crate) struct Prepared {
    pub(crate) path: PathBuf,
    pub(crate) input: InputArgs,
    pub(crate) blind: bool,
    pub(crate) words: String,
    /// The folder of a simulated scene, removed on drop.
    _temporary: Option<Temporary>,
}

impl Prepared {
    pub(crate) fn of(path: PathBuf, input: &InputArgs, settled: &Settled) -> Self {
        Self {
            path,
            blind: settled.is_none(),
            words: settled.words(),
            input: input.with_detector(settled.argument.clone()),
            _temporary: None,
        }
    }

    /// A copy with another camera model; valid only while `self` exists.
    pub(crate) fn with_camera(&self, camera: Option<&str>) -> Self {
        let mut input = self.input.clone();
        if let Some(camera) = camera {
            input.camera = Some(camera.to_owned());
        }
        Self {
            path: self.path.clone(),
            input,
            blind: self.blind,
            words: self.words.clone(),
            _temporary: None,
        }
    }
}

/// A folder that is removed on drop.
#[derive(Debug)]
struct Temporary(PathBuf);

impl Drop for Temporary {
    fn drop(&mut self) {
        // A failure is harmless: the folder is hidden.
        let _ = std::fs::remove_dir_all(&self.0);
    }
}

/// Simulates a scene in a separate process, so that its memory is not counted here.
fn simulate(scene: &str, out: &Path, frames: Option<u64>, seed: u64) -> Result<(), Failure> {
    console::info(&format!("simulating scene {scene}, seed {seed}"));
    let mut command = program()?;
    command
        .args(["--quiet", "simulate", "--scene", scene, "--out"])
        .arg(out)
        .args(["--seed", &seed.to_string()])
        .stdin(Stdio::null());
    if let Some(n) = frames {
        command.args(["--frames", &n.to_string()]);
    }
    let output = command
        .output()
        .map_err(|e| Failure::input(format!("expected to simulate {scene}, found: {e}")))?;
    if output.status.success() {
        return Ok(());
    }
    let said = String::from_utf8_lossy(&output.stderr);
    let said = said.trim().trim_start_matches("error: ");
    Err(Failure::input(format!("simulating {scene} failed: {said}")))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn scenes_are_distinguished_from_folders() {
        let scene = Source::of(Path::new("sim:walking_xyz")).unwrap();
        assert_eq!(scene, Source::Scene("walking_xyz".into()));
        let dir = tempfile::tempdir().unwrap();
        let folder = Source::of(dir.path()).unwrap();
        assert_eq!(folder, Source::Folder(dir.path().to_owned()));
        for (path, part) in [
            ("sim:walking_xy", "did you mean \"walking_xyz\"?"),
            ("/no/such", "found nothing"),
        ] {
            let e = Source::of(Path::new(path)).unwrap_err().to_string();
            assert!(e.contains(part), "{e}");
        }
    }
}
