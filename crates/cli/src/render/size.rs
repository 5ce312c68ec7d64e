//! Encodes images to a file of limited size.

use crate::console::{self, counted};
use crate::failure::Failure;
use crate::output::StreamedFile;
use crate::render::scene::Shot;
use std::io::Write;
use std::path::Path;
use stillpoint::view::film::{MovieOptions, write_gif, write_webp};
use stillpoint::view::{Picture, ViewError, write_png};

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Format {
    Webp,
    Gif,
    Png,
}

/// An encoding level: every n-th image, at this scale, with this quality of WebP.
#[derive(Clone, Copy, Debug, PartialEq)]
struct Effort {
    every: usize,
    scale: f64,
    quality: f32,
}

/// Levels that are tried until one fits: first invisible losses, then the frame rate, then the size, which makes text small.
const EFFORTS: [Effort; 8] = [
    effort(1, 1.0, 78.0),
    effort(1, 1.0, 55.0),
    effort(2, 1.0, 55.0),
    effort(3, 1.0, 55.0),
    effort(4, 0.75, 55.0),
    effort(4, 0.5, 50.0),
    effort(8, 0.5, 40.0),
    effort(16, 0.4, 30.0),
];
/// Minimum size that remains relative to the share of pixels that remain: levels that cannot fit by this bound are skipped.
const HOPE: f64 = 0.5;

const fn effort(every: usize, scale: f64, quality: f32) -> Effort {
    Effort {
        every,
        scale,
        quality,
    }
}

impl Format {
    pub(crate) fn of(path: &Path) -> Result<Self, Failure> {
        let ending = path.extension().and_then(|e| e.to_str()).unwrap_or("");
        match &*ending.to_ascii_lowercase() {
            "webp" => Ok(Self::Webp),
            "gif" => Ok(Self::Gif),
            "png" => Ok(Self::Png),
            _ => Err(Failure::input(format!(
                "{}: expected a file that ends in .webp, .gif or .png for --out, found another; name another with --out",
                path.display()
            ))),
        }
    }

    fn encode(self, shot: &Shot, effort: &Effort) -> Result<(Vec<u8>, Vec<Picture>), ViewError> {
        let last = shot.pictures.len().saturating_sub(1);
        let kept = |i: usize| i == last || (self != Self::Png && i.is_multiple_of(effort.every));
        let pictures = shot.pictures.iter().enumerate();
        let shown: Vec<Picture> = pictures
            .filter(|(i, _)| kept(*i))
            .map(|(_, p)| {
                let part = |n: usize| ((n as f64 * effort.scale).round() as usize).max(1);
                p.scaled(part(p.width()), part(p.height()))
            })
            .collect();
        let options = MovieOptions {
            rate: shot.rate / effort.every as f64,
            quality: effort.quality,
        };
        let bytes = match self {
            Self::Webp => write_webp(&shown, &options)?,
            Self::Gif => write_gif(&shown, &options)?,
            Self::Png => {
                let picture = shown.last().ok_or(ViewError::NoFrames)?;
                let mut bytes = Vec::new();
                write_png(picture, &mut bytes)?;
                bytes
            }
        };
        Ok((bytes, shown))
    }

    /// Whether the output of a level differs from that of the one before.
    fn differs(self, before: &Effort, now: &Effort) -> bool {
        match self {
            Self::Webp => true,
            Self::Gif => (before.every, before.scale) != (now.every, now.scale),
            Self::Png => before.scale != now.scale,
        }
    }
}

/// Writes a file of at most this many MB, and describes it.
///
/// # Errors
/// A file that cannot be written, and images that do not fit; then no file is written.
pub(crate) fn write(
    shot: &Shot,
    format: Format,
    max_mb: f64,
    (mut file, path): (StreamedFile, &Path),
) -> Result<String, Failure> {
    let (bytes, effort, shown) = fitting(shot, format, max_mb)?;
    file.write(|w| w.write_all(&bytes))?;
    file.finish()?;
    let size = shown.first().map_or((0, 0), |p| (p.width(), p.height()));
    if effort != EFFORTS[0] {
        console::info(&format!(
            "smaller or fewer pictures keep {} to {max_mb} MB",
            path.display()
        ));
    }
    Ok(format!(
        "{} of {} x {} px, {:.1} MB: {}",
        counted(shown.len(), "picture"),
        size.0,
        size.1,
        bytes.len() as f64 * 1e-6,
        path.display()
    ))
}

