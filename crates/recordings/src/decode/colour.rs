//! Decodes colour images.

use super::{Bad, Result, bayer, rows, size, yuv};
use image::DynamicImage;
use std::sync::Arc;
use stillpoint_datasets::{decode_image, image_format, image_size};
use stillpoint_imaging::{ColourImage, GrayImage};
use stillpoint_ros_messages::Image;

const KNOWN: &str = "rgb8, bgr8, rgba8, bgra8, mono8, the same of 16 bits, bayer_* of 8 or 16 bits, yuv422, yuv422_yuy2, uyvy, yuyv, nv12, nv21, nv24, i420, yv12 or mjpg";

#[derive(Clone, Debug, PartialEq)]
pub(crate) struct Colour {
    pub(crate) gray: GrayImage,
    /// `None` unless requested.
    pub(crate) colour: Option<Arc<ColourImage>>,
}

impl Colour {
    fn of_rgb(rgb: ColourImage, keep: bool) -> Self {
        Self {
            gray: rgb.to_gray(),
            colour: keep.then(|| Arc::new(rgb)),
        }
    }

    fn of_gray(gray: GrayImage, keep: bool) -> Self {
        let rgb = || {
            let data = gray.data().iter().flat_map(|v| [*v; 3]).collect();
            ColourImage::from_vec(gray.width(), gray.height(), data).ok()
        };
        let colour = if keep { rgb().map(Arc::new) } else { None };
        Self { gray, colour }
    }
}

/// Whether an encoding is one of colour or grey images.
pub(crate) fn is_colour(encoding: &str) -> bool {
    layout(encoding).is_some()
        || yuv::order(encoding).is_some()
        || bayer::mosaic(encoding).is_some()
        || has_planes(encoding)
        || is_jpeg(encoding)
}

/// Whether the stated height may count the rows of several planes.
pub(crate) fn has_planes(encoding: &str) -> bool {
    yuv::planes(encoding).is_some()
}

/// Some drivers send JPEG in raw image messages.
fn is_jpeg(encoding: &str) -> bool {
    matches!(encoding, "mjpg" | "mjpeg" | "MJPG" | "jpeg")
}

/// Number of channels, indices of red, green and blue, and bytes per channel; one channel for grey.
fn layout(encoding: &str) -> Option<(usize, [usize; 3], usize)> {
    Some(match encoding {
        "rgb8" | "8UC3/rgb" => (3, [0, 1, 2], 1),
        "bgr8" | "8UC3" => (3, [2, 1, 0], 1),
        "rgba8" => (4, [0, 1, 2], 1),
        "bgra8" | "8UC4" => (4, [2, 1, 0], 1),
        "mono8" | "8UC1" => (1, [0; 3], 1),
        "rgb16" => (3, [0, 1, 2], 2),
        "bgr16" | "16UC3" => (3, [2, 1, 0], 2),
        "rgba16" => (4, [0, 1, 2], 2),
        "bgra16" | "16UC4" => (4, [2, 1, 0], 2),
        "mono16" => (1, [0; 3], 2),
        _ => return None,
    })
}

