//! Decodes images from files and messages. The bytes are untrusted: sizes are checked before any allocation, unneeded parts are not
//! decompressed, and truncated images are rejected.

use image::{DynamicImage, ImageFormat, ImageReader};
use std::borrow::Cow;
use std::io::Cursor;

/// Maximum number of pixels of an image, that of 8K video: with intermediate data it takes some hundred megabytes.
pub const MOST_PIXELS: u64 = 1 << 25;
/// Maximum number of pixels of a row or column: four times those of 8K.
const LONGEST_SIDE: u32 = 1 << 15;
/// Maximum size of an image file, bytes: that many noisy pixels of eight bytes each, as in 16-bit RGBA.
pub(crate) const LARGEST_FILE: u64 = 1 << 28;

/// The format of an image, if supported: PNG, JPEG or WebP.
#[must_use]
pub fn image_format(bytes: &[u8]) -> Option<ImageFormat> {
    let format = image::guess_format(bytes).ok()?;
    let read = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP];
    read.contains(&format).then_some(format)
}

/// Width and height, px, from the header of an image.
///
/// # Errors
/// An invalid header, or a size beyond [`MOST_PIXELS`].
pub fn image_size(bytes: &[u8], format: ImageFormat) -> Result<(u32, u32), String> {
    size_of(&needed(bytes, format), format)
}

fn size_of(bytes: &[u8], format: ImageFormat) -> Result<(u32, u32), String> {
    let reader = ImageReader::with_format(Cursor::new(bytes), format);
    let (width, height) = reader.into_dimensions().map_err(|e| e.to_string())?;
    let pixels = u64::from(width) * u64::from(height);
    if pixels == 0 || pixels > MOST_PIXELS || width.max(height) > LONGEST_SIDE {
        return Err(format!(
            "{width} x {height} px, where 1 to {MOST_PIXELS} pixels are read"
        ));
    }
    Ok((width, height))
}

/// Decodes a complete image.
///
/// # Errors
/// A description of the problem.
pub fn decode_image(bytes: &[u8], format: ImageFormat) -> Result<DynamicImage, String> {
    let bytes = needed(bytes, format);
    size_of(&bytes, format)?;
    if format == ImageFormat::Jpeg && !jpeg_is_whole(&bytes) {
        return Err("cut off: no end of image marker".to_owned());
    }
    if format == ImageFormat::WebP && !webp_is_whole(&bytes) {
        return Err("cut off: fewer bytes than it states".to_owned());
    }
    let reader = ImageReader::with_format(Cursor::new(&bytes), format);
    reader.decode().map_err(|e| e.to_string())
}

/// Whether the end marker of a JPEG follows its last scan. The decoder fills a truncated file with grey and reports nothing; as neither
/// marker can occur within a scan, this detects truncation reliably.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let scan = bytes.windows(2).rposition(|w| w == [0xff, 0xda]);
    scan.is_some_and(|at| bytes[at..].windows(2).any(|w| w == [0xff, 0xd9]))
}

/// Whether a WebP has its stated length.
fn webp_is_whole(bytes: &[u8]) -> bool {
    let stated = bytes.get(4..8).and_then(|b| b.try_into().ok());
    stated.is_some_and(|b| u64::from(u32::from_le_bytes(b)) + 8 <= bytes.len() as u64)
}

/// Size of a PNG's signature, bytes (PNG specification, section 5.2).
const PNG: usize = 8;
/// Bytes of length, name and checksum around the data of a chunk of a PNG (section 5.3).
const AROUND: usize = 12;

