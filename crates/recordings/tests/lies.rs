//! Well-formed messages and images with contradictory contents: sizes, strides, values and encodings that do not match, images with valid
//! checksums. Each test uses 50 fixed seeds; `STILLPOINT_MUTATIONS` sets more, as in `mutations.rs`.

use crate::mutations::{Random, campaign};
use crate::writers::*;
use image::{DynamicImage, ImageFormat, RgbImage};
use std::io::Cursor;
use stillpoint_ros_messages::*;

const SEEDS: usize = 50;

fn pick<T: Copy>(all: &[T], random: &mut Random) -> T {
    all[random.below(all.len())]
}

fn figure(random: &mut Random) -> f64 {
    let all = [
        0.0,
        -0.0,
        -1.0,
        1.0,
        1e-300,
        1e300,
        -1e6,
        1e6,
        15.5,
        f64::NAN,
        f64::INFINITY,
    ];
    pick(&all, random)
}

fn size(random: &mut Random) -> u32 {
    let all = [
        0,
        1,
        2,
        16,
        31,
        33,
        64,
        96,
        1 << 15,
        1 << 20,
        1 << 31,
        u32::MAX,
    ];
    pick(&all, random)
}

fn of_camera(info: &mut CameraInfo<'_>, random: &mut Random) {
    match random.below(9) {
        0 => info.k[random.below(9)] = figure(random),
        1 => info.p[random.below(12)] = figure(random),
        2 => info.r[random.below(9)] = figure(random),
        3 => info.d = (0..random.below(20)).map(|_| figure(random)).collect(),
        4 => info.width = size(random),
        5 => info.height = size(random),
        6 => (info.binning_x, info.binning_y) = (size(random), size(random)),
        7 => {
            let models = ["equidistant", "rational_polynomial", "fisheye", "none", ""];
            info.distortion_model = pick(&models, random).into();
        }
        _ => {
            info.roi = RegionOfInterest {
                x_offset: size(random),
                y_offset: size(random),
                height: size(random),
                width: size(random),
                do_rectify: random.below(2) == 0,
            };
        }
    }
}

fn of_image(image: &mut Image<'_>, random: &mut Random) {
    match random.below(6) {
        0 => image.width = size(random),
        1 => image.height = size(random),
        2 => image.step = size(random),
        3 => {
            let encodings = [
                "rgb8",
                "bgra8",
                "mono8",
                "mono16",
                "16UC1",
                "32FC1",
                "bayer_rggb8",
                "bayer_gbrg16",
                "yuv422_yuy2",
                "nv12",
                "nv24",
                "8UC3",
                "",
            ];
            image.encoding = pick(&encodings, random).into();
        }
        4 => image.is_bigendian = random.below(256) as u8,
        _ => {
            let length = random.below(2 * image.data.len() + 1);
            image.data.to_mut().resize(length, 0xff);
        }
    }
}

/// Replaces a message by another one of the same type.
fn lie(m: &mut Sent, random: &mut Random) {
    let bytes = m.cdr.clone();
    let topic = m.topic.clone();
    let format = Format::CdrLittleEndian;
    if m.type_name == CameraInfo::NAME {
        let mut info: CameraInfo<'_> = from_bytes(&bytes, format).unwrap();
        of_camera(&mut info, random);
        *m = sent(&topic, m.time, &info);
    } else if m.type_name == Image::NAME {
        let mut image: Image<'_> = from_bytes(&bytes, format).unwrap();
        of_image(&mut image, random);
        *m = sent(&topic, m.time, &image);
    } else if m.type_name == Odometry::NAME {
        let mut odometry: Odometry<'_> = from_bytes(&bytes, format).unwrap();
        odometry.header.stamp.sec = pick(&[0, -1, 5, i64::from(i32::MAX)], random);
        odometry.pose.pose.orientation.w = figure(random);
        odometry.pose.pose.position.x = figure(random);
        *m = sent(&topic, m.time, &odometry);
    }
}

#[test]
fn contradictory_message_fields_never_panic() {
    campaign("figures.mcap", SEEDS, |random| {
        let mut messages = camera("/camera", 3);
        messages.extend(odometry(3));
        // One message, those of a topic, or all of them.
        let chosen = messages[random.below(messages.len())].topic.clone();
        let share = pick(&[1, 3, 12], random);
        for _ in 0..1 + random.below(3) {
            for m in messages.iter_mut().filter(|m| m.topic == chosen) {
                if random.below(share) == 0 {
                    lie(m, random);
                }
            }
        }
        mcap(&messages, None)
    });
}

