//! Writes data sets in the TUM layout.

use crate::camera::CameraModel;
use crate::error::{DatasetError, Result};
use crate::trajectory::{self, StampedPose};
use crate::write::write_atomic;
use crate::{imu, odometry};
use image::codecs::jpeg::JpegEncoder;
use image::codecs::png::{CompressionType, FilterType, PngEncoder};
use image::{ExtendedColorType, ImageEncoder};
use std::fmt::Write;
use std::path::{Path, PathBuf};
use stillpoint_geometry::{Camera, ImuModel, OdometryModel, Se3};
use stillpoint_imaging::{GrayImage, ImuSample, OdometrySample, RgbdFrame};

/// Format of colour images.
#[derive(Clone, Copy, Debug, Default, PartialEq, Eq)]
pub enum ColourFormat {
    /// Lossless.
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

/// Values per metre of the written depth images, as in the TUM data sets.
const DEPTH_SCALE: f64 = 5000.0;
const JPEG_QUALITY: u8 = 95;

/// The bounding box of the visible part of a mover: a row of `boxes.csv`.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MoverRow {
    /// Its number, from 1, as in the mask.
    pub mover: u32,
    /// Left, upper, right and lower border, px; pixel (0, 0) extends from -0.5 to 0.5.
    pub bounds: [f64; 4],
    /// Number of its pixels in the mask.
    pub visible_px: usize,
    /// Its position in the world, m.
    pub position: [f64; 3],
    /// Its velocity in the world, m/s.
    pub velocity: [f64; 3],
}

const BOXES_HEADER: &str = "timestamp,mover,x0,y0,x1,y1,visible_px,px,py,pz,vx,vy,vz\n";

/// Records frames and poses into a folder: `rgb/*.png` (or `.jpg`), `depth/*.png` (16 bit, 5000 per metre), `rgb.txt`, `depth.txt`,
/// `groundtruth.txt` (if there are poses) and `camera.toml`; for known movers `mask/*.png` and `boxes.csv`; for an inertial sensor
/// `imu.csv`, for odometry `odometry.csv`. [`Recorder::finish`] writes the lists last: a folder without them is incomplete.
#[derive(Debug)]
pub struct Recorder {
    folder: PathBuf,
    camera: CameraModel,
    format: ColourFormat,
    rgb_list: String,
    depth_list: String,
    poses: Vec<StampedPose>,
    last_stamps: Option<(f64, f64)>,
    /// Rows of `boxes.csv`; `None` before the first mask.
    boxes: Option<String>,
    samples: Vec<ImuSample>,
    stands: Vec<OdometrySample>,
}

