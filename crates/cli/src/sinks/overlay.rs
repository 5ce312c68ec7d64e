//! `--overlay`: draws features, objects and state into frames, and makes an animation.

use crate::failure::Failure;
use crate::output::ResultFolder;
use crate::run::live_report::OVERLAY;
use crate::sink::{Ended, Output, Sink, Start, Subscription};
use clap::Args;
use std::fs::File;
use std::io::{BufWriter, Write};
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint::imaging::RgbdFrame;
use stillpoint::live::Watch;
use stillpoint::map::MapView;
use stillpoint::slam::{Event, FrameReport};
use stillpoint::view::{Animation, AnimationOptions, ViewError, write_png};
pub(crate) use stillpoint::view::{Style, picture};

const OPTION: &str = "--overlay";
const ANIMATION: &str = "animation.gif";
/// Animation file of older versions.
const OLD_ANIMATION: &str = "animation.png";
/// Maximum number of images per second of an animation: smooth enough.
const SMOOTH: f64 = 10.0;
/// Maximum number of images of an animation: some 20 MB. Longer recordings show fewer per second.
const LONGEST: f64 = 400.0;

#[derive(Clone, Copy, Debug, Default, PartialEq, Eq, clap::ValueEnum)]
pub(crate) enum Labels {
    /// Every object, including tentative and static ones.
    All,
    /// Confirmed objects of classes that move by themselves, and any object seen moving.
    #[default]
    Movers,
    /// Like `movers`, without names.
    None,
}

impl From<Labels> for stillpoint::view::Labels {
    fn from(labels: Labels) -> Self {
        match labels {
            Labels::All => Self::All,
            Labels::Movers => Self::Movers,
            Labels::None => Self::None,
        }
    }
}

#[derive(Clone, Debug, Default, Args)]
pub(crate) struct OverlayOutput {
    /// Write frames as PNG, and an animation of them as GIF, with features, objects and state drawn over them. Each image has a legend.
    /// Boxes are dashed where an object is predicted without a detection; a speed is shown only where the object moves and the speed
    /// exceeds its standard deviation.
    #[arg(long, value_name = "DIR", verbatim_doc_comment)]
    pub(crate) overlay: Option<PathBuf>,
    /// Draw only every N-th frame.
    #[arg(long, value_name = "N", default_value_t = 1, requires = "overlay", value_parser = clap::value_parser!(u32).range(1..))]
    pub(crate) overlay_every: u32,
    /// Which objects are drawn: all (including tentative ones and furniture), only confirmed people and other moving objects, or these
    /// without their names.
    #[arg(long, value_name = "WHICH", value_enum, default_value_t = Labels::Movers, requires = "overlay")]
    pub(crate) overlay_labels: Labels,
}

impl Output for OverlayOutput {
    fn begin(&self, start: &mut Start<'_>) -> Result<Option<Box<dyn Sink>>, Failure> {
        let Some(folder) = &self.overlay else {
            return Ok(None);
        };
        let overlay = OverlayFolder::create(
            folder,
            self.overlay_every as usize,
            start.frames.unwrap_or(start.stamps.len()),
            rate(start.stamps),
            Style {
                labels: self.overlay_labels.into(),
                weights: start.config.motion_weights.clone(),
                bare: false,
            },
        );
        Ok(Some(Box::new(overlay?)))
    }

    fn folders(&self) -> Vec<(&'static str, &Path)> {
        self.overlay.iter().map(|f| (OPTION, &**f)).collect()
    }

    fn wants_colour(&self) -> bool {
        self.overlay.is_some()
    }
}

/// Frames per second; 30 where the stamps do not determine it.
fn rate(stamps: &[(f64, f64)]) -> f64 {
    let (Some((first, _)), Some((last, _))) = (stamps.first(), stamps.last()) else {
        return 30.0;
    };
    let rate = (stamps.len() - 1) as f64 / (last - first);
    if rate.is_finite() && rate > 0.0 {
        rate
    } else {
        30.0
    }
}

