//! `--save-map`: saves the map when the run ends.

use crate::console;
use crate::failure::Failure;
use crate::map::file::MapOutput;
use crate::sink::{Ended, Left, Output, Sink, Start};
use clap::Args;
use std::path::{Path, PathBuf};

const OPTION: &str = "--save-map";

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct SaveMapOutput {
    /// Save the map to this file when the run ends, also after Ctrl-C or an error: see map --help. An existing file is replaced only by a
    /// complete one.
    #[arg(long, value_name = "FILE", verbatim_doc_comment)]
    pub(crate) save_map: Option<PathBuf>,
}

impl Output for SaveMapOutput {
    fn begin(&self, _: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(path) = &self.save_map else {
            return Ok(None);
        };
        Ok(Some(Box::new(MapSink(MapOutput::create(path, OPTION)?))))
    }

    fn files(&self) -> Vec<(&'static str, &Path)> {
        self.save_map.iter().map(|f| (OPTION, &**f)).collect()
    }
}

struct MapSink(MapOutput);

impl Sink for MapSink {
    /// Saves the map with the extensions of other sinks. A failure to save does not discard the result.
    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        let more = std::mem::take(&mut ended.found.extensions);
        let saved = match &ended.session.map {
            Some(map) => self.0.save(map, Some(&ended.session.timing), more),
            None => Err(Failure::criteria(
                "the map is not saved: mapping ended in the midst of its work and left it in a state that cannot be used",
            )),
        };
        match saved {
            Ok(saved) => ended.found.shelf.put(saved),
            Err(failure) => ended.found.late = Some(failure),
        }
        Ok(())
    }

    /// Saves the map of a failed run, so that the user can continue from it. All other results are lost.
    fn rescue(self: Box<Self>, left: &Left<'_>) {
        let map = left.map.filter(|m| m.view().keyframe_count() > 0);
        let Some(map) = map.filter(|_| left.frames > 0) else {
            return;
        };
        match self.0.save(map, Some(&left.timing), Vec::new()) {
            Ok(saved) => console::line(&format!(
                "the run ends after {} frames; the map until then, of {} keyframes and {} landmarks, is saved to {}",
                left.frames, saved.keyframes, saved.landmarks, saved.path
            )),
            Err(failure) => console::line(&format!("the map until then is not saved: {failure}")),
        }
    }
}
