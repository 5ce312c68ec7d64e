//! Decodes depth images.

use super::colour::decode;
use super::{Bad, Result, rows, size};
use image::DynamicImage;
use stillpoint_imaging::{DepthImage, rvl};
use stillpoint_ros_messages::Image;

pub(crate) fn is_depth(encoding: &str) -> bool {
    matches!(encoding, "16UC1" | "mono16" | "32FC1" | "Z16" | "z16")
}

#[derive(Clone, Copy, Debug, PartialEq)]
pub(crate) struct Unit {
    pub(crate) whole: f64,
    pub(crate) float: f64,
}

impl Default for Unit {
    /// Millimetres and metres, by REP 118.
    fn default() -> Self {
        Self {
            whole: 1000.0,
            float: 1.0,
        }
    }
}

impl Unit {
    /// The values per metre for this encoding.
    pub(crate) fn of(&self, encoding: &str) -> f64 {
        if is_float(encoding) {
            self.float
        } else {
            self.whole
        }
    }
}

/// Whether an encoding, or the format of a compressed image, holds floats.
pub(crate) fn is_float(encoding: &str) -> bool {
    encoding.trim_start().starts_with("32FC1")
}

fn finish(width: usize, height: usize, data: Vec<f32>) -> Result<DepthImage> {
    DepthImage::from_vec(width, height, data).map_err(|e| Bad::new("a depth image", e.to_string()))
}

/// Metres of a value; 0 and 65535 mean no measurement. Rounded once, as in depth files.
fn metres(raw: u16, scale: f64) -> f32 {
    if raw == u16::MAX {
        0.0
    } else {
        (f64::from(raw) / scale) as f32
    }
}

/// Metres by value: a table is faster than the division.
fn table(scale: f64) -> Vec<f32> {
    (0..=u16::MAX).map(|raw| metres(raw, scale)).collect()
}

/// Metres of a float; invalid values become no measurement.
fn float_metres(z: f32, scale: f64) -> f32 {
    if z.is_finite() && z > 0.0 {
        (f64::from(z) / scale) as f32
    } else {
        0.0
    }
}

pub(crate) fn depth(image: &Image<'_>, unit: Unit) -> Result<DepthImage> {
    let (width, height) = size(image.width, image.height)?;
    let scale = unit.of(&image.encoding);
    let big = image.is_bigendian != 0;
    match image.encoding.as_ref() {
        "32FC1" => {
            let lines = rows(&image.data, image.height, image.step, 4 * width)?;
            let value = |b: &[u8]| {
                let b = b.try_into().unwrap_or_default();
                float_metres(
                    if big {
                        f32::from_be_bytes(b)
                    } else {
                        f32::from_le_bytes(b)
                    },
                    scale,
                )
            };
            let data = lines.flat_map(|r| r.chunks_exact(4).map(value));
            finish(width, height, data.collect())
        }
        encoding if is_depth(encoding) => {
            let lines = rows(&image.data, image.height, image.step, 2 * width)?;
            let table = table(scale);
            let mut data = Vec::with_capacity(width * height);
            for line in lines {
                data.extend(line.chunks_exact(2).map(|b| {
                    let b = [b[0], b[1]];
                    let raw = if big {
                        u16::from_be_bytes(b)
                    } else {
                        u16::from_le_bytes(b)
                    };
                    table[usize::from(raw)]
                }));
            }
            finish(width, height, data)
        }
        other => Err(Bad::new("16UC1 or 32FC1", format!("encoding \"{other}\""))),
    }
}

/// Size of the header before the image: format and two parameters.
const HEAD: usize = 12;
const PNG: &[u8] = b"\x89PNG";
const JPEG: &[u8] = &[0xff, 0xd8, 0xff];
/// Maximum side of an image, px: larger values mean that a header is present.
const MAX_SIDE: u32 = 1 << 15;

/// Stated width and height of a compressed depth image, if any.
pub(crate) fn stated_size(format: &str, data: &[u8]) -> Option<(u32, u32)> {
    let (_, image) = head(format, data).ok()?;
    if is_rvl(format) {
        return two_words(image).map(|[w, h]| (w, h));
    }
    super::stated_size(image)
}

fn two_words(bytes: &[u8]) -> Option<[u32; 2]> {
    let word = |at: usize| Some(u32::from_le_bytes(bytes.get(at..at + 4)?.try_into().ok()?));
    Some([word(0)?, word(4)?])
}

