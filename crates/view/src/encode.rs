//! Encodes images as PNG, JPEG and WebP.

use crate::{Picture, ViewError};
use jpeg_encoder::{ColorType, Encoder};
use std::io::Write;
use stillpoint_imaging::GrayImage;
use webp::WebPConfig;

/// Writes an image as PNG, 8 bits per channel.
///
/// # Errors
/// [`ViewError::Empty`], [`ViewError::Encode`] (also for a failing sink).
pub fn write_png<W: Write>(picture: &Picture, sink: W) -> Result<(), ViewError> {
    let (width, height) = size(picture.width(), picture.height())?;
    let mut encoder = png::Encoder::new(sink, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_filter(png::Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(picture.data())?;
    writer.finish()?;
    Ok(())
}

/// Writes an image as JPEG; `quality` is 1 to 100 percent.
///
/// # Errors
/// [`ViewError::Empty`], also beyond JPEG's size limit; [`ViewError::Write`].
pub fn write_jpeg<W: Write>(picture: &Picture, quality: u8, mut sink: W) -> Result<(), ViewError> {
    let (w, h) = (picture.width(), picture.height());
    let (Ok(width @ 1..), Ok(height @ 1..)) = (u16::try_from(w), u16::try_from(h)) else {
        return Err(ViewError::Empty(w, h));
    };
    // A single instantiation of the encoder: each takes a third of a megabyte of code.
    let mut jpeg = Vec::new();
    let encoder = Encoder::new(&mut jpeg, quality.clamp(1, 100));
    encoder
        .encode(picture.data(), width, height, ColorType::Rgb)
        .map_err(|e| ViewError::Write(std::io::Error::other(e)))?;
    sink.write_all(&jpeg).map_err(ViewError::Write)
}

/// RGB pixels as WebP, with quality in percent and method (0 to 6: higher is slower and smaller).
pub(crate) fn webp(
    pixels: &[u8],
    (w, h): (usize, usize),
    (quality, method): (u8, i32),
) -> Result<Vec<u8>, ViewError> {
    let (width, height) = size(w, h)?;
    let mut config = WebPConfig::new().map_err(|()| ViewError::Webp("no encoder".to_owned()))?;
    config.quality = f32::from(quality);
    config.method = method;
    let encoder = webp::Encoder::from_rgb(pixels, width, height);
    let bytes = encoder.encode_advanced(&config);
    let bytes = bytes.map_err(|e| ViewError::Webp(format!("{e:?}")))?;
    Ok(bytes.to_vec())
}

/// Writes a grey image as 8-bit PNG, values unchanged.
///
/// # Errors
/// [`ViewError::Empty`], [`ViewError::Encode`] (also for a failing sink).
pub fn write_mask<W: Write>(mask: &GrayImage, sink: W) -> Result<(), ViewError> {
    let (width, height) = size(mask.width(), mask.height())?;
    let mut encoder = png::Encoder::new(sink, width, height);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(mask.data())?;
    writer.finish()?;
    Ok(())
}

fn size(w: usize, h: usize) -> Result<(u32, u32), ViewError> {
    match (u32::try_from(w), u32::try_from(h)) {
        (Ok(width), Ok(height)) if width > 0 && height > 0 => Ok((width, height)),
        _ => Err(ViewError::Empty(w, h)),
    }
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Colour;
    use std::io::Cursor;

    #[test]
    fn png_round_trips() {
        let mut picture = Picture::new(9, 5, Colour::RIGID);
        picture.fill((2, 1), (5, 3), Colour::STATIC, 1.0);
        let mut bytes = Vec::new();
        write_png(&picture, &mut bytes).unwrap();
        let mut reader = png::Decoder::new(Cursor::new(&bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        let info = reader.next_frame(&mut pixels).unwrap();
        assert_eq!((info.width, info.height), (9, 5));
        assert_eq!(pixels, picture.data());
    }

    #[test]
    fn mask_keeps_its_values() {
        let mask = GrayImage::from_vec(3, 2, vec![0, 255, 7, 255, 0, 0]).unwrap();
        let mut bytes = Vec::new();
        write_mask(&mask, &mut bytes).unwrap();
        let mut reader = png::Decoder::new(Cursor::new(&bytes)).read_info().unwrap();
        let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
        reader.next_frame(&mut pixels).unwrap();
        assert_eq!(pixels, mask.data());
        assert!(write_mask(&GrayImage::new(0, 3), Vec::new()).is_err());
    }

    #[test]
    fn empty_picture_is_refused() {
        let e = write_png(&Picture::new(0, 5, Colour::BLACK), Vec::new()).unwrap_err();
        assert!(e.to_string().contains("0 x 5"), "{e}");
    }
}
