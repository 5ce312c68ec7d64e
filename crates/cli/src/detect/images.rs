//! Inputs of `detect`: an image, a folder of images, or the colour images of a data set or recording.

use crate::args::{InputArgs, TopicArgs};
use crate::console;
use crate::failure::Failure;
use crate::input;
use std::collections::BTreeSet;
use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint::datasets::{CameraChoice, Dataset, DatasetError, OpenOptions, read_colour};
use stillpoint::imaging::{ColourImage, FrameSource};
use stillpoint::recordings::{self, FrameOptions, Source};

const ENDINGS: [&str; 4] = ["png", "jpg", "jpeg", "webp"];

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Image {
    pub(crate) name: String,
    pub(crate) path: PathBuf,
    /// Colour stamp of a data set or recording, s; otherwise see [`Stamps`].
    pub(crate) stamp: f64,
}

/// Origin of the images' stamps.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(crate) enum Stamps {
    Own,
    /// The numbers in the file names.
    Names,
    /// The index in the order of names, from 0.
    Indices,
}

impl Stamps {
    /// Explanation for the user, where the stamps are not real ones.
    pub(crate) fn in_words(self) -> Option<&'static str> {
        match self {
            Self::Own => None,
            Self::Names => {
                Some("the images have no time stamps: the numbers in their names stand for them")
            }
            Self::Indices => {
                Some("the images have no time stamps: their index, from 0, stands for them")
            }
        }
    }
}

#[derive(Debug)]
pub(crate) struct Images {
    pub(crate) items: Vec<Image>,
    pub(crate) stamps: Stamps,
    /// The frames of a recording, which have no files.
    frames: Option<Source>,
}

impl Images {
    /// Reads an image; those of a recording are read in order.
    pub(crate) fn read(&mut self, item: usize) -> Result<ColourImage, String> {
        let Some(frames) = &mut self.frames else {
            return read_colour(&self.items[item].path).map_err(|e| e.to_string());
        };
        let of = self.items[item].path.display();
        let frame = frames
            .next_frame()
            .ok_or_else(|| format!("{of}: expected another frame, found its end"))?
            .map_err(|e| e.to_string())?;
        let colour = frame
            .colour
            .ok_or_else(|| format!("{of}: expected a colour image, found none"))?;
        Ok(Arc::unwrap_or_clone(colour))
    }
}

/// The images at a path; of a recording those of `topics`.
///
/// # Errors
/// Nothing at the path, a folder without images, a data set with unreadable lists, an unusable recording.
pub(crate) fn find(path: &Path, topics: &TopicArgs) -> Result<Images, Failure> {
    if recordings::is_recording(path) {
        return of_recording(path, topics);
    }
    if path.is_file() {
        return Ok(plain(vec![path.to_owned()]));
    }
    if !path.is_dir() {
        return Err(Failure::input(format!(
            "{}: expected an image or a folder, found nothing; check the path",
            path.display()
        )));
    }
    match open(path) {
        Ok(dataset) => Ok(of_dataset(&dataset)),
        Err(
            e @ (DatasetError::UnknownLayout { .. }
            | DatasetError::NoDepth { .. }
            | DatasetError::EmptyFolder { .. }),
        ) => {
            let files = images_in(path)?;
            if files.is_empty() {
                let found = if matches!(e, DatasetError::EmptyFolder { .. }) {
                    "an empty folder"
                } else {
                    "neither"
                };
                return Err(Failure::input(format!(
                    "{}: expected images (.png, .jpg, .webp) or an RGB-D data set, found {found}; name the folder that holds the images",
                    path.display()
                )));
            }
            Ok(plain(files))
        }
        Err(e) => Err(e.into()),
    }
}

/// The colour images of a recording, named by their stamps.
fn of_recording(path: &Path, topics: &TopicArgs) -> Result<Images, Failure> {
    let input = input::open(
        path,
        &InputArgs {
            topics: topics.clone(),
            ..InputArgs::default()
        },
    )?;
    let item = |(stamp, _): (f64, f64)| Image {
        name: format!("{stamp:.6}.png"),
        path: path.to_owned(),
        stamp,
    };
    let options = FrameOptions {
        keep_colour: true,
        ..FrameOptions::default()
    };
    Ok(Images {
        items: input.stamps().into_iter().map(item).collect(),
        stamps: Stamps::Own,
        frames: Some(input.frames(&options)?),
    })
}

/// Opens a data set with any camera model, since only the images are used.
fn open(path: &Path) -> Result<Dataset, DatasetError> {
    let any = OpenOptions {
        camera: Some(CameraChoice::Preset("tum_fr1".to_owned())),
        ..OpenOptions::default()
    };
    match Dataset::open(path, &OpenOptions::default()) {
        Err(DatasetError::UnknownCamera { .. }) => Dataset::open(path, &any),
        other => other,
    }
}

