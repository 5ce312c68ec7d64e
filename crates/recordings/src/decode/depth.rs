//! Depth images.

use super::colour::decode;
use super::{Bad, Result, rows, rvl, size};
use image::DynamicImage;
use stillpoint_imaging::DepthImage;
use stillpoint_ros_messages::Image;

/// Whether an encoding is one of depth images.
pub(crate) fn is_depth(encoding: &str) -> bool {
    matches!(encoding, "16UC1" | "mono16" | "32FC1" | "Z16" | "z16")
}

/// Values per metre where the encoding leaves it open: millimetres, by REP 118.
pub(crate) const MILLIMETRES: f64 = 1000.0;

fn finish(width: usize, height: usize, data: Vec<f32>) -> Result<DepthImage> {
    DepthImage::from_vec(width, height, data).map_err(|e| Bad::new("a depth image", e.to_string()))
}

/// Metres of a value; 0 and 65535 stand for no measurement. Rounded once, as depth files are.
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

/// What is no distance becomes none.
fn sound(z: f32) -> f32 {
    if z.is_finite() && z > 0.0 { z } else { 0.0 }
}

/// A raw image of `scale` values per metre, or of metres as floats.
pub(crate) fn depth(image: &Image<'_>, scale: f64) -> Result<DepthImage> {
    let (width, height) = size(image.width, image.height)?;
    let big = image.is_bigendian != 0;
    match image.encoding.as_ref() {
        "32FC1" => {
            let lines = rows(&image.data, image.height, image.step, 4 * width)?;
            let value = |b: &[u8]| {
                let b = b.try_into().unwrap_or_default();
                sound(if big {
                    f32::from_be_bytes(b)
                } else {
                    f32::from_le_bytes(b)
                })
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

/// Bytes before the image: what it is, and two parameters.
const HEAD: usize = 12;

/// Width and height of such an image by its head, where that reads.
pub(crate) fn stated_size(format: &str, data: &[u8]) -> Option<(u32, u32)> {
    let body = data.get(HEAD..)?;
    if is_rvl(format) {
        let word = |at: usize| Some(u32::from_le_bytes(body.get(at..at + 4)?.try_into().ok()?));
        return word(0).zip(word(4));
    }
    super::stated_size(body)
}

fn is_rvl(format: &str) -> bool {
    format.to_lowercase().contains("rvl")
}

/// An image of compressed_depth_image_transport: PNG or RVL after twelve bytes. `format` is the message's; where it says 32FC1, values are those
/// of inverse depth, `a / (value - b)`.
pub(crate) fn compressed_depth(format: &str, data: &[u8], scale: f64) -> Result<DepthImage> {
    const EXPECTED: &str = "12 bytes and a 16-bit grey PNG, or RVL";
    let short = || Bad::new(EXPECTED, format!("{} bytes", data.len()));
    let (head, body) = data.split_at_checked(HEAD).ok_or_else(short)?;
    let number =
        |at: usize| f32::from_le_bytes([head[at], head[at + 1], head[at + 2], head[at + 3]]);
    let (width, height, raw) = if is_rvl(format) {
        let (w, h) = stated_size(format, data).ok_or_else(short)?;
        let (width, height) = size(w, h)?;
        // A pixel takes an eighth of half a byte at least, but for runs of zeros, which take none.
        let raw = rvl::decode(&body[8..], width * height);
        let raw =
            raw.ok_or_else(|| Bad::new(EXPECTED, format!("broken RVL of {width} x {height} px")))?;
        (width, height, raw)
    } else {
        let DynamicImage::ImageLuma16(png) = decode(body, EXPECTED)? else {
            return Err(Bad::new(EXPECTED, "an image of another kind"));
        };
        let (w, h) = (png.width() as usize, png.height() as usize);
        (w, h, png.into_raw())
    };
    let data = if format.trim_start().starts_with("32FC1") {
        let (a, b) = (number(4), number(8));
        let metres = |raw: &u16| {
            if *raw == 0 {
                0.0
            } else {
                sound(a / (f32::from(*raw) - b))
            }
        };
        raw.iter().map(metres).collect()
    } else {
        let table = table(scale);
        raw.iter().map(|raw| table[usize::from(*raw)]).collect()
    };
    finish(width, height, data)
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
    fn padded_rows_and_marks_of_no_measurement() {
        let padded = image("16UC1", 6, &[0xe8, 3, 0, 0, 9, 9, 0xff, 0xff, 0xd0, 7]);
        let found = depth(&padded, 1000.0).unwrap();
        assert_eq!(found.data(), [1.0, 0.0, 0.0, 2.0]);
        let short = image("16UC1", 4, &[0; 7]);
        assert!(depth(&short, 1000.0).unwrap_err().found.contains("7 bytes"));
        let values = [1.5, f32::NAN, -1.0, f32::INFINITY].map(f32::to_le_bytes);
        let found = depth(&image("32FC1", 8, &values.concat()), 1000.0).unwrap();
        assert_eq!(found.data(), [1.5, 0.0, 0.0, 0.0]);
    }

    #[test]
    fn inverse_depth_is_read() {
        let mut bytes = vec![0; 4];
        bytes.extend(100.0_f32.to_le_bytes());
        bytes.extend(10.0_f32.to_le_bytes());
        // One pixel by RVL: no zeros, one value of 60 (coded 120 = 0 + 7 * 8 + 1 * 64).
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(1_u32.to_le_bytes());
        bytes.extend(0x018f_1000_u32.to_le_bytes());
        let found = compressed_depth("32FC1; compressedDepth rvl", &bytes, 1000.0).unwrap();
        assert_eq!(found.data(), [2.0]);
    }
}