/// Splits off the header of a compressed depth image, if there is one. Some programs write the image alone: the second integer of the
/// header is 0, or a float that is no valid size.
fn head<'d>(format: &str, data: &'d [u8]) -> Result<(Option<&'d [u8]>, &'d [u8])> {
    let is_size = |[w, h]: [u32; 2]| (1..=MAX_SIDE).contains(&w) && (1..=MAX_SIDE).contains(&h);
    let is_alone = if is_rvl(format) {
        two_words(data).is_some_and(is_size)
    } else {
        data.starts_with(PNG) || data.starts_with(JPEG)
    };
    if is_alone {
        return Ok((None, data));
    }
    let parts = data.split_at_checked(HEAD);
    let (head, image) =
        parts.ok_or_else(|| Bad::new(COMPRESSED, format!("{} bytes", data.len())))?;
    Ok((Some(head), image))
}

fn is_rvl(format: &str) -> bool {
    format.to_lowercase().contains("rvl")
}

const COMPRESSED: &str = "a 16-bit grey PNG or RVL, after 12 bytes or alone";

/// Whether a compressed image is depth: by its `image_transport` format, or because it is a 16-bit grey PNG.
pub(crate) fn is_compressed_depth(format: &str) -> bool {
    let pixels = format.split(';').next().unwrap_or_default().trim();
    format.contains("compressedDepth") || matches!(pixels, "16UC1" | "32FC1")
}

/// Whether bytes begin as a PNG of one channel of 16 bits.
pub(crate) fn is_deep_png(data: &[u8]) -> bool {
    // Signature, length and name of the first chunk, width, height; then bit depth and colour type.
    data.starts_with(PNG) && data.get(24..26) == Some(&[16, 0])
}

fn whole_numbers(format: &str, image: &[u8]) -> Result<(usize, usize, Vec<u16>)> {
    if is_rvl(format) {
        let short = || Bad::new(COMPRESSED, format!("{} bytes", image.len()));
        let [w, h] = two_words(image).ok_or_else(short)?;
        let (width, height) = size(w, h)?;
        // A pixel takes at least an eighth of half a byte, except in runs of zeros.
        let mut raw = Vec::new();
        rvl::decode(&image[8..], width * height, &mut raw)
            .ok_or_else(|| Bad::new(COMPRESSED, format!("broken RVL of {width} x {height} px")))?;
        return Ok((width, height, raw));
    }
    match decode(image, COMPRESSED)? {
        DynamicImage::ImageLuma16(png) => {
            let (w, h) = (png.width() as usize, png.height() as usize);
            Ok((w, h, png.into_raw()))
        }
        other => {
            let color = other.color();
            let bits = color.bits_per_pixel() / u16::from(color.channel_count().max(1));
            let found = format!(
                "an image of {} channels of {bits} bits, in which no distance is left; record depth raw, as compressedDepth, or with the compressed transport set to png",
                color.channel_count()
            );
            Err(Bad::new(COMPRESSED, found))
        }
    }
}

/// Decodes an image of compressed_depth_image_transport, PNG or RVL after twelve bytes, or of another program without these. `format` is
/// the message's; for 32FC1 the values are inverse depth, `a / (value - b)`.
pub(crate) fn compressed_depth(format: &str, data: &[u8], unit: Unit) -> Result<DepthImage> {
    let (head, image) = head(format, data)?;
    let scale = unit.of(format);
    if !is_float(format) {
        let (width, height, raw) = whole_numbers(format, image)?;
        let table = table(scale);
        let data = raw.iter().map(|raw| table[usize::from(*raw)]);
        return finish(width, height, data.collect());
    }
    let head = head.ok_or_else(|| {
        Bad::new(
            "12 bytes before an image of 32FC1, which say how it was compressed",
            "none of them, so that the distances are lost; record raw images, or 16UC1",
        )
    })?;
    let (width, height, raw) = whole_numbers(format, image)?;
    let number =
        |at: usize| f32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (a, b) = (number(4), number(8));
    let metres = |raw: &u16| match raw {
        0 => 0.0,
        raw => float_metres(a / (f32::from(*raw) - b), scale),
    };
    finish(width, height, raw.iter().map(metres).collect())
}

#[cfg(test)]
mod tests {
    use super::*;

