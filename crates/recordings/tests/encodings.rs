//! Encodings of drivers and phones, and images that only resemble depth.

use crate::edited::*;
use crate::files::frames;
use crate::writers::*;
use stillpoint_imaging::FrameId;
use stillpoint_recordings::{ImageMessage, Incoming, IncomingTopic, OpenOptions, Transforms};
use stillpoint_ros_messages::*;

#[test]
fn depth_like_images_must_be_named() {
    let floats = |_: usize, image: Image<'static>| {
        let values = image.data.chunks(2).flat_map(|b| {
            let value = f32::from(u16::from_le_bytes([b[0], b[1]])) / 1000.0;
            value.to_le_bytes()
        });
        Image {
            encoding: "32FC1".into(),
            step: 4 * WIDTH,
            data: values.collect::<Vec<u8>>().into(),
            ..image.clone()
        }
    };
    let grey16 = |_: usize, mut image: Image<'static>| {
        image.encoding = "mono16".into();
        image
    };
    let confidence = "/zed/confidence/confidence_map";
    let infrared = "/camera/infra1/image_rect_raw";
    for (topic, file) in [
        (
            confidence,
            Recorded::new().images(DEPTH, confidence, floats),
        ),
        (infrared, Recorded::new().images(DEPTH, infrared, |_, i| i)),
        (
            "/ir/image_raw",
            Recorded::new().images(DEPTH, "/ir/image_raw", grey16),
        ),
    ] {
        file.refused(&["a topic of depth images", topic]);
        let named = OpenOptions {
            depth_topic: Some(topic.into()),
            colour_topic: Some(COLOUR.into()),
            ..OpenOptions::default()
        };
        let input = file.open_with(named).unwrap();
        assert_eq!(frames(&input)[0].depth.at(0, 0), 1.0, "{topic}");
    }
}

#[test]
fn float_depth_in_millimetres_is_detected_and_scaled() {
    for (per_metre, named) in [(1000.0, "--depth-scale 1000"), (100.0, "--depth-scale 100")] {
        let file = Recorded::new().images(DEPTH, DEPTH, |_, image| {
            let values = image.data.chunks(2).flat_map(|b| {
                let metres = f32::from(u16::from_le_bytes([b[0], b[1]])) / 1000.0;
                (per_metre as f32 * metres).to_le_bytes()
            });
            Image {
                encoding: "32FC1".into(),
                step: 4 * WIDTH,
                data: values.collect::<Vec<u8>>().into(),
                ..image.clone()
            }
        });
        let input = file.open();
        assert_eq!(input.camera().depth_scale, 1.0);
        let warned = input.warnings().join("\n");
        assert!(warned.ends_with(named), "{warned}");
        let options = OpenOptions {
            depth_scale: Some(per_metre),
            ..OpenOptions::default()
        };
        let input = file.open_with(options).unwrap();
        assert!(input.warnings().is_empty(), "{:?}", input.warnings());
        assert_eq!(input.camera().depth_scale, per_metre);
        assert!((frames(&input)[0].depth.at(31, 23) - 1.116).abs() < 1e-5);
    }
}

#[test]
fn compressed_png_depth_is_read() {
    for (topic, format) in [
        (format!("{DEPTH}/compressed"), "16UC1; png compressed "),
        (format!("{DEPTH}/compressed"), "png"),
        (format!("{DEPTH}/compressedDepth"), "16UC1; compressedDepth"),
    ] {
        let file = Recorded::new().edit::<Image<'_>>(DEPTH, |_, m| {
            let image: Image<'_> = from_bytes(&m.cdr, Format::CdrLittleEndian).unwrap();
            let values = image
                .data
                .chunks(2)
                .map(|b| u16::from_le_bytes([b[0], b[1]]));
            let deep: image::ImageBuffer<image::Luma<u16>, _> =
                image::ImageBuffer::from_raw(WIDTH, HEIGHT, values.collect::<Vec<u16>>()).unwrap();
            let mut png = std::io::Cursor::new(Vec::new());
            deep.write_to(&mut png, image::ImageFormat::Png).unwrap();
            let compressed = CompressedImage {
                header: image.header.clone(),
                format: format.into(),
                data: png.into_inner().into(),
            };
            *m = sent(&topic, m.time, &compressed);
        });
        let input = file.open();
        assert!(input.warnings().is_empty(), "{:?}", input.warnings());
        let found = frames(&input);
        assert_eq!(found.len(), FRAMES, "{topic} {format}");
        assert_eq!(found[2].depth.at(31, 23), 1.136, "{topic} {format}");
    }
}

