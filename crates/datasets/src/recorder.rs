//! Writes data sets in the TUM layout.

use crate::camera::CameraModel;
use crate::error::{DatasetError, Result};
use crate::trajectory::{self, StampedPose};
use crate::write::write_atomic;
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use stillpoint_geometry::{Camera, Se3};
use stillpoint_imaging::RgbdFrame;

/// How colour images are stored.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourFormat {
    /// Without loss.
    #[default]
    Png,
    /// Small files, quality 95.
    Jpeg,
}

impl ColourFormat {
    fn extension(self) -> &'static str {
        match self {
            Self::Png => "png",
            Self::Jpeg => "jpg",
        }
    }
}

/// Values per metre of the depth images written, as in the TUM data sets.
const DEPTH_SCALE: f64 = 5000.0;
/// Quality of JPEG images, of 100.
const JPEG_QUALITY: u8 = 95;

/// Records frames and poses into a folder: `rgb/*.png` (or `.jpg`), `depth/*.png` (16 bit, 5000 per metre), `rgb.txt`,
/// `depth.txt`, `groundtruth.txt` (when there are poses) and `camera.toml`. The lists are written last, by
/// [`Recorder::finish`]: a folder without them is unfinished.
#[derive(Debug)]
pub struct Recorder {
    folder: PathBuf,
    camera: CameraModel,
    format: ColourFormat,
    rgb_list: String,
    depth_list: String,
    poses: Vec<StampedPose>,
    last_stamps: Option<(f64, f64)>,
}

impl Recorder {
    /// Starts a data set in a new or empty folder.
    ///
    /// # Errors
    /// [`DatasetError::Occupied`] when the folder holds something, [`DatasetError::Write`].
    pub fn create(
        folder: &Path,
        camera: &Camera,
        name: &str,
        format: ColourFormat,
    ) -> Result<Self> {
        if folder.exists() {
            let found = match std::fs::read_dir(folder) {
                Ok(entries) => match entries.count() {
                    0 => None,
                    n => Some(format!("{n} files or folders in it")),
                },
                Err(e) => Some(e.to_string()),
            };
            if let Some(found) = found {
                return Err(DatasetError::Occupied {
                    path: folder.to_owned(),
                    found,
                });
            }
        }
        for sub in ["rgb", "depth"] {
            let path = folder.join(sub);
            std::fs::create_dir_all(&path)
                .map_err(|source| DatasetError::Write { path, source })?;
        }
        Ok(Self {
            folder: folder.to_owned(),
            camera: CameraModel {
                name: name.to_owned(),
                camera: *camera,
                depth_scale: DEPTH_SCALE,
            },
            format,
            rgb_list: "# color images\n# timestamp filename\n".to_owned(),
            depth_list: "# depth maps\n# timestamp filename\n".to_owned(),
            poses: Vec::new(),
            last_stamps: None,
        })
    }

