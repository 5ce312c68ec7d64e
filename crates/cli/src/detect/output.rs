//! `detect --out`: the table of detections, and images with boxes.

use crate::failure::Failure;
use crate::output::ResultFolder;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint::detection::{Detection, ScriptRow, format_script};
use stillpoint::imaging::{ColourImage, DepthImage, FrameId, GrayImage, RgbdFrame};
use stillpoint::view::{Colour, Overlay, OverlayBox, Picture, draw, write_png};

const OPTION: &str = "--out";
const TABLE: &str = "detections.csv";
/// Prefix of image names, which distinguishes those of an older result from the user's files.
const PREFIX: &str = "boxes_";

/// The output folder before it is committed.
pub(crate) struct DetectFolder {
    out: PathBuf,
    folder: ResultFolder,
    names: BTreeSet<String>,
}

impl DetectFolder {
    /// Starts a folder. The input folder itself is refused, since the written images would become inputs of the next run.
    pub(crate) fn create(out: &Path, input: &Path) -> Result<Self, Failure> {
        let same = |a: &Path, b: &Path| {
            let [a, b] = [a, b].map(|p| p.canonicalize().ok());
            a.is_some() && a == b
        };
        let parent = match input.parent() {
            Some(parent) if parent != Path::new("") => parent,
            _ => Path::new("."),
        };
        if same(out, input) || (input.is_file() && same(out, parent)) {
            return Err(Failure::input(format!(
                "{}: expected another folder than that of the images, found the same; name another with {OPTION}",
                out.display()
            )));
        }
        Ok(Self {
            out: out.to_owned(),
            folder: ResultFolder::create_of(out, OPTION, is_ours)?,
            names: BTreeSet::new(),
        })
    }

    /// Draws the detections in an image. `name` is its file name.
    pub(crate) fn add(
        &mut self,
        name: &str,
        image: ColourImage,
        found: &[Detection],
    ) -> Result<(), Failure> {
        let mut png = Vec::new();
        let name = self.name(name);
        write_png(&picture(image, found), &mut png).map_err(|e| {
            Failure::input(format!(
                "{}: {e}; leave {OPTION} out",
                self.out.join(&name).display()
            ))
        })?;
        self.folder.write(&name, &png)
    }

    /// A unique name for an output image: input names may differ only in their extensions.
    fn name(&mut self, image: &str) -> String {
        let stem = Path::new(image).file_stem().unwrap_or(image.as_ref());
        let stem = stem.to_string_lossy();
        let stem = if self.names.contains(stem.as_ref()) {
            image.into()
        } else {
            stem
        };
        self.names.insert(stem.to_string());
        format!("{PREFIX}{stem}.png")
    }

    /// Writes the table and moves all files into place. Returns a summary.
    pub(crate) fn finish(mut self, rows: &[ScriptRow]) -> Result<String, Failure> {
        self.folder.write(TABLE, format_script(rows).as_bytes())?;
        self.folder.commit()?;
        Ok(format!(
            "{TABLE} and {} pictures in {}\n",
            self.names.len(),
            self.out.display()
        ))
    }
}

/// Names of files that a result may hold; those of an older result are removed.
fn is_ours(name: &str) -> bool {
    name == TABLE || (name.starts_with(PREFIX) && name.ends_with(".png"))
}

fn picture(image: ColourImage, found: &[Detection]) -> Picture {
    let boxes: Vec<OverlayBox> = found
        .iter()
        // The highest score is drawn last, on top.
        .rev()
        .map(|d| OverlayBox {
            bounds: d.bounds,
            label: format!("{} {:.2}", d.class, d.score),
            colour: Colour::of_number(u32::from(d.class.0)),
            coasting: false,
            quiet: false,
        })
        .collect();
    let frame = RgbdFrame {
        id: FrameId(0),
        stamp: 0.0,
        depth_stamp: 0.0,
        gray: GrayImage::new(0, 0),
        colour: Some(Arc::new(image)),
        depth: DepthImage::default(),
    };
    draw(
        &frame,
        &Overlay {
            boxes: &boxes,
            ..Overlay::default()
        },
    )
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn output_pictures_have_distinct_names() {
        let dir = tempfile::tempdir().unwrap();
        let out = dir.path().join("out");
        let mut folder = DetectFolder::create(&out, dir.path()).unwrap();
        let names = ["a.png", "a.jpg", "b.c.png"].map(|n| folder.name(n));
        assert_eq!(names, ["boxes_a.png", "boxes_a.jpg.png", "boxes_b.c.png"]);
        assert!(names.iter().all(|n| is_ours(n)));
        assert!(!is_ours("a.png") && !is_ours("boxes.csv"));
    }

    #[test]
    fn input_folder_is_refused_as_output() {
        let dir = tempfile::tempdir().unwrap();
        let roundabout = dir.path().join(".");
        let e = DetectFolder::create(&roundabout, dir.path()).err().unwrap();
        assert!(e.to_string().contains("found the same"), "{e}");
        let image = dir.path().join("bus.jpg");
        std::fs::write(&image, "").unwrap();
        assert!(DetectFolder::create(dir.path(), &image).is_err());
        assert!(DetectFolder::create(&dir.path().join("out"), &image).is_ok());
    }
}
