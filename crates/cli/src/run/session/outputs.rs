//! What a session writes while frames go by, and what it saves when they cannot go on.

use crate::console;
use crate::demo::pictures::Shots;
use crate::failure::Failure;
use crate::map::file::MapOutput;
use crate::run::overlay::OverlayFolder;
use crate::run::verdicts::VerdictFile;
use crate::trace::TraceFile;
use stillpoint::imaging::RgbdFrame;
use stillpoint::map::Map;
use stillpoint::slam::Event;

/// What is written while frames go by.
#[derive(Default)]
pub(crate) struct Outputs {
    pub(crate) verdicts: Option<VerdictFile>,
    /// Pictures in a folder; not together with those for the demo.
    pub(crate) overlay: Option<OverlayFolder>,
    /// Pictures for the demo.
    pub(crate) shots: Option<Shots>,
    /// What every thread does when.
    pub(crate) trace: Option<TraceFile>,
    /// The map, at the end.
    pub(crate) map: Option<MapOutput>,
}

impl Outputs {
    /// A copy of the next frame, if it will be drawn.
    pub(crate) fn keep(&mut self, frame: &RgbdFrame) -> Option<RgbdFrame> {
        let overlay = self.overlay.as_mut().is_some_and(OverlayFolder::wants_next);
        let shots = self.shots.as_mut().is_some_and(Shots::wants_next);
        (overlay || shots).then(|| frame.clone())
    }

    /// Writes what is to be written of a step. `kept` is what [`Outputs::keep`] gave before it.
    pub(crate) fn take(
        &mut self,
        events: &[Event],
        kept: Option<&RgbdFrame>,
    ) -> Result<(), Failure> {
        for event in events {
            let Event::Frame(report) = event else {
                continue;
            };
            if let Some(file) = &mut self.verdicts {
                let _span = tracing::info_span!("verdicts").entered();
                file.add(report)?;
            }
            if let (Some(folder), Some(frame)) = (&mut self.overlay, kept) {
                let _span = tracing::info_span!("overlay").entered();
                folder.add(frame, report)?;
            }
            if let (Some(shots), Some(frame)) = (&mut self.shots, kept) {
                let _span = tracing::info_span!("overlay").entered();
                shots.add(frame, report);
            }
        }
        self.trace.as_mut().map_or(Ok(()), TraceFile::fetch)
    }

    /// Saves the map of a run that cannot go on after so many frames, if it is to be saved, and says so. What else there was is
    /// lost, and whoever mapped for an hour wants to go on from there.
    pub(crate) fn rescue_map(&mut self, map: Option<&Map>, frames: usize) {
        let Some(file) = self.map.take() else { return };
        let Some(map) = map.filter(|m| frames > 0 && m.view().keyframe_count() > 0) else {
            return;
        };
        match file.save(map) {
            Ok(saved) => console::line(&format!(
                "the run ends after {frames} frames; the map until then, of {} keyframes and {} landmarks, is saved to {}",
                saved.keyframes, saved.landmarks, saved.path
            )),
            Err(failure) => console::line(&format!("the map until then is not saved: {failure}")),
        }
    }

    /// Puts everything where it belongs, and says where that is.
    pub(crate) fn finish(self) -> Result<String, Failure> {
        let mut said = String::new();
        if let Some(file) = self.verdicts {
            said += &file.finish()?;
        }
        if let Some(folder) = self.overlay {
            said += &folder.finish()?;
        }
        if let Some(file) = self.trace {
            said += &file.finish()?;
        }
        Ok(said)
    }
}