/// Every second column and row, as a phone measures the same view.
fn half(_: usize, image: Image<'static>) -> Image<'static> {
    let rows = image.data.chunks(2 * WIDTH as usize).step_by(2);
    let data = rows.flat_map(|row| row.chunks(2).step_by(2).flatten().copied());
    Image {
        width: WIDTH / 2,
        height: HEIGHT / 2,
        step: WIDTH,
        data: data.collect::<Vec<u8>>().into(),
        ..image.clone()
    }
}

#[test]
fn half_size_depth_is_read_as_the_same_view() {
    let file = Recorded::new().images(DEPTH, DEPTH, half);
    let input = file.open();
    assert!(
        said(&input).contains("16 x 12 px are taken for the view"),
        "{}",
        said(&input)
    );
    let depth = &frames(&input)[0].depth;
    for (x, y) in [(0, 0), (1, 1), (30, 22), (31, 23)] {
        let (column, row) = (x as u32 / 2 * 2, y as u32 / 2 * 2);
        let expected = f64::from(depth_mm(0, column, row)) / 1000.0;
        assert_eq!(depth.at(x, y), expected as f32, "{x} {y}");
    }
    let strip = Recorded::new().images(DEPTH, DEPTH, |_, mut image| {
        image.height = HEIGHT / 2;
        image.data = image.data[..(WIDTH * HEIGHT) as usize].to_vec().into();
        image
    });
    strip.refused(&["the colour images' proportions", "32 x 12 px"]);
}

#[test]
fn bayer_and_planar_yuv_images_are_read_as_colour() {
    let green = |encoding: &'static str| {
        move |_: usize, image: Image<'static>| {
            let pixels = (WIDTH * HEIGHT) as usize;
            let data = match encoding {
                // Luma 145, chroma of BT.601's green.
                "nv12" => [vec![145; pixels], [54, 34].repeat(pixels / 4)].concat(),
                _ => (0..pixels)
                    .map(|i| {
                        if (i + i / WIDTH as usize) % 2 == 1 {
                            255
                        } else {
                            0
                        }
                    })
                    .collect(),
            };
            Image {
                encoding: encoding.into(),
                step: WIDTH,
                data: data.into(),
                ..image.clone()
            }
        }
    };
    for encoding in ["nv12", "bayer_rggb8"] {
        let file = Recorded::new().images(COLOUR, COLOUR, green(encoding));
        let input = file.open();
        let found = frames(&input);
        assert_eq!(found.len(), FRAMES, "{encoding}");
        // The weight of green.
        assert!(found[0].gray.at(9, 9).abs_diff(149) <= 2, "{encoding}");
    }
    Recorded::new()
        .images(COLOUR, COLOUR, green("bayer_none8"))
        .refused(&["bayer_none8"]);
}

#[test]
fn live_messages_are_validated_like_recorded_ones() {
    let read = |topic: &str| {
        let m = camera("/camera", 1).into_iter().find(|m| m.topic == topic);
        m.unwrap().cdr
    };
    let [colour, depth, info] = [COLOUR, DEPTH, INFO].map(read);
    let colour = ImageMessage::read(&colour, false).unwrap();
    let cdr = depth.clone();
    let depth: Image<'_> = from_bytes(&depth, Format::CdrLittleEndian).unwrap();
    let mut info: CameraInfo<'_> = from_bytes(&info, Format::CdrLittleEndian).unwrap();
    let new = |depth: &ImageMessage<'_>, info: &CameraInfo<'_>| {
        let topic = |topic, message, info| IncomingTopic {
            topic,
            message,
            info,
        };
        Incoming::new(
            &topic(COLOUR, &colour, Some(info)),
            &topic(DEPTH, depth, None),
            &Transforms::default(),
            &OpenOptions::default(),
        )
    };
    let values = depth
        .data
        .chunks(2)
        .flat_map(|b| f32::from(u16::from_le_bytes([b[0], b[1]])).to_le_bytes());
    let floats = Image {
        encoding: "32FC1".into(),
        step: 4 * WIDTH,
        data: values.collect::<Vec<u8>>().into(),
        ..depth.clone()
    };
    let noticed = new(&ImageMessage::Raw(floats), &info).unwrap();
    assert!(
        noticed.warnings()[0].ends_with("--depth-scale 1000"),
        "{:?}",
        noticed.warnings()
    );
    let whole: &'static [u8] = cdr.leak();
    let small = ImageMessage::Raw(half(0, from_bytes(whole, Format::CdrLittleEndian).unwrap()));
    let frame = new(&small, &info)
        .unwrap()
        .frame(FrameId(0), (1.0, 1.0), &colour, &small, false);
    assert_eq!(frame.unwrap().depth.at(31, 23), 1.112);
    info.k[2] = 0.0;
    let refused = new(&ImageMessage::Raw(depth), &info)
        .unwrap_err()
        .to_string();
    assert!(refused.contains("cx = 0.0"), "{refused}");
}