impl Recorder {
    /// Starts a data set in a new or empty folder.
    ///
    /// # Errors
    /// [`DatasetError::Occupied`] for a folder that is not empty, [`DatasetError::Write`].
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
                nominal: false,
                imu: None,
                odometry: None,
            },
            format,
            rgb_list: "# color images\n# timestamp filename\n".to_owned(),
            depth_list: "# depth maps\n# timestamp filename\n".to_owned(),
            poses: Vec::new(),
            last_stamps: None,
            boxes: None,
            samples: Vec::new(),
            stands: Vec::new(),
        })
    }

    /// Writes one frame, with its pose if known. Without a colour image the grey one is written. Depths beyond 13.1 m do not fit into 16
    /// bits and become 0 (no measurement).
    ///
    /// # Errors
    /// [`DatasetError::StampOrder`] (with the line of the list) for a stamp that does not ascend, [`DatasetError::Image`] for another size
    /// than the camera's, [`DatasetError::Write`].
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

    /// Writes the movers in the frame of a colour stamp (s): the mask (0 for static, else the mover's number) as `mask/` and the stamp, and
    /// the boxes as rows of `boxes.csv`.
    ///
    /// # Errors
    /// [`DatasetError::Image`] for another size than the camera's, [`DatasetError::Write`].
    pub fn add_movers(&mut self, stamp: f64, mask: &GrayImage, movers: &[MoverRow]) -> Result<()> {
        if self.boxes.is_none() {
            let path = self.folder.join("mask");
            std::fs::create_dir_all(&path)
                .map_err(|source| DatasetError::Write { path, source })?;
        }
        let name = format!("mask/{stamp:.6}.png");
        let size = (mask.width() as u32, mask.height() as u32);
        crate::probe::check_size(&self.folder.join(&name), "mask", &self.camera, size)?;
        let kind = ExtendedColorType::L8;
        self.write_image(&name, ColourFormat::Png, mask.data(), kind, size)?;
        let rows = self.boxes.get_or_insert_with(|| BOXES_HEADER.to_owned());
        for row in movers {
            let [x0, y0, x1, y1] = row.bounds;
            let ([px, py, pz], [vx, vy, vz]) = (row.position, row.velocity);
            // Writing to a String cannot fail.
            let _ = writeln!(
                rows,
                "{stamp:.6},{},{x0:.1},{y0:.1},{x1:.1},{y1:.1},{},{px:.4},{py:.4},{pz:.4},{vx:.4},{vy:.4},{vz:.4}",
                row.mover, row.visible_px
            );
        }
        Ok(())
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
        if let Some(boxes) = &self.boxes {
            write("boxes.csv", boxes)?;
        }
        if self.camera.imu.is_some() {
            write(imu::FILE, &imu::to_text(&self.samples))?;
        }
        if self.camera.odometry.is_some() {
            write(odometry::FILE, &odometry::to_text(&self.stands))?;
        }
        write("camera.toml", &self.camera.to_toml())?;
        write("depth.txt", &self.depth_list)?;
        write("rgb.txt", &self.rgb_list)
    }

    /// Sets the inertial sensor, whose samples are then written.
    #[must_use]
    pub fn with_imu(mut self, model: ImuModel) -> Self {
        self.camera.imu = Some(model);
        self
    }

    /// Adds inertial samples in time order; ignored without [`Recorder::with_imu`].
    pub fn add_inertial(&mut self, samples: &[ImuSample]) {
        self.samples.extend_from_slice(samples);
    }

    /// Sets the odometry, whose samples are then written.
    #[must_use]
    pub fn with_odometry(mut self, model: OdometryModel) -> Self {
        self.camera.odometry = Some(model);
        self
    }

    /// Adds odometry samples in time order; ignored without [`Recorder::with_odometry`].
    pub fn add_odometry(&mut self, samples: &[OdometrySample]) {
        self.stands.extend_from_slice(samples);
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

/// Depth in m as stored; 0 for none and for values out of range. 65535 is avoided, as it marks missing measurements.
fn depth_to_raw(z: f32) -> u16 {
    let raw = (f64::from(z) * DEPTH_SCALE).round();
    if raw >= 1.0 && raw < f64::from(u16::MAX) {
        raw as u16
    } else {
        0
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn masks_have_the_camera_size_and_boxes_are_listed() {
        let dir = tempfile::tempdir().unwrap();
        let camera = Camera::pinhole(64, 48, [50.0, 50.0, 31.5, 23.5]);
        let mut r = Recorder::create(dir.path(), &camera, "toy", ColourFormat::Png).unwrap();
        let e = r.add_movers(0.5, &GrayImage::new(64, 47), &[]).unwrap_err();
        assert!(e.to_string().contains("mask/0.500000.png"), "{e}");
        let mut mask = GrayImage::new(64, 48);
        mask.data_mut()[64 + 3] = 2;
        let row = MoverRow {
            mover: 2,
            bounds: [2.5, 0.5, 3.5, 1.5],
            visible_px: 1,
            position: [1.0, -0.25, 2.0],
            velocity: [0.5, 0.0, -0.125],
        };
        r.add_movers(0.5, &mask, &[row]).unwrap();
        r.add_movers(0.6, &GrayImage::new(64, 48), &[]).unwrap();
        r.finish().unwrap();
        let boxes = std::fs::read_to_string(dir.path().join("boxes.csv")).unwrap();
        assert_eq!(
            boxes,
            format!(
                "{BOXES_HEADER}0.500000,2,2.5,0.5,3.5,1.5,1,1.0000,-0.2500,2.0000,0.5000,0.0000,-0.1250\n"
            )
        );
        let image = image::open(dir.path().join("mask/0.500000.png")).unwrap();
        assert_eq!(image.into_luma8().as_raw(), mask.data());
        assert!(dir.path().join("mask/0.600000.png").exists());
    }
}
