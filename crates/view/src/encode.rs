//! Pictures as PNG.

use crate::{Picture, ViewError};
use std::io::Write;

/// Writes a picture as PNG, 8 bits per channel.
///
/// # Errors
/// [`ViewError::Empty`], [`ViewError::Encode`] (which also tells of a sink that fails).
pub fn write_png<W: Write>(picture: &Picture, sink: W) -> Result<(), ViewError> {
    let (width, height) = size(picture)?;
    let mut encoder = png::Encoder::new(sink, width, height);
    encoder.set_color(png::ColorType::Rgb);
    encoder.set_depth(png::BitDepth::Eight);
    encoder.set_filter(png::Filter::Adaptive);
    let mut writer = encoder.write_header()?;
    writer.write_image_data(picture.data())?;
    writer.finish()?;
    Ok(())
}

/// Width and height as PNG holds them.
fn size(picture: &Picture) -> Result<(u32, u32), ViewError> {
    let (w, h) = (picture.width(), picture.height());
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
    fn what_is_written_is_what_was_drawn() {
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
    fn nothing_is_no_picture() {
        let e = write_png(&Picture::new(0, 5, Colour::BLACK), Vec::new()).unwrap_err();
        assert!(e.to_string().contains("0 x 5"), "{e}");
    }
}
