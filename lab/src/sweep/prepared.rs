//! A folder or recording with its ground truth, shared by runs. Scenes are rendered before the first run and removed after the last.

use super::program::Program;
use crate::Failure;
use crate::inputs::{Input, truth};
use std::path::{Path, PathBuf};
use std::sync::OnceLock;
use stillpoint::evaluation::TimedPose;

#[derive(Debug)]
pub(crate) struct Prepared {
    input: Input,
    /// Seed of a scene without a seed of its own.
    seed: u64,
    frames: Option<u64>,
    place: PathBuf,
    keep: bool,
    ready: OnceLock<Result<Ready, String>>,
}

#[derive(Debug)]
pub(crate) struct Ready {
    pub(crate) path: PathBuf,
    pub(crate) truth: Vec<TimedPose>,
}

impl Prepared {
    /// Renders nothing yet. With `keep`, scenes in `work` stay and are reused.
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

    /// Renders a scene and reads the ground truth, once; other threads wait meanwhile.
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

    pub(crate) fn is_scene(&self) -> bool {
        matches!(self.input, Input::Scene { .. })
    }

    /// The frame limit to pass to a run: rendered scenes are limited already.
    pub(crate) fn limit(&self) -> Option<u64> {
        self.frames.filter(|_| !self.is_scene())
    }
}

impl Drop for Prepared {
    fn drop(&mut self) {
        if !self.keep && self.is_scene() {
            // A failure only leaves scratch files.
            let _ = std::fs::remove_dir_all(&self.place);
        }
    }
}
