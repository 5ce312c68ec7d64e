//! A small data set in the TUM layout in a temporary folder.

use image::{DynamicImage, ImageBuffer, ImageFormat, Luma};
use std::path::{Path, PathBuf};
use stillpoint_datasets::{Dataset, OpenOptions};
use tempfile::TempDir;

pub(crate) const W: u32 = 32;
pub(crate) const H: u32 = 24;

pub(crate) struct Folder {
    /// Keeps the folder until the test ends.
    _dir: TempDir,
    pub(crate) path: PathBuf,
}

pub(crate) fn gray(value: u8) -> DynamicImage {
    DynamicImage::ImageLuma8(ImageBuffer::from_pixel(W, H, Luma([value])))
}

pub(crate) fn depth(value: u16) -> DynamicImage {
    DynamicImage::ImageLuma16(ImageBuffer::from_pixel(W, H, Luma([value])))
}

impl Folder {
    /// `n` frames at 10 Hz, depth of 2 m five milliseconds late, and a `camera.txt`.
    pub(crate) fn tum(name: &str, n: usize) -> Self {
        let folder = Self::empty(name);
        let (mut rgb, mut depths) = (String::new(), String::new());
        for i in 0..n {
            let stamp = i as f64 * 0.1;
            folder.image(&format!("rgb/{i}.png"), &gray(i as u8));
            folder.image(&format!("depth/{i}.png"), &depth(10_000));
            rgb += &format!("{stamp:.6} rgb/{i}.png\n");
            depths += &format!("{:.6} depth/{i}.png\n", stamp + 0.005);
        }
        folder.text("rgb.txt", &format!("# colour\n{rgb}"));
        folder.text("depth.txt", &format!("# depth\n{depths}"));
        folder.text(
            "camera.txt",
            "# fx fy cx cy depth_scale\n30 30 16 12 5000\n",
        );
        folder
    }

    pub(crate) fn empty(name: &str) -> Self {
        let dir = tempfile::tempdir().unwrap();
        let path = dir.path().join(name);
        std::fs::create_dir(&path).unwrap();
        Self { _dir: dir, path }
    }

    pub(crate) fn text(&self, name: &str, text: &str) {
        self.bytes(name, text.as_bytes());
    }

    pub(crate) fn bytes(&self, name: &str, bytes: &[u8]) {
        let path = self.path.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        std::fs::write(path, bytes).unwrap();
    }

    pub(crate) fn image(&self, name: &str, image: &DynamicImage) {
        let path = self.path.join(name);
        std::fs::create_dir_all(path.parent().unwrap()).unwrap();
        image.save(path).unwrap();
    }

    pub(crate) fn image_as(&self, name: &str, image: &DynamicImage, format: ImageFormat) {
        image
            .save_with_format(self.path.join(name), format)
            .unwrap();
    }

    pub(crate) fn remove(&self, name: &str) {
        let path = self.path.join(name);
        if path.is_dir() {
            std::fs::remove_dir_all(path).unwrap();
        } else {
            std::fs::remove_file(path).unwrap();
        }
    }

    pub(crate) fn open(&self) -> Dataset {
        Dataset::open(&self.path, &OpenOptions::default()).unwrap()
    }

    /// Checks that opening fails with a message that contains all of `parts`.
    pub(crate) fn fails(&self, parts: &[&str]) {
        fails(&self.path, &OpenOptions::default(), parts);
    }
}

pub(crate) fn fails(path: &Path, options: &OpenOptions, parts: &[&str]) {
    let message = Dataset::open(path, options).unwrap_err().to_string();
    for part in parts {
        assert!(message.contains(part), "{message:?} lacks {part:?}");
    }
}
