//! `--masks`: writes the moving regions of each frame as an image.

use crate::failure::Failure;
use crate::output::ResultFolder;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use clap::Args;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint::imaging::RgbdFrame;
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::{Event, FrameReport, Preset};
use stillpoint::view::write_mask;

const OPTION: &str = "--masks";

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct MasksOutput {
    /// Write a mask of every frame as 8-bit PNG, named by its timestamp: 255 where the scene moves, 0 where it is static. A live run skips
    /// masks when it lacks the time.
    #[arg(long, value_name = "DIR", verbatim_doc_comment)]
    pub(crate) masks: Option<PathBuf>,
}

impl Output for MasksOutput {
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(folder) = &self.masks else {
            return Ok(None);
        };
        if start.config.static_filter.preset != Preset::Default {
            return Err(Failure::input(
                "--masks: expected static_filter.preset \"default\", which judges surfaces; the configuration has another, which judges features alone",
            ));
        }
        Ok(Some(Box::new(MaskFolder::create(folder)?)))
    }

    fn folders(&self) -> Vec<(&'static str, &Path)> {
        self.masks.iter().map(|f| (OPTION, &**f)).collect()
    }
}

struct MaskFolder {
    out: PathBuf,
    folder: ResultFolder,
    written: usize,
}

impl Sink for MaskFolder {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images("masks", 1))
    }

    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(event) = event.as_frame() else {
            return Ok(());
        };
        // In a live run the image is missing where too many are queued.
        let Some(frame) = &event.frame else {
            return Ok(());
        };
        let _span = tracing::info_span!("masks").entered();
        self.add(frame, &event.report)
    }

    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        self.folder.commit()?;
        ended.found.said += &format!("{} masks in {}\n", self.written, self.out.display());
        Ok(())
    }
}

impl MaskFolder {
    fn create(out: &Path) -> Result<Self, Failure> {
        Ok(Self {
            out: out.to_owned(),
            folder: ResultFolder::create_of(out, OPTION, is_ours)?,
            written: 0,
        })
    }

    /// Writes the mask of a frame, named by the stamp of its colour image.
    fn add(&mut self, frame: &RgbdFrame, report: &FrameReport) -> Result<(), Failure> {
        let name = format!("{:.6}.png", report.stamp);
        let mut png = Vec::new();
        write_mask(&report.segments.mask(frame), &mut png)
            .map_err(|e| Failure::input(format!("{}: {e}", self.out.join(&name).display())))?;
        self.written += 1;
        self.folder.write(&name, &png)
    }
}

/// Names of mask files; those of an older result are removed.
fn is_ours(name: &str) -> bool {
    let digits = |part: &str| part.bytes().all(|b| b.is_ascii_digit());
    let stamp = name.strip_suffix(".png").and_then(|s| s.split_once('.'));
    stamp.is_some_and(|(whole, part)| {
        let whole = whole.strip_prefix('-').unwrap_or(whole);
        !whole.is_empty() && digits(whole) && part.len() == 6 && digits(part)
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_masks_of_an_earlier_result_are_removed() {
        for (name, ours) in [
            ("1305031102.175304.png", true),
            ("0.033333.png", true),
            ("000012.png", false),
            ("1.5.png", false),
            (".175304.png", false),
            ("animation.gif", false),
        ] {
            assert_eq!(is_ours(name), ours, "{name}");
        }
    }
}
