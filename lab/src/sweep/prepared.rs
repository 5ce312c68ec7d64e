//! An input as the runs take it: a folder or a recording, and its ground truth. Scenes are rendered when the first run asks for them, and removed after the last.

use super::program::Program;
use crate::Failure;
use crate::inputs::{Input, truth};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use stillpoint::evaluation::TimedPose;

/// An input that several runs share.
#[derive(Debug)]
pub(crate) struct Prepared {
    input: Input,
    /// The run's seed, which a scene is rendered with that names none.
    seed: u64,
    /// The first so many frames only.
    frames: Option<u64>,
    /// Where a scene is rendered.
    place: PathBuf,
    /// Whether it stays there.
    keep: bool,
    ready: OnceLock<Result<Ready, String>>,
}

/// What a run needs of it.
#[derive(Debug)]
pub(crate) struct Ready {
    pub(crate) path: PathBuf,
    pub(crate) truth: Vec<TimedPose>,
}

impl Prepared {
    /// Nothing is rendered yet. `work` is where scenes go; with `keep` they stay, and what is there is not rendered again.
    pub(crate) fn new(
        input: Input,
        seed: u64,
        frames: Option<u64>,
        (work, keep): (&Path, bool),
    ) -> Self {
        let name = match &input {
            Input::Scene { scene, seed: own } => {
                let limit = frames.map_or_else(String::new, |n| format!("-{n}"));
                format!("{scene}@{}{limit}", own.unwrap_or(seed))
            }
            Input::Folder { name, .. } => name.clone(),
        };
        Self {
            input,
            seed,
            frames,
            place: work.join(name),
            keep,
            ready: OnceLock::new(),
        }
    }

    /// Renders a scene and reads the ground truth, once; who else asks meanwhile waits.
    pub(crate) fn ready(&self, renderer: &Program) -> Result<&Ready, Failure> {
        let ready = self
            .ready
            .get_or_init(|| self.make(renderer).map_err(|e| e.to_string()));
        ready.as_ref().map_err(|e| e.clone().into())
    }

    fn make(&self, renderer: &Program) -> Result<Ready, Failure> {
        let path = match &self.input {
            Input::Folder { path, .. } => path.clone(),
            Input::Scene { scene, seed } => {
                if !self.place.is_dir() {
                    let seed = seed.unwrap_or(self.seed);
                    renderer.simulate(scene, seed, self.frames, &self.place)?;
                }
                self.place.clone()
            }
        };
        let truth = truth(&path)?.ok_or_else(|| {
            format!(
                "{}: expected ground truth beside the images, found none",
                path.display()
            )
        })?;
        Ok(Ready { path, truth })
    }

    /// Whether its images are rendered.
    pub(crate) fn is_scene(&self) -> bool {
        matches!(self.input, Input::Scene { .. })
    }

    /// The option that limits the frames of a run: a rendered scene has no more.
    pub(crate) fn limit(&self) -> Option<u64> {
        self.frames.filter(|_| !self.is_scene())
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        if !self.keep && self.is_scene() {
            // What cannot be removed takes room in the folder for scratch files, and does no harm.
            let _ = std::fs::remove_dir_all(&self.place);
        }
    }
}