/// The part of an image that its pixels need. For a PNG these are four kinds of chunks: profiles and texts could decompress to gigabytes,
/// and the decoder would decompress them.
fn needed(bytes: &[u8], format: ImageFormat) -> Cow<'_, [u8]> {
    if format != ImageFormat::Png {
        return Cow::Borrowed(bytes);
    }
    let mut kept = Vec::new();
    let (mut at, mut from) = (PNG, 0);
    while let Some(head) = bytes.get(at..at + 8) {
        let length = u32::from_be_bytes([head[0], head[1], head[2], head[3]]) as usize;
        let end = at.saturating_add(AROUND).saturating_add(length);
        if !matches!(&head[4..], b"IHDR" | b"PLTE" | b"tRNS" | b"IDAT" | b"IEND") {
            kept.extend_from_slice(&bytes[from..at]);
            from = end.min(bytes.len());
        }
        at = end;
    }
    if from == 0 {
        return Cow::Borrowed(bytes);
    }
    kept.extend_from_slice(&bytes[from..]);
    Cow::Owned(kept)
}

#[cfg(test)]
mod tests {
    use super::*;
    use image::{GrayImage, ImageBuffer, Luma};

    fn encoded(format: ImageFormat) -> Vec<u8> {
        let noise = |x: u32, y: u32| Luma([(x * 37 + y * 101 + x * y) as u8]);
        let image = DynamicImage::ImageLuma8(GrayImage::from_fn(64, 48, noise));
        let mut out = Cursor::new(Vec::new());
        match format {
            // WebP is written in colour only.
            ImageFormat::WebP => DynamicImage::ImageRgb8(image.to_rgb8()),
            _ => image,
        }
        .write_to(&mut out, format)
        .unwrap();
        out.into_inner()
    }

    #[test]
    fn truncated_image_is_refused() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP] {
            let whole = encoded(format);
            assert_eq!(image_format(&whole), Some(format));
            assert_eq!(decode_image(&whole, format).unwrap().width(), 64);
            // Padding by a recorder is allowed.
            let padded = [&whole[..], &[0; 7]].concat();
            assert!(decode_image(&padded, format).is_ok(), "{format:?}");
            for part in [2, 4, 6, 7] {
                let cut = &whole[..whole.len() * part / 8];
                assert!(decode_image(cut, format).is_err(), "{format:?} {part}/8");
            }
        }
    }

    #[test]
    fn image_size_is_checked_before_decoding() {
        // A PNG of 40 000 x 2500 px without pixel data.
        let mut png = encoded(ImageFormat::Png);
        png[16..20].copy_from_slice(&40_000_u32.to_be_bytes());
        png[20..24].copy_from_slice(&2500_u32.to_be_bytes());
        let crc = crc(&png[12..29]);
        png[29..33].copy_from_slice(&crc.to_be_bytes());
        for said in [
            image_size(&png, ImageFormat::Png).unwrap_err(),
            decode_image(&png, ImageFormat::Png).unwrap_err(),
        ] {
            assert!(said.contains("40000 x 2500 px"), "{said}");
        }
    }

    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0_u32, |crc, b| {
            (0..8).fold(crc ^ u32::from(*b), |c, _| {
                (c >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(c & 1))
            })
        })
    }

    #[test]
    fn profiles_and_texts_are_not_decompressed() {
        let plain = encoded(ImageFormat::Png);
        // An invalid profile: a decoder that reads it rejects the image or warns.
        let body = [&b"iCCPa\0\0"[..], &[0x78, 0x9c, 1, 2, 3]].concat();
        let mut chunk = (body.len() as u32 - 4).to_be_bytes().to_vec();
        chunk.extend(&body);
        chunk.extend(crc(&body).to_be_bytes());
        let with = [&plain[..33], &chunk, &plain[33..]].concat();
        let same = needed(&with, ImageFormat::Png);
        assert_eq!(*same, plain);
        assert!(matches!(needed(&plain, ImageFormat::Png), Cow::Borrowed(_)));
        let sixteen: ImageBuffer<Luma<u16>, Vec<u16>> = ImageBuffer::from_pixel(2, 2, Luma([7]));
        let mut out = Cursor::new(Vec::new());
        DynamicImage::ImageLuma16(sixteen)
            .write_to(&mut out, ImageFormat::Png)
            .unwrap();
        let decoded = decode_image(out.get_ref(), ImageFormat::Png).unwrap();
        assert_eq!(decoded.into_luma16().into_raw(), [7; 4]);
    }
}