    /// Writes one frame, with its pose where that is known. Without a colour image the grey one is written. Depths beyond
    /// 13.1 m do not fit into 16 bits and become 0 (no measurement).
    ///
    /// # Errors
    /// [`DatasetError::StampOrder`] (the line is that of the lists) when a stamp does not ascend, [`DatasetError::Image`]
    /// when the size is not the camera's, [`DatasetError::Write`].
    pub fn add(&mut self, frame: &RgbdFrame, world_from_camera: Option<&Se3>) -> Result<()> {
        self.check_stamps(frame)?;
        let rgb_name = format!("rgb/{:.6}.{}", frame.stamp, self.format.extension());
        let depth_name = format!("depth/{:.6}.png", frame.depth_stamp);
        let (width, height) = (frame.gray.width() as u32, frame.gray.height() as u32);
        for (name, what, size) in [
            (&rgb_name, "colour", (width, height)),
            (
                &depth_name,
                "depth",
                (frame.depth.width() as u32, frame.depth.height() as u32),
            ),
        ] {
            crate::probe::check_size(&self.folder.join(name), what, &self.camera, size)?;
        }
        let (pixels, kind) = match &frame.colour {
            Some(c) => (c.data(), ExtendedColorType::Rgb8),
            None => (frame.gray.data(), ExtendedColorType::L8),
        };
        self.write_image(&rgb_name, self.format, pixels, kind, (width, height))?;
        // `image` takes 16-bit samples as bytes in the machine's order.
        let depth: Vec<u8> = frame
            .depth
            .data()
            .iter()
            .flat_map(|&z| depth_to_raw(z).to_ne_bytes())
            .collect();
        self.write_image(
            &depth_name,
            ColourFormat::Png,
            &depth,
            ExtendedColorType::L16,
            (width, height),
        )?;
        // Writing to a String cannot fail.
        let _ = writeln!(self.rgb_list, "{:.6} {rgb_name}", frame.stamp);
        let _ = writeln!(self.depth_list, "{:.6} {depth_name}", frame.depth_stamp);
        self.poses.extend(world_from_camera.map(|p| StampedPose {
            stamp: frame.stamp,
            world_from_camera: *p,
        }));
        self.last_stamps = Some((frame.stamp, frame.depth_stamp));
        Ok(())
    }

    /// Replaces the ground truth, which else holds the poses given with the frames: a denser one, as motion capture
    /// gives it.
    pub fn set_ground_truth(&mut self, poses: Vec<StampedPose>) {
        self.poses = poses;
    }

    /// Writes the lists, the ground truth and the camera.
    ///
    /// # Errors
    /// [`DatasetError::Write`].
    pub fn finish(self) -> Result<()> {
        if !self.poses.is_empty() {
            trajectory::write(&self.folder.join("groundtruth.txt"), &self.poses)?;
        }
        let write = |name: &str, text: &str| write_atomic(&self.folder.join(name), text.as_bytes());
        write("camera.toml", &self.camera.to_toml())?;
        write("depth.txt", &self.depth_list)?;
        write("rgb.txt", &self.rgb_list)
    }

    fn check_stamps(&self, frame: &RgbdFrame) -> Result<()> {
        // Stamps are written with 6 decimals and must differ in the file.
        let order = |list: &str, text: &String, previous: f64, found: f64| {
            if found - previous >= 1e-6 {
                return Ok(());
            }
            Err(DatasetError::StampOrder {
                path: self.folder.join(list),
                line: text.lines().count() + 1,
                previous,
                found,
            })
        };
        if let Some((rgb, depth)) = self.last_stamps {
            order("rgb.txt", &self.rgb_list, rgb, frame.stamp)?;
            order("depth.txt", &self.depth_list, depth, frame.depth_stamp)?;
        }
        Ok(())
    }

    fn write_image(
        &self,
        name: &str,
        format: ColourFormat,
        pixels: &[u8],
        kind: ExtendedColorType,
        (width, height): (u32, u32),
    ) -> Result<()> {
        let path = self.folder.join(name);
        let mut bytes = Vec::new();
        let encoded = match format {
            ColourFormat::Png => PngEncoder::new_with_quality(
                &mut bytes,
                CompressionType::Fast,
                FilterType::Adaptive,
            )
            .write_image(pixels, width, height, kind),
            ColourFormat::Jpeg => JpegEncoder::new_with_quality(&mut bytes, JPEG_QUALITY)
                .write_image(pixels, width, height, kind),
        };
        encoded
            .map_err(std::io::Error::other)
            .and_then(|()| std::fs::write(&path, &bytes))
            .map_err(|source| DatasetError::Write { path, source })
    }
}

/// Depth in m as stored; 0 for none and for what does not fit. 65535 is left out: it is a mark for no measurement.
fn depth_to_raw(z: f32) -> u16 {
    let raw = (f64::from(z) * DEPTH_SCALE).round();
    if raw >= 1.0 && raw < f64::from(u16::MAX) {
        raw as u16
    } else {
        0
    }
}
