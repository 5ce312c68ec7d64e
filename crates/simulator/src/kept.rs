//! Cache of rendered images in files: many test processes use the same scenes, and rendering takes longer than reading.
//!
//! Requires the feature `kept`, and a folder in `STILLPOINT_SCENES`, which must be used by one version of the simulator only: `.ci/run`
//! names it by a hash of the sources. Each image is a file of its bytes; the file `rendered` has a line per rendered image. If caching
//! fails, the image is rendered.

use crate::simulator::SimulatorConfig;
use std::fs::{self, OpenOptions};
use std::hash::{DefaultHasher, Hash, Hasher};
use std::io::Write;
use std::path::{Path, PathBuf};

const VARIABLE: &str = "STILLPOINT_SCENES";

/// Location of the cached images of one configuration, if enabled.
pub(crate) struct Kept(Option<Place>);

struct Place {
    root: PathBuf,
    folder: PathBuf,
    /// Description of the scene in the file `rendered`.
    scene: String,
}

impl Kept {
    pub(crate) fn new(config: &SimulatorConfig) -> Self {
        let root = std::env::var_os(VARIABLE).filter(|_| cfg!(feature = "kept"));
        Self(root.map(|root| Place::of(Path::new(&root), config)))
    }

    /// The bytes of an image, rendered if not cached. Waits while another process renders it.
    pub(crate) fn bytes(&self, kind: &str, index: usize, render: impl Fn() -> Vec<u8>) -> Vec<u8> {
        let Some(place) = &self.0 else {
            return render();
        };
        place
            .bytes(kind, index, &render)
            .unwrap_or_else(|_| render())
    }

    /// Like [`Self::bytes`], for floats.
    pub(crate) fn floats(
        &self,
        kind: &str,
        index: usize,
        render: impl Fn() -> Vec<f32>,
    ) -> Vec<f32> {
        if self.0.is_none() {
            return render();
        }
        let bytes = || render().iter().flat_map(|v| v.to_le_bytes()).collect();
        let bytes = self.bytes(kind, index, bytes);
        let (numbers, _) = bytes.as_chunks::<4>();
        numbers.iter().map(|b| f32::from_le_bytes(*b)).collect()
    }
}

impl Place {
    fn of(root: &Path, config: &SimulatorConfig) -> Self {
        // The number of frames does not affect their contents.
        let all = SimulatorConfig {
            frames: None,
            ..config.clone()
        };
        let scene = format!("{all:?}");
        let mut hasher = DefaultHasher::new();
        scene.hash(&mut hasher);
        Self {
            root: root.to_owned(),
            folder: root.join(format!("{:016x}", hasher.finish())),
            scene,
        }
    }

    /// Fails if the folder cannot be used.
    fn bytes(
        &self,
        kind: &str,
        index: usize,
        render: &dyn Fn() -> Vec<u8>,
    ) -> std::io::Result<Vec<u8>> {
        let path = self.folder.join(format!("{index}.{kind}"));
        if let Ok(bytes) = fs::read(&path) {
            return Ok(bytes);
        }
        fs::create_dir_all(&self.folder)?;
        // Renamed when complete. Until then its lock, which ends with its process, shows that the image is in progress.
        let part = path.with_extension(format!("{kind}.part"));
        let mut options = OpenOptions::new();
        let mut file = options
            .write(true)
            .create(true)
            .truncate(false)
            .open(&part)?;
        file.lock()?;
        if let Ok(bytes) = fs::read(&path) {
            return Ok(bytes);
        }
        let bytes = render();
        self.note(kind, index)?;
        file.set_len(0)?;
        file.write_all(&bytes)?;
        fs::rename(&part, &path)?;
        Ok(bytes)
    }

    /// Writes the line at once, since many processes append.
    fn note(&self, kind: &str, index: usize) -> std::io::Result<()> {
        let line = format!("{kind} {index} of {}\n", self.scene);
        let mut options = OpenOptions::new();
        let list = self.root.join("rendered");
        let mut file = options.create(true).append(true).open(list)?;
        file.write_all(line.as_bytes())
    }
}
