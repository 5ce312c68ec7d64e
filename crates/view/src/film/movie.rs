//! Encodes a sequence of images as an animation.

use crate::{Animation, AnimationOptions, Picture, ViewError};
use webp::{AnimEncoder, AnimFrame, WebPConfig};

/// Duration of the last image before the animation repeats, s.
const REST: f64 = 2.0;

/// Settings of an animation.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct MovieOptions {
    /// Images per second.
    pub rate: f64,
    /// WebP quality, 1 to 100.
    pub quality: f32,
}

/// Encodes images as an endless animated WebP.
///
/// # Errors
/// [`ViewError::NoFrames`], [`ViewError::Size`], [`ViewError::Webp`].
pub fn write_webp(pictures: &[Picture], options: &MovieOptions) -> Result<Vec<u8>, ViewError> {
    let first = pictures.first().ok_or(ViewError::NoFrames)?;
    let expected = (first.width(), first.height());
    let size = |n: usize| u32::try_from(n).unwrap_or(u32::MAX);
    let (width, height) = (size(expected.0), size(expected.1));
    let mut config = WebPConfig::new().map_err(|()| ViewError::Webp("no encoder".to_owned()))?;
    config.quality = options.quality;
    let mut encoder = AnimEncoder::new(width, height, &config);
    let ms = |n: f64| (1e3 * n / options.rate).round() as i32;
    for (i, picture) in pictures.iter().enumerate() {
        let found = (picture.width(), picture.height());
        if found != expected {
            return Err(ViewError::Size { expected, found });
        }
        encoder.add_frame(AnimFrame::from_rgb(
            picture.data(),
            width,
            height,
            ms(i as f64),
        ));
    }
    // Repeating the last image extends its duration.
    if let Some(last) = pictures.last() {
        let end = ms((pictures.len() - 1) as f64 + REST * options.rate);
        encoder.add_frame(AnimFrame::from_rgb(last.data(), width, height, end));
    }
    let bytes = encoder.try_encode();
    let bytes = bytes.map_err(|e| ViewError::Webp(format!("{e:?}")))?;
    Ok(bytes.to_vec())
}

/// Encodes images as an endless GIF.
///
/// # Errors
/// [`ViewError::NoFrames`], [`ViewError::Size`], [`ViewError::Animate`].
pub fn write_gif(pictures: &[Picture], options: &MovieOptions) -> Result<Vec<u8>, ViewError> {
    let mut animation = Animation::new(
        Vec::new(),
        AnimationOptions {
            every: 1,
            halve: false,
            frames_per_second: options.rate,
        },
    );
    let rest = (REST * options.rate).round() as usize;
    let last = pictures.last().into_iter();
    let last = last.flat_map(|p| std::iter::repeat_n(p, rest));
    for picture in pictures.iter().chain(last) {
        animation.push(picture)?;
    }
    animation.finish()
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::Colour;
    use image::AnimationDecoder;
    use image::codecs::webp::WebPDecoder;
    use std::io::Cursor;

    fn pictures() -> Vec<Picture> {
        let shades = [0u8, 120, 240];
        let picture = |v: u8| {
            let mut p = Picture::new(64, 48, Colour(v, 80, 200 - v / 2));
            p.fill((5, 5), (30, 40), Colour::STATIC, 1.0);
            p
        };
        shades.map(picture).to_vec()
    }

    #[test]
    fn webp_contains_every_picture_and_holds_the_last() {
        let options = MovieOptions {
            rate: 10.0,
            quality: 80.0,
        };
        let bytes = write_webp(&pictures(), &options).unwrap();
        let decoder = WebPDecoder::new(Cursor::new(&bytes)).unwrap();
        let frames = decoder.into_frames().collect_frames().unwrap();
        let delay = |i: usize| {
            let (n, d) = frames[i].delay().numer_denom_ms();
            n / d
        };
        assert!(frames.len() >= 3, "{}", frames.len());
        let all: u32 = (0..frames.len()).map(delay).sum();
        assert_eq!(delay(0), 100);
        assert!((2200..=3500).contains(&all), "{all}");
        for (i, p) in pictures().iter().enumerate() {
            let (found, wanted) = (frames[i].buffer().get_pixel(50, 20), p.at(50, 20).unwrap());
            let near = |a: u8, b: u8| a.abs_diff(b) < 12;
            assert!(
                near(found[0], wanted.0) && near(found[2], wanted.2),
                "{i}: {found:?} {wanted:?}"
            );
        }
        assert!(write_webp(&[], &options).is_err());
    }

    #[test]
    fn gif_contains_every_picture() {
        let options = MovieOptions {
            rate: 10.0,
            quality: 80.0,
        };
        let bytes = write_gif(&pictures(), &options).unwrap();
        let mut decoder = gif::DecodeOptions::new().read_info(&*bytes).unwrap();
        let mut frames = 0;
        while decoder.read_next_frame().unwrap().is_some() {
            frames += 1;
        }
        assert_eq!(frames, 3 + 20);
        let odd = [
            Picture::new(4, 4, Colour::BLACK),
            Picture::new(5, 4, Colour::BLACK),
        ];
        assert!(write_gif(&odd, &options).is_err());
        assert!(write_webp(&odd, &options).is_err());
    }
}