impl Sink for OverlayFolder {
    fn subscribe(&mut self, _: &Arc<MapView>, _: Option<&Watch>) -> Option<Subscription> {
        Some(Subscription::to_images(OVERLAY, self.every))
    }

    /// Draws every n-th tracked frame. In a live run a frame comes without its image where drawing falls behind.
    fn receive(&mut self, event: &Event) -> Result<(), Failure> {
        let Some(tracked) = event.as_frame() else {
            return Ok(());
        };
        let turn = self.seen.is_multiple_of(self.every);
        self.seen += 1;
        match &tracked.frame {
            Some(frame) if turn => {
                let _span = tracing::info_span!("overlay").entered();
                self.add(frame, &tracked.report)
            }
            _ => Ok(()),
        }
    }

    fn finish(self: Box<Self>, ended: &mut Ended<'_>) -> Result<(), Failure> {
        let pictures = self.drawn;
        self.animation
            .finish()
            .and_then(|mut sink| Ok(sink.flush().and_then(|()| sink.get_ref().sync_all())?))
            .map_err(|e| failure(&self.out.join(ANIMATION), &e))?;
        self.folder.commit()?;
        ended.found.said += &format!(
            "{pictures} pictures and {ANIMATION} in {}\n",
            self.out.display()
        );
        Ok(())
    }
}

struct OverlayFolder {
    out: PathBuf,
    folder: ResultFolder,
    every: usize,
    seen: usize,
    drawn: usize,
    style: Style,
    animation: Animation<BufWriter<File>>,
}

impl OverlayFolder {
    /// Starts the folder for every `every`-th of `frames` frames, at `rate` frames per second.
    fn create(
        out: &Path,
        every: usize,
        frames: usize,
        rate: f64,
        style: Style,
    ) -> Result<Self, Failure> {
        let mut folder = ResultFolder::create_of(out, OPTION, is_ours)?;
        let pictures = frames.div_ceil(every) as f64;
        let rate = rate / every as f64;
        let shown = (rate / SMOOTH).max(pictures / LONGEST).ceil();
        let options = AnimationOptions {
            every: shown as usize,
            frames_per_second: rate,
            ..AnimationOptions::default()
        };
        let animation = Animation::new(BufWriter::new(folder.begin(ANIMATION)?), options);
        Ok(Self {
            out: out.to_owned(),
            folder,
            every,
            seen: 0,
            drawn: 0,
            style,
            animation,
        })
    }

    fn add(&mut self, frame: &RgbdFrame, report: &FrameReport) -> Result<(), Failure> {
        let picture = picture(frame, report, &self.style);
        let name = format!("{:06}.png", report.frame.0);
        let mut png = Vec::new();
        write_png(&picture, &mut png)
            .and_then(|()| self.animation.push(&picture))
            .map_err(|e| failure(&self.out, &e))?;
        self.drawn += 1;
        self.folder.write(&name, &png)
    }
}

/// Names of image files; those of an older result are removed.
fn is_ours(name: &str) -> bool {
    let frame = |number: &str| number.len() >= 6 && number.bytes().all(|b| b.is_ascii_digit());
    [ANIMATION, OLD_ANIMATION].contains(&name) || name.strip_suffix(".png").is_some_and(frame)
}

fn failure(path: &Path, error: &ViewError) -> Failure {
    match error {
        ViewError::Write(e) => Failure::write_of(path, OPTION, e),
        e => Failure::input(format!("{}: {e}; leave {OPTION} out", path.display())),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_pictures_of_an_earlier_result_are_removed() {
        for (name, ours) in [
            ("000012.png", true),
            ("1000000.png", true),
            ("animation.gif", true),
            ("animation.png", true),
            ("12.png", false),
            ("holiday.png", false),
            ("000012.jpg", false),
        ] {
            assert_eq!(is_ours(name), ours, "{name}");
        }
    }
}
