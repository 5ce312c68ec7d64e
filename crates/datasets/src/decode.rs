//! Decodes image files: colour to grey, depth to metres.

use crate::error::{DatasetError, Result};
use crate::picture::{LARGEST_FILE, decode_image, image_format, image_size};
use crate::regular::read_regular;
use image::{ColorType, DynamicImage, ImageFormat};
use std::path::Path;
use stillpoint_imaging::{ColourImage, DepthImage, GrayImage};

const COLOUR_EXPECTED: &str = "a PNG, JPEG or WebP image";
const DEPTH_EXPECTED: &str = "a 16-bit grey PNG with depth";

fn bad(path: &Path, expected: &str, found: impl Into<String>, advice: &str) -> DatasetError {
    DatasetError::Image {
        path: path.to_owned(),
        expected: expected.to_owned(),
        found: found.into(),
        advice: advice.to_owned(),
    }
}

/// Bytes and format of a non-empty image file of a supported format.
fn load(path: &Path, expected: &str) -> Result<(Vec<u8>, ImageFormat)> {
    const AGAIN: &str = "copy or export the file again, or take it off the list";
    let bytes = read_regular(path, LARGEST_FILE).map_err(|source| match source.kind() {
        std::io::ErrorKind::NotFound => bad(path, expected, "no such file", AGAIN),
        // The error describes the object found: no regular file.
        std::io::ErrorKind::Other => bad(path, expected, source.to_string(), AGAIN),
        // The error is not about the file: too many open files, for example.
        _ => DatasetError::Read {
            path: path.to_owned(),
            source,
        },
    })?;
    if bytes.is_empty() {
        return Err(bad(path, expected, "an empty file (0 bytes)", AGAIN));
    }
    match image_format(&bytes) {
        Some(format) => Ok((bytes, format)),
        None => {
            let found = other_format(&bytes).map_or("bytes of an unknown format".to_owned(), |f| {
                format!("a file in the format {f}")
            });
            Err(bad(path, expected, found, "convert the images"))
        }
    }
}

/// Names of unsupported formats in which depth or colour are sometimes stored.
fn other_format(bytes: &[u8]) -> Option<&'static str> {
    let known: [(&[u8], &str); 8] = [
        (b"\x76\x2f\x31\x01", "OpenEXR (float)"),
        (b"II*\0", "TIFF"),
        (b"MM\0*", "TIFF"),
        (b"Pf", "PFM (float)"),
        (b"P5", "PGM"),
        (b"P6", "PPM"),
        (b"\x93NUMPY", "NumPy"),
        (b"BM", "BMP"),
    ];
    known
        .iter()
        .find(|(magic, _)| bytes.starts_with(magic))
        .map(|k| k.1)
}

/// An image file, read but not decoded.
pub(crate) struct Picture<'a> {
    path: &'a Path,
    expected: &'static str,
    bytes: Vec<u8>,
    format: ImageFormat,
}

impl<'a> Picture<'a> {
    pub(crate) fn of_colour(path: &'a Path) -> Result<Self> {
        Self::open(path, COLOUR_EXPECTED)
    }

    pub(crate) fn of_depth(path: &'a Path) -> Result<Self> {
        Self::open(path, DEPTH_EXPECTED)
    }

    fn open(path: &'a Path, expected: &'static str) -> Result<Self> {
        let (bytes, format) = load(path, expected)?;
        Ok(Self {
            path,
            expected,
            bytes,
            format,
        })
    }

    fn bad(&self, found: impl Into<String>, advice: &str) -> DatasetError {
        bad(self.path, self.expected, found, advice)
    }

    fn broken(&self, why: &str) -> DatasetError {
        let found = format!(
            "a broken or truncated file of {} bytes ({why})",
            self.bytes.len()
        );
        let advice = "copy or export the file again, or take it off the list";
        self.bad(found, advice)
    }

    /// Width and height, px, from its header.
    pub(crate) fn size(&self) -> Result<(u32, u32)> {
        image_size(&self.bytes, self.format).map_err(|why| self.broken(&why))
    }

    fn decode(&self) -> Result<DynamicImage> {
        decode_image(&self.bytes, self.format).map_err(|why| self.broken(&why))
    }

    pub(crate) fn colour(&self) -> Result<ColourImage> {
        self.rgb(self.decode()?)
    }

    fn rgb(&self, image: DynamicImage) -> Result<ColourImage> {
        let rgb = image.into_rgb8();
        let (w, h) = (rgb.width() as usize, rgb.height() as usize);
        ColourImage::from_vec(w, h, rgb.into_raw())
            .map_err(|e| self.bad(e.to_string(), "report this"))
    }

    pub(crate) fn gray(&self) -> Result<GrayImage> {
        match self.decode()? {
            DynamicImage::ImageLuma8(gray) => {
                let (w, h) = (gray.width() as usize, gray.height() as usize);
                GrayImage::from_vec(w, h, gray.into_raw())
                    .map_err(|e| self.bad(e.to_string(), "report this"))
            }
            other => self.rgb(other).map(|colour| colour.to_gray()),
        }
    }

    pub(crate) fn depth(&self, depth_scale: f64) -> Result<DepthImage> {
        let advice = "export depth as 16-bit PNG (TUM: 5000 per metre)";
        if self.format != ImageFormat::Png {
            return Err(self.bad(format!("{:?}", self.format), advice));
        }
        let image = self.decode()?;
        let kind = image.color();
        let DynamicImage::ImageLuma16(raw) = image else {
            return Err(self.bad(describe(kind), advice));
        };
        let (w, h) = (raw.width() as usize, raw.height() as usize);
        let to_metres = |v: &u16| {
            // One rounding: the quotient in f64, then f32. 0 stays 0.
            let depth = (f64::from(*v) / depth_scale) as f32;
            if *v == u16::MAX { 0.0 } else { depth }
        };
        DepthImage::from_vec(w, h, raw.as_raw().iter().map(to_metres).collect())
            .map_err(|e| self.bad(e.to_string(), "report this"))
    }
}

/// Reads an image (PNG, JPEG, WebP; 8 or 16 bits; grey or colour, transparency ignored) as RGB.
///
/// # Errors
/// [`DatasetError::Image`] for a missing, empty or truncated file, or another format.
pub fn read_colour(path: &Path) -> Result<ColourImage> {
    Picture::of_colour(path)?.colour()
}

/// Reads an image like [`read_colour`], as grey: 8-bit grey files unchanged, others by [`ColourImage::to_gray`].
///
/// # Errors
/// As [`read_colour`].
pub fn read_gray(path: &Path) -> Result<GrayImage> {
    Picture::of_colour(path)?.gray()
}

/// Reads a 16-bit grey PNG of `depth_scale` values per metre as metres. The values 0 and 65535 mean no measurement (65535 is the mark of
/// 7-Scenes, and saturation elsewhere).
///
/// # Errors
/// [`DatasetError::Image`] for a missing, empty or truncated file, or any other format.
pub fn read_depth(path: &Path, depth_scale: f64) -> Result<DepthImage> {
    Picture::of_depth(path)?.depth(depth_scale)
}

fn describe(kind: ColorType) -> String {
    let bits = kind.bits_per_pixel() / u16::from(kind.channel_count().max(1));
    let what = if kind.has_color() { "colour" } else { "grey" };
    let alpha = if kind.has_alpha() {
        " with transparency"
    } else {
        ""
    };
    format!("an {bits}-bit {what} PNG{alpha}").replace("an 16", "a 16")
}
