//! Animations, decoded by a GIF reader.

use gif::{ColorOutput, DecodeOptions, Repeat};
use std::io::{Cursor, Write};
use stillpoint_imaging::GrayImage;
use stillpoint_view::{Animation, AnimationOptions, Picture, ViewError, write_png};

/// An image with a bright column that moves right with `n`.
fn picture(width: usize, height: usize, n: usize) -> Picture {
    let pixels = (0..width * height)
        .map(|i| {
            if i % width == n {
                255
            } else {
                (i / width) as u8
            }
        })
        .collect();
    Picture::from_gray(&GrayImage::from_vec(width, height, pixels).unwrap())
}

fn animate(options: AnimationOptions, frames: usize) -> Vec<u8> {
    let mut animation = Animation::new(Vec::new(), options);
    for n in 0..frames {
        animation.push(&picture(40, 30, n)).unwrap();
    }
    animation.finish().unwrap()
}

/// The image displayed at each frame, RGB, and its duration, in hundredths of a second.
fn decode(bytes: &[u8]) -> (Vec<Vec<u8>>, Vec<u16>) {
    let mut options = DecodeOptions::new();
    options.set_color_output(ColorOutput::RGBA);
    let mut reader = options.read_info(Cursor::new(bytes)).unwrap();
    let mut shown = vec![0; 3 * usize::from(reader.width()) * usize::from(reader.height())];
    let (mut frames, mut delays) = (Vec::new(), Vec::new());
    while let Some(frame) = reader.read_next_frame().unwrap() {
        assert_eq!(frame.buffer.len() / 4, shown.len() / 3);
        for (new, old) in frame.buffer.chunks_exact(4).zip(shown.chunks_exact_mut(3)) {
            // Unchanged pixels are transparent.
            if new[3] > 0 {
                old.copy_from_slice(&new[..3]);
            }
        }
        frames.push(shown.clone());
        delays.push(frame.delay);
    }
    assert_eq!(reader.repeat(), Repeat::Infinite);
    (frames, delays)
}

#[test]
fn animation_contains_every_frame() {
    let options = AnimationOptions {
        every: 1,
        halve: false,
        frames_per_second: 25.0,
    };
    let (frames, delays) = decode(&animate(options, 7));
    assert_eq!(frames.len(), 7);
    assert_eq!(delays, [4; 7]);
    for (n, found) in frames.iter().enumerate() {
        let drawn = picture(40, 30, n);
        assert_eq!(found.len(), drawn.data().len());
        for (a, b) in found.iter().zip(drawn.data()) {
            assert!(a.abs_diff(*b) < 10, "frame {n}: {a} {b}");
        }
    }
}

#[test]
fn subsampling_keeps_every_nth_frame_at_half_size_and_the_speed() {
    let (frames, delays) = decode(&animate(AnimationOptions::default(), 10));
    assert_eq!(frames.len(), 4);
    assert_eq!(delays, [10; 4]);
    for (i, found) in frames.iter().enumerate() {
        assert_eq!(found.len(), 3 * 20 * 15);
        let brightest = (0..20).max_by_key(|x| found[3 * x]).unwrap();
        assert_eq!(brightest, 3 * i / 2);
    }
}

#[test]
fn single_frame_animation_is_valid() {
    let options = AnimationOptions {
        every: 0,
        frames_per_second: f64::NAN,
        ..AnimationOptions::default()
    };
    let (frames, delays) = decode(&animate(options, 1));
    assert_eq!(frames.len(), 1);
    assert_eq!(delays, [2]);
}

#[test]
fn rounded_delays_add_up_to_the_length_of_the_recording() {
    let options = AnimationOptions {
        every: 1,
        ..AnimationOptions::default()
    };
    let (_, delays) = decode(&animate(options, 30));
    assert!(delays.iter().all(|d| (3..=4).contains(d)), "{delays:?}");
    assert_eq!(delays.iter().sum::<u16>(), 100);
}

#[test]
fn animation_starts_at_the_sink_position() {
    let mut sink = Vec::new();
    sink.write_all(b"before").unwrap();
    let mut animation = Animation::new(sink, AnimationOptions::default());
    for n in 0..4 {
        animation.push(&picture(40, 30, n)).unwrap();
    }
    assert_eq!(animation.frames(), 2);
    let bytes = animation.finish().unwrap();
    assert_eq!(&bytes[..6], b"before");
    assert_eq!(decode(&bytes[6..]).0.len(), 2);
}

struct Full;

impl Write for Full {
    fn write(&mut self, _: &[u8]) -> std::io::Result<usize> {
        Err(std::io::Error::other("no space left"))
    }

    fn flush(&mut self) -> std::io::Result<()> {
        Ok(())
    }
}

#[test]
fn full_disk_is_an_error() {
    let options = AnimationOptions {
        every: 1,
        ..AnimationOptions::default()
    };
    let mut animation = Animation::new(Full, options);
    let first = animation.push(&picture(40, 30, 0));
    let text = first.unwrap_err().to_string();
    assert!(text.contains("no space left"), "{text}");
    assert!(animation.push(&picture(40, 30, 0)).is_err());
    assert!(animation.finish().is_err());
}

#[test]
fn invalid_animations_are_refused() {
    let animation = Animation::new(Vec::new(), AnimationOptions::default());
    assert!(matches!(animation.finish(), Err(ViewError::NoFrames)));
    let mut animation = Animation::new(Vec::new(), AnimationOptions::default());
    animation.push(&picture(40, 30, 0)).unwrap();
    let e = animation.push(&picture(40, 32, 1)).unwrap_err().to_string();
    assert!(e.contains("40 x 30") && e.contains("40 x 32"), "{e}");
    let mut animation = Animation::new(Vec::new(), AnimationOptions::default());
    assert!(matches!(
        animation.push(&picture(1, 1, 0)),
        Err(ViewError::Empty(0, 0))
    ));
    let options = AnimationOptions {
        halve: false,
        ..AnimationOptions::default()
    };
    let mut animation = Animation::new(Vec::new(), options);
    let wide = GrayImage::from_vec(70_000, 1, vec![0; 70_000]).unwrap();
    let e = animation.push(&Picture::from_gray(&wide)).unwrap_err();
    assert!(e.to_string().contains("65535"), "{e}");
}

/// Grey with camera noise, from a fixed sequence.
fn noisy(width: usize, height: usize) -> Picture {
    let mut state = 1u32;
    let pixels = (0..width * height).map(|i| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (i % width / 2) as u8 + (state >> 30) as u8
    });
    Picture::from_gray(&GrayImage::from_vec(width, height, pixels.collect()).unwrap())
}

#[test]
fn animation_is_far_smaller_than_its_stills() {
    let picture = noisy(320, 240);
    let mut still = Vec::new();
    write_png(&picture, &mut still).unwrap();
    let mut animation = Animation::new(Vec::new(), AnimationOptions::default());
    for _ in 0..30 {
        animation.push(&picture).unwrap();
    }
    let length = animation.finish().unwrap().len();
    let stills = 30 * still.len();
    assert!(15 * length < stills, "{length} of {stills} bytes");
}

#[test]
fn still_picture_is_png() {
    let mut bytes = Vec::new();
    write_png(&picture(40, 30, 3), &mut bytes).unwrap();
    assert!(bytes.starts_with(b"\x89PNG"));
}
