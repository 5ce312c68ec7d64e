//! Animations as any reader of APNG decodes them.

use std::io::{Cursor, Seek, SeekFrom, Write};
use stillpoint_imaging::GrayImage;
use stillpoint_view::{Animation, AnimationOptions, Picture, ViewError, write_png};

/// A picture with a bright column that stands further right in each frame.
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
    let mut animation = Animation::new(Cursor::new(Vec::new()), options);
    for n in 0..frames {
        animation.push(&picture(40, 30, n)).unwrap();
    }
    animation.finish().unwrap().into_inner()
}

/// Pixels of all frames, and the delay of the first as a fraction of a second.
fn decode(bytes: &[u8]) -> (Vec<Vec<u8>>, (u16, u16)) {
    // The decoder checks the checksums of all chunks, and the numbers of those that are numbered.
    let mut reader = png::Decoder::new(Cursor::new(bytes)).read_info().unwrap();
    let count = reader.info().animation_control().unwrap().num_frames;
    assert_eq!(reader.info().animation_control().unwrap().num_plays, 0);
    let mut delay = (0, 0);
    let frames = (0..count)
        .map(|_| {
            let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
            reader.next_frame(&mut pixels).unwrap();
            let control = reader.info().frame_control().unwrap();
            delay = (control.delay_num, control.delay_den);
            pixels
        })
        .collect();
    let mut pixels = vec![0; reader.output_buffer_size().unwrap()];
    assert!(
        reader.next_frame(&mut pixels).is_err(),
        "more frames than stated"
    );
    (frames, delay)
}

#[test]
fn every_frame_is_there() {
    let options = AnimationOptions {
        every: 1,
        halve: false,
        frames_per_second: 25.0,
    };
    let (frames, delay) = decode(&animate(options, 7));
    assert_eq!(frames.len(), 7);
    assert_eq!(delay, (40, 1000));
    for (n, found) in frames.iter().enumerate() {
        let drawn = picture(40, 30, n);
        assert_eq!(found.len(), drawn.data().len());
        for (a, b) in found.iter().zip(drawn.data()) {
            assert!(a.abs_diff(*b) < 8, "frame {n}: {a} {b}");
        }
    }
}

#[test]
fn subsampling_keeps_every_nth_frame_at_half_size_and_the_speed() {
    let (frames, delay) = decode(&animate(AnimationOptions::default(), 10));
    assert_eq!(frames.len(), 4);
    assert_eq!(delay, (100, 1000));
    for (i, found) in frames.iter().enumerate() {
        assert_eq!(found.len(), 3 * 20 * 15);
        let brightest = (0..20).max_by_key(|x| found[3 * x]).unwrap();
        assert_eq!(brightest, 3 * i / 2);
    }
}

#[test]
fn one_frame_is_a_still_picture_too() {
    let options = AnimationOptions {
        every: 0,
        frames_per_second: f64::NAN,
        ..AnimationOptions::default()
    };
    let (frames, delay) = decode(&animate(options, 1));
    assert_eq!(frames.len(), 1);
    assert_eq!(delay, (10, 1000));
}

#[test]
fn it_begins_where_the_sink_stands() {
    let mut sink = Cursor::new(Vec::new());
    sink.write_all(b"before").unwrap();
    let mut animation = Animation::new(sink, AnimationOptions::default());
    for n in 0..4 {
        animation.push(&picture(40, 30, n)).unwrap();
    }
    assert_eq!(animation.frames(), 2);
    let mut sink = animation.finish().unwrap();
    let end = sink.stream_position().unwrap();
    assert_eq!(sink.seek(SeekFrom::End(0)).unwrap(), end);
    let bytes = sink.into_inner();
    assert_eq!(&bytes[..6], b"before");
    assert_eq!(decode(&bytes[6..]).0.len(), 2);
}

#[test]
fn what_cannot_be_animated_is_refused() {
    let animation = Animation::new(Cursor::new(Vec::new()), AnimationOptions::default());
    assert!(matches!(animation.finish(), Err(ViewError::NoFrames)));
    let mut animation = Animation::new(Cursor::new(Vec::new()), AnimationOptions::default());
    animation.push(&picture(40, 30, 0)).unwrap();
    let e = animation.push(&picture(40, 32, 1)).unwrap_err().to_string();
    assert!(e.contains("40 x 30") && e.contains("40 x 32"), "{e}");
    let mut animation = Animation::new(Cursor::new(Vec::new()), AnimationOptions::default());
    assert!(matches!(
        animation.push(&picture(1, 1, 0)),
        Err(ViewError::Empty(0, 0))
    ));
}

/// Grey with the noise of a camera, from a fixed sequence.
fn noisy(width: usize, height: usize) -> Picture {
    let mut state = 1u32;
    let pixels = (0..width * height).map(|i| {
        state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
        (i % width / 2) as u8 + (state >> 30) as u8
    });
    Picture::from_gray(&GrayImage::from_vec(width, height, pixels.collect()).unwrap())
}

#[test]
fn an_animation_is_far_smaller_than_its_stills() {
    let picture = noisy(320, 240);
    let mut still = Vec::new();
    write_png(&picture, &mut still).unwrap();
    let mut animation = Animation::new(Cursor::new(Vec::new()), AnimationOptions::default());
    for _ in 0..30 {
        animation.push(&picture).unwrap();
    }
    let length = animation.finish().unwrap().into_inner().len();
    let stills = 30 * still.len();
    assert!(15 * length < stills, "{length} of {stills} bytes");
}

#[test]
fn a_still_picture_needs_no_seeking() {
    let mut bytes = Vec::new();
    write_png(&picture(40, 30, 3), &mut bytes).unwrap();
    assert!(bytes.starts_with(b"\x89PNG"));
}
