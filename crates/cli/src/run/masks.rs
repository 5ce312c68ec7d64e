//! `--masks`: what moves in each frame, as an image.

use crate::failure::Failure;
use crate::output::ResultFolder;
use crate::run::session::listeners::Writer;
use std::path::{Path, PathBuf};
use stillpoint::imaging::RgbdFrame;
use stillpoint::slam::{Event, FrameReport};
use stillpoint::view::write_mask;

const OPTION: &str = "--masks";

/// A folder of masks in the making.
pub(crate) struct MaskFolder {
    out: PathBuf,
    folder: ResultFolder,
    written: usize,
}

impl Writer for MaskFolder {
    fn write(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(event) = event.as_frame() else {
            return Ok(());
        };
        // Live, the image is gone where too many wait.
        let Some(frame) = &event.frame else {
            return Ok(());
        };
        let _span = tracing::info_span!("masks").entered();
        self.add(frame, &event.report)
    }
}

impl MaskFolder {
    pub(crate) fn create(out: &Path) -> Result<Self, Failure> {
        Ok(Self {
            out: out.to_owned(),
            folder: ResultFolder::create_of(out, OPTION, is_ours)?,
            written: 0,
        })
    }

    /// Writes the mask of a frame, under the stamp of its colour image.
    fn add(&mut self, frame: &RgbdFrame, report: &FrameReport) -> Result<(), Failure> {
        let name = format!("{:.6}.png", report.stamp);
        let mut png = Vec::new();
        write_mask(&report.segments.mask(&frame.depth), &mut png)
            .map_err(|e| Failure::input(format!("{}: {e}", self.out.join(&name).display())))?;
        self.written += 1;
        self.folder.write(&name, &png)
    }

    /// Puts the masks where they belong. Returns what there is, for the report.
    pub(crate) fn finish(self) -> Result<String, Failure> {
        self.folder.commit()?;
        Ok(format!(
            "{} masks in {}\n",
            self.written,
            self.out.display()
        ))
    }
}

/// The files that a folder of masks may hold: an older result's are removed.
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
    fn only_masks_of_an_older_result_are_removed() {
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
