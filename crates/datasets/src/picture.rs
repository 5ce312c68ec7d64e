//! Bytes of an image to its pixels, for files and messages alike. Nothing in them is trusted: sizes are looked at before anything is allocated, what is not needed
//! is not unpacked, and an image that was cut off is none.

use image::{DynamicImage, ImageFormat, ImageReader};
use std::borrow::Cow;
use std::io::Cursor;

/// Pixels of an image at most, as many as a video of 8K has: with all that is made of it on the way it takes some hundred megabytes.
pub const MOST_PIXELS: u64 = 1 << 25;
/// Pixels of a row or column at most: four times those of 8K.
const LONGEST_SIDE: u32 = 1 << 15;
/// Bytes of an image file at most: of as many pixels of noise, eight bytes each, as 16-bit RGBA has.
pub(crate) const LARGEST_FILE: u64 = 1 << 28;

/// The format of an image, where it is one that is read: PNG, JPEG or WebP.
#[must_use]
pub fn image_format(bytes: &[u8]) -> Option<ImageFormat> {
    let format = image::guess_format(bytes).ok()?;
    let read = [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP];
    read.contains(&format).then_some(format)
}

/// Width and height, px, from the head of an image.
///
/// # Errors
/// What is wrong with it: its head, or a size beyond [`MOST_PIXELS`].
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

/// Decodes an image that is whole.
///
/// # Errors
/// What is wrong with it.
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

/// Whether the end marker of a JPEG follows its last scan. The decoder fills what is missing of a truncated file with grey
/// and reports nothing; within a scan neither marker can occur, so this tells a truncated file for sure.
fn jpeg_is_whole(bytes: &[u8]) -> bool {
    let scan = bytes.windows(2).rposition(|w| w == [0xff, 0xda]);
    scan.is_some_and(|at| bytes[at..].windows(2).any(|w| w == [0xff, 0xd9]))
}

/// Whether all is there that the head of a WebP states.
fn webp_is_whole(bytes: &[u8]) -> bool {
    let stated = bytes.get(4..8).and_then(|b| b.try_into().ok());
    stated.is_some_and(|b| u64::from(u32::from_le_bytes(b)) + 8 <= bytes.len() as u64)
}

/// Bytes of a PNG's signature (PNG specification, section 5.2).
const PNG: usize = 8;
/// Bytes of length, name and checksum around the data of a chunk of a PNG (section 5.3).
const AROUND: usize = 12;

/// What of an image its pixels need. Of a PNG these are four kinds of chunks: others may be profiles and texts that unpack to gigabytes, and the decoder unpacks
/// them on its way.
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
            // WebP is written in colour alone.
            ImageFormat::WebP => DynamicImage::ImageRgb8(image.to_rgb8()),
            _ => image,
        }
        .write_to(&mut out, format)
        .unwrap();
        out.into_inner()
    }

    #[test]
    fn an_image_that_was_cut_off_is_none() {
        for format in [ImageFormat::Png, ImageFormat::Jpeg, ImageFormat::WebP] {
            let whole = encoded(format);
            assert_eq!(image_format(&whole), Some(format));
            assert_eq!(decode_image(&whole, format).unwrap().width(), 64);
            // What a recorder padded is not missed.
            let padded = [&whole[..], &[0; 7]].concat();
            assert!(decode_image(&padded, format).is_ok(), "{format:?}");
            for part in [2, 4, 6, 7] {
                let cut = &whole[..whole.len() * part / 8];
                assert!(decode_image(cut, format).is_err(), "{format:?} {part}/8");
            }
        }
    }

    #[test]
    fn sizes_are_looked_at_before_pixels() {
        // A PNG of 40 000 x 2500 px, whose pixels are not there.
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

    /// CRC-32 as PNG has it, bit by bit.
    fn crc(bytes: &[u8]) -> u32 {
        !bytes.iter().fold(!0_u32, |crc, b| {
            (0..8).fold(crc ^ u32::from(*b), |c, _| {
                (c >> 1) ^ (0xedb8_8320 & 0_u32.wrapping_sub(c & 1))
            })
        })
    }

    #[test]
    fn profiles_and_texts_are_not_unpacked() {
        let plain = encoded(ImageFormat::Png);
        // A profile that does not unpack: a decoder that looks at it refuses the image or warns.
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