fn of_dataset(dataset: &Dataset) -> Images {
    console::info(&format!(
        "data set of {} frames, layout {}",
        dataset.entries().len(),
        dataset.layout()
    ));
    let items = dataset.entries().iter().map(|e| Image {
        name: name_of(&e.colour),
        path: e.colour.clone(),
        stamp: e.stamp,
    });
    Images {
        items: items.collect(),
        stamps: Stamps::Own,
        frames: None,
    }
}

/// The images in a folder, by name.
fn images_in(folder: &Path) -> Result<Vec<PathBuf>, Failure> {
    let unreadable = |e: std::io::Error| {
        Failure::input(format!(
            "{}: expected to read the folder, found: {e}; check its permissions",
            folder.display()
        ))
    };
    let mut files = Vec::new();
    for entry in std::fs::read_dir(folder).map_err(unreadable)? {
        let path = entry.map_err(unreadable)?.path();
        let ending = path.extension().map(|e| e.to_string_lossy().to_lowercase());
        if ending.is_some_and(|e| ENDINGS.contains(&e.as_str())) && path.is_file() {
            files.push(path);
        }
    }
    files.sort();
    Ok(files)
}

/// Images without stamps: numbered by their file names if all are distinct numbers, else by index.
fn plain(files: Vec<PathBuf>) -> Images {
    let number = |path: &PathBuf| -> Option<f64> {
        let stem = path.file_stem()?.to_str()?;
        let digits = stem.bytes().all(|b| b.is_ascii_digit() || b == b'.');
        stem.parse().ok().filter(|_| digits)
    };
    let numbers: Option<Vec<f64>> = files.iter().map(number).collect();
    let numbers = numbers.filter(|all| {
        let different: BTreeSet<u64> = all.iter().map(|x| x.to_bits()).collect();
        different.len() == all.len()
    });
    let stamps = match numbers {
        Some(_) => Stamps::Names,
        None => Stamps::Indices,
    };
    let numbers = numbers.unwrap_or_else(|| (0..files.len()).map(|i| i as f64).collect());
    let items = files.into_iter().zip(numbers).map(|(path, stamp)| Image {
        name: name_of(&path),
        path,
        stamp,
    });
    Images {
        items: items.collect(),
        stamps,
        frames: None,
    }
}

fn name_of(path: &Path) -> String {
    let name = path.file_name().unwrap_or(path.as_os_str());
    name.to_string_lossy().into_owned()
}

#[cfg(test)]
mod tests {
    use super::*;

    fn stamps(names: &[&str]) -> (Vec<f64>, Stamps) {
        let images = plain(names.iter().map(Into::into).collect());
        let numbers = images.items.iter().map(|i| i.stamp).collect();
        (numbers, images.stamps)
    }

    #[test]
    fn numeric_file_names_are_stamps() {
        let found = stamps(&["a/1305031102.175304.png", "a/1305031102.211214.jpg"]);
        assert_eq!(
            found,
            (
                vec![1_305_031_102.175_304, 1_305_031_102.211_214],
                Stamps::Names
            )
        );
        assert_eq!(stamps(&["0007.png"]), (vec![7.0], Stamps::Names));
        for names in [
            &["1.png", "b.png"][..],
            &["1.png", "01.png"],
            &["-1.png", "2.png"],
            &["1e3.png", "2.png"],
            &["inf.png", "nan.png"],
        ] {
            assert_eq!(
                stamps(names),
                (vec![0.0, 1.0], Stamps::Indices),
                "{names:?}"
            );
        }
    }

    #[test]
    fn folder_images_are_sorted_and_other_files_ignored() {
        let dir = tempfile::tempdir().unwrap();
        for name in ["b.png", "a.JPG", "c.webp", "notes.txt", "d.jpeg"] {
            std::fs::write(dir.path().join(name), "").unwrap();
        }
        std::fs::create_dir(dir.path().join("folder.png")).unwrap();
        let found = find(dir.path(), &TopicArgs::default()).unwrap();
        let names: Vec<&str> = found.items.iter().map(|i| i.name.as_str()).collect();
        assert_eq!(names, ["a.JPG", "b.png", "c.webp", "d.jpeg"]);
        assert_eq!(found.stamps, Stamps::Indices);
    }

    #[test]
    fn paths_without_images_are_refused() {
        let dir = tempfile::tempdir().unwrap();
        let refused = |path: &Path| find(path, &TopicArgs::default()).unwrap_err().to_string();
        assert!(refused(dir.path()).contains("found an empty folder"));
        std::fs::write(dir.path().join("notes.txt"), "").unwrap();
        assert!(refused(dir.path()).contains("found neither"));
        let nothing = dir.path().join("no");
        assert!(refused(&nothing).contains("found nothing"));
    }
}