fn fitting(
    shot: &Shot,
    format: Format,
    max_mb: f64,
) -> Result<(Vec<u8>, Effort, Vec<Picture>), Failure> {
    let most = max_mb * 1e6;
    let amount = |e: &Effort| e.scale.powi(2) / e.every as f64;
    let mut before: Option<(Effort, usize)> = None;
    for (i, effort) in EFFORTS.iter().enumerate() {
        if let Some((last, bytes)) = &before {
            let hope = *bytes as f64 * amount(effort) / amount(last) * HOPE;
            let is_last = i + 1 == EFFORTS.len();
            if !format.differs(last, effort) || (hope > most && !is_last) {
                continue;
            }
        }
        let made = format.encode(shot, effort).map_err(Failure::input)?;
        if made.0.len() as f64 <= most {
            return Ok((made.0, *effort, made.1));
        }
        before = Some((*effort, made.0.len()));
    }
    let smallest = before.map_or(0, |(_, bytes)| bytes);
    Err(Failure::criteria(format!(
        "--max-mb: expected pictures that fit into {max_mb} MB, found {:.3} MB for the fewest and smallest; allow more with --max-mb",
        smallest as f64 * 1e-6
    )))
}

#[cfg(test)]
mod tests {
    use super::*;
    use stillpoint::view::Colour;

    /// Images that compress badly.
    fn shot(n: usize) -> Shot {
        let mut state = 1u32;
        let mut noise = || {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 24) as u8
        };
        let mut picture = || {
            let data = (0..200 * 100).map(|_| noise()).collect();
            let gray = stillpoint::imaging::GrayImage::from_vec(200, 100, data).unwrap();
            Picture::from_gray(&gray)
        };
        Shot {
            pictures: (0..n).map(|_| picture()).collect(),
            rate: 10.0,
        }
    }

    #[test]
    fn oversized_output_is_reduced() {
        let shot = shot(16);
        for format in [Format::Webp, Format::Gif, Format::Png] {
            let (all, effort, shown) = fitting(&shot, format, 100.0).unwrap();
            assert_eq!(effort, EFFORTS[0]);
            let count = if format == Format::Png { 1 } else { 16 };
            assert_eq!((shown.len(), shown[0].width()), (count, 200));
            let half = 0.5 * all.len() as f64 * 1e-6;
            let (less, effort, _) = fitting(&shot, format, half).unwrap();
            assert!(less.len() as f64 <= half * 1e6, "{format:?}");
            assert_ne!(effort, EFFORTS[0]);
            let none = fitting(&shot, format, 1e-5).unwrap_err().to_string();
            assert!(none.contains("allow more with --max-mb"), "{none}");
        }
    }

    #[test]
    fn file_over_the_size_limit_is_not_written() {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join("a.gif");
        std::fs::write(&path, "old").unwrap();
        let at = |path: &Path| StreamedFile::create(path, "--out").unwrap();
        assert!(write(&shot(2), Format::Gif, 1e-5, (at(&path), &path)).is_err());
        assert_eq!(std::fs::read(&path).unwrap(), b"old");
        let said = write(&shot(2), Format::Gif, 3.0, (at(&path), &path)).unwrap();
        assert!(said.starts_with("2 pictures of 200 x 100 px"), "{said}");
        let one = Shot {
            pictures: vec![Picture::new(8, 8, Colour::BLACK)],
            rate: 10.0,
        };
        let path = dir.path().join("b.webp");
        assert!(write(&one, Format::Webp, 3.0, (at(&path), &path)).is_ok());
    }

    #[test]
    fn file_extension_selects_the_format() {
        assert_eq!(Format::of(Path::new("a/b.WebP")).unwrap(), Format::Webp);
        for wrong in ["a.mp4", "a", "/dev/null", "png"] {
            let e = Format::of(Path::new(wrong)).unwrap_err().to_string();
            assert!(e.contains(".webp, .gif or .png"), "{e}");
        }
    }
}