/// Decodes a raw image. `keep`: whether colour is needed.
pub(crate) fn colour(image: &Image<'_>, keep: bool) -> Result<Colour> {
    if is_jpeg(&image.encoding) {
        return compressed_colour(&image.data, keep);
    }
    let (width, height) = size(image.width, image.height)?;
    let report = |e: stillpoint_imaging::SizeError| Bad::new("an image", e.to_string());
    if let Some(order) = yuv::order(&image.encoding) {
        let lines = rows(&image.data, image.height, image.step, 2 * width)?;
        let rgb = yuv::rgb(lines, width, height, order);
        let rgb = ColourImage::from_vec(width, height, rgb).map_err(report)?;
        return Ok(Colour::of_rgb(rgb, keep));
    }
    if let Some(planes) = yuv::planes(&image.encoding) {
        let found = planes.rgb(&image.data, (width, height), image.step as usize);
        let (rgb, height) = found.ok_or_else(|| {
            let expected = format!("{} of {width} x {height} px", image.encoding);
            let found = format!("{} bytes in rows of {}", image.data.len(), image.step);
            Bad::new(expected, found)
        })?;
        let rgb = ColourImage::from_vec(width, height, rgb).map_err(report)?;
        return Ok(Colour::of_rgb(rgb, keep));
    }
    if let Some((mosaic, bytes)) = bayer::mosaic(&image.encoding) {
        let values = channels(image, bytes, width)?.collect::<Vec<u8>>();
        let rgb = bayer::rgb(&values, width, height, mosaic);
        let rgb = ColourImage::from_vec(width, height, rgb).map_err(report)?;
        return Ok(Colour::of_rgb(rgb, keep));
    }
    let Some((count, places, bytes)) = layout(&image.encoding) else {
        return Err(Bad::new(KNOWN, format!("encoding \"{}\"", image.encoding)));
    };
    if count == 1 {
        let data = channels(image, bytes, width)?.collect();
        let gray = GrayImage::from_vec(width, height, data).map_err(report)?;
        return Ok(Colour::of_gray(gray, keep));
    }
    let pixel = count * bytes;
    let lines = rows(&image.data, image.height, image.step, pixel * width)?;
    let places = places.map(|channel| channel * bytes + significant(image, bytes));
    let mut rgb = Vec::with_capacity(3 * width * height);
    for line in lines {
        if pixel == 3 && places == [0, 1, 2] {
            rgb.extend_from_slice(line);
        } else {
            rgb.extend(
                line.chunks_exact(pixel)
                    .flat_map(|p| places.map(|at| p[at])),
            );
        }
    }
    let rgb = ColourImage::from_vec(width, height, rgb).map_err(report)?;
    Ok(Colour::of_rgb(rgb, keep))
}

/// Offset of the more significant of two bytes.
fn significant(image: &Image<'_>, bytes: usize) -> usize {
    usize::from(bytes == 2 && image.is_bigendian == 0)
}

/// The more significant byte of each pixel of a single-channel image.
fn channels<'i>(
    image: &'i Image<'_>,
    bytes: usize,
    width: usize,
) -> Result<impl Iterator<Item = u8> + 'i> {
    let at = significant(image, bytes);
    let lines = rows(&image.data, image.height, image.step, bytes * width)?;
    Ok(lines.flat_map(move |row| row.chunks_exact(bytes).map(move |p| p[at])))
}

pub(super) fn decode(data: &[u8], expected: &str) -> Result<DynamicImage> {
    let Some(format) = image_format(data) else {
        let found = format!("{} bytes of another format", data.len());
        return Err(Bad::new(expected, found));
    };
    decode_image(data, format)
        .map_err(|why| Bad::new(expected, format!("a broken {format:?} image ({why})")))
}

/// Width and height from the header of a compressed image, if valid.
pub(crate) fn stated_size(data: &[u8]) -> Option<(u32, u32)> {
    image_size(data, image_format(data)?).ok()
}

pub(crate) fn compressed_colour(data: &[u8], keep: bool) -> Result<Colour> {
    let image = decode(data, "a PNG, JPEG or WebP image")?;
    let (width, height) = (image.width() as usize, image.height() as usize);
    let report = |e: stillpoint_imaging::SizeError| Bad::new("an image", e.to_string());
    match image {
        DynamicImage::ImageLuma8(gray) => {
            let gray = GrayImage::from_vec(width, height, gray.into_raw()).map_err(report)?;
            Ok(Colour::of_gray(gray, keep))
        }
        other => {
            let rgb = other.into_rgb8().into_raw();
            let rgb = ColourImage::from_vec(width, height, rgb).map_err(report)?;
            Ok(Colour::of_rgb(rgb, keep))
        }
    }
}