fn picture(k: usize, format: ImageFormat) -> Vec<u8> {
    let pixel = |x: u32, y: u32| image::Rgb([grey(k, x, y); 3]);
    let mut out = Cursor::new(Vec::new());
    DynamicImage::ImageRgb8(RgbImage::from_fn(WIDTH, HEIGHT, pixel))
        .write_to(&mut out, format)
        .unwrap();
    out.into_inner()
}

/// Mostly removes parts; also reorders them, or changes a number in one.
fn rearranged(parts: &mut Vec<Vec<u8>>, random: &mut Random) {
    for _ in 0..1 + random.below(3) {
        let at = random.below(parts.len());
        match random.below(4) {
            0 if parts.len() > 1 => drop(parts.remove(at)),
            1 => {
                let copies = vec![parts[at].clone(); 1 + random.below(100)];
                parts.splice(at..at, copies);
            }
            2 => {
                let other = random.below(parts.len());
                parts.swap(at, other);
            }
            _ => {
                let part = &mut parts[at];
                // Sizes and types are at the beginning.
                let place = random.below(part.len().min(20));
                let width = pick(&[1, 2, 4], random).min(part.len() - place);
                let value = size(random).to_be_bytes();
                part[place..place + width].copy_from_slice(&value[4 - width..]);
            }
        }
    }
}

/// A PNG of modified chunks, with valid checksums.
fn png(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let (signature, mut rest) = whole.split_at(8);
    let mut chunks = Vec::new();
    while rest.len() >= 12 {
        let length = u32::from_be_bytes(rest[..4].try_into().unwrap()) as usize;
        chunks.push(rest[4..8 + length].to_vec());
        rest = &rest[12 + length..];
    }
    rearranged(&mut chunks, random);
    let mut out = signature.to_vec();
    for chunk in chunks.iter().filter(|c| c.len() >= 4) {
        out.extend((chunk.len() as u32 - 4).to_be_bytes());
        out.extend(chunk);
        out.extend(crc32fast::hash(chunk).to_be_bytes());
    }
    out
}

/// A JPEG of modified segments, with valid lengths.
fn jpeg(whole: &[u8], random: &mut Random) -> Vec<u8> {
    let mut rest = &whole[2..];
    let mut segments = Vec::new();
    // Up to the pixels.
    while rest[1] != 0xda {
        let length = usize::from(u16::from_be_bytes([rest[2], rest[3]]));
        segments.push([&rest[1..2], &rest[4..2 + length]].concat());
        rest = &rest[2 + length..];
    }
    rearranged(&mut segments, random);
    let mut out = whole[..2].to_vec();
    for segment in segments.iter().filter(|s| !s.is_empty()) {
        out.extend([0xff, segment[0]]);
        out.extend((segment.len() as u16 + 1).to_be_bytes());
        out.extend(&segment[1..]);
    }
    out.extend(rest);
    out
}

#[test]
fn contradictory_images_never_panic() {
    let pictures = [ImageFormat::Png, ImageFormat::Jpeg].map(|f| (f, picture(0, f)));
    campaign("images.mcap", SEEDS, |random| {
        let mut messages = camera("/camera", 2);
        for m in messages.iter_mut().filter(|m| m.type_name == Image::NAME) {
            let bytes = m.cdr.clone();
            let image: Image<'_> = from_bytes(&bytes, Format::CdrLittleEndian).unwrap();
            let (format, whole) = &pictures[random.below(2)];
            let is_depth = image.encoding == "16UC1";
            if is_depth && random.below(2) == 0 {
                continue;
            }
            let data = match format {
                ImageFormat::Png => png(whole, random),
                _ => jpeg(whole, random),
            };
            let ending = if is_depth {
                pick(&["compressed", "compressedDepth"], random)
            } else {
                "compressed"
            };
            let said = [
                "png",
                "jpeg",
                "16UC1; png compressed ",
                "rgb8; jpeg compressed bgr8",
            ];
            let message = CompressedImage {
                header: image.header.clone(),
                format: pick(&said, random).into(),
                data: data.into(),
            };
            *m = sent(&format!("{}/{ending}", m.topic), m.time, &message);
        }
        mcap(&messages, None)
    });
}