    fn image(encoding: &'static str, step: u32, data: &[u8]) -> Image<'static> {
        Image {
            height: 2,
            width: 2,
            encoding: encoding.into(),
            step,
            data: data.to_vec().into(),
            ..Image::default()
        }
    }

    #[test]
    fn row_padding_and_invalid_depths_are_handled() {
        let padded = image("16UC1", 6, &[0xe8, 3, 0, 0, 9, 9, 0xff, 0xff, 0xd0, 7]);
        let found = depth(&padded, Unit::default()).unwrap();
        assert_eq!(found.data(), [1.0, 0.0, 0.0, 2.0]);
        let short = image("16UC1", 4, &[0; 7]);
        assert!(
            depth(&short, Unit::default())
                .unwrap_err()
                .found
                .contains("7 bytes")
        );
        let values = [1.5, f32::NAN, -1.0, f32::INFINITY].map(f32::to_le_bytes);
        let found = depth(&image("32FC1", 8, &values.concat()), Unit::default()).unwrap();
        assert_eq!(found.data(), [1.5, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn float_depth_scale_is_applied() {
        let values = [1500.0_f32, 250.0, 0.0, 2000.0].map(f32::to_le_bytes);
        let unit = Unit {
            float: 1000.0,
            ..Unit::default()
        };
        let found = depth(&image("32FC1", 8, &values.concat()), unit).unwrap();
        assert_eq!(found.data(), [1.5, 0.25, 0.0, 2.0]);
        // The scale of floats does not affect integers.
        let found = depth(&image("16UC1", 4, &[0xe8, 3, 0, 0, 0, 0, 0, 0]), unit).unwrap();
        assert_eq!(found.data(), [1.0, 0.0, 0.0, 0.0]);
    }

    fn encoded(image: &DynamicImage, format: image::ImageFormat) -> Vec<u8> {
        let mut bytes = std::io::Cursor::new(Vec::new());
        image.write_to(&mut bytes, format).unwrap();
        bytes.into_inner()
    }

    #[test]
    fn compressed_depth_is_read_with_and_without_header() {
        let deep = image::ImageBuffer::from_raw(2, 1, vec![1000_u16, 2500]).unwrap();
        let deep = DynamicImage::ImageLuma16(deep);
        let alone = encoded(&deep, image::ImageFormat::Png);
        assert!(is_deep_png(&alone) && !is_deep_png(&alone[..20]));
        let after = [&[0; HEAD][..], &alone].concat();
        for (format, bytes) in [
            ("16UC1; png compressed ", &alone),
            ("16UC1; compressedDepth png", &alone),
            ("16UC1; compressedDepth", &after),
        ] {
            let found = compressed_depth(format, bytes, Unit::default()).unwrap();
            assert_eq!(found.data(), [1.0, 2.5], "{format}");
        }
        let lost = compressed_depth("32FC1; compressedDepth", &alone, Unit::default());
        assert!(lost.unwrap_err().found.contains("record raw images"));
        for format in [image::ImageFormat::Png, image::ImageFormat::Jpeg] {
            let flat = encoded(&DynamicImage::new_luma8(2, 1), format);
            let lost = compressed_depth("16UC1; jpeg compressed ", &flat, Unit::default());
            let said = lost.unwrap_err().found;
            let parts = ["8 bits", "compressedDepth"];
            assert!(parts.iter().all(|p| said.contains(p)), "{said}");
        }
        // RVL: one pixel of the value 60, with and without the header.
        let rvl = [1_u32, 1, 0x018f_1000].map(u32::to_le_bytes).concat();
        for head in [0, HEAD] {
            let bytes = [&vec![0; head][..], &rvl].concat();
            let found = compressed_depth("16UC1; compressedDepth rvl", &bytes, Unit::default());
            assert_eq!(found.unwrap().data(), [0.06], "{head}");
        }
    }

    #[test]
    fn inverse_depth_is_decoded() {
        let mut bytes = vec![0; 4];
        bytes.extend(100.0_f32.to_le_bytes());
        bytes.extend(10.0_f32.to_le_bytes());
        // One pixel by RVL: no zeros, one value of 60 (coded 120 = 0 + 7 * 8 + 1 * 64).
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(0x018f_1000_u32.to_le_bytes());
        let found =
            compressed_depth("32FC1; compressedDepth rvl", &bytes, Unit::default()).unwrap();
        assert_eq!(found.data(), [2.0]);
    }
}
