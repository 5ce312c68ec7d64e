//! What recordings say of their cameras and images in ways of their own: taken where all is there that is needed, else refused in words.

use crate::files::{frames, put};
use crate::writers::*;
use std::path::PathBuf;
use stillpoint_imaging::FrameId;
use stillpoint_recordings::{
    ImageMessage, Incoming, IncomingTopic, Input, OpenOptions, Transforms, open,
};
use stillpoint_ros_messages::*;

const FRAMES: usize = 4;
const COLOUR: &str = "/camera/color/image_raw";
const INFO: &str = "/camera/color/camera_info";
const DEPTH: &str = "/camera/aligned_depth_to_color/image_raw";

/// Messages of a camera, kept in a folder until the test ends.
struct Recorded {
    dir: tempfile::TempDir,
    messages: Vec<Sent>,
}

impl Recorded {
    fn new() -> Self {
        Self {
            dir: tempfile::tempdir().unwrap(),
            messages: camera("/camera", FRAMES),
        }
    }

    /// Replaces the messages of a topic; `edit` is told the number of the frame.
    fn edit<M: Message>(mut self, topic: &str, mut edit: impl FnMut(usize, &mut Sent)) -> Self {
        let all = self.messages.iter_mut().filter(|m| m.topic == topic);
        let count = all.enumerate().map(|(k, m)| {
            assert_eq!(m.type_name, M::NAME);
            edit(k, m);
        });
        assert_eq!(count.count(), FRAMES, "{topic}");
        self
    }

    fn infos(self, mut change: impl FnMut(usize, &mut CameraInfo<'static>)) -> Self {
        self.edit::<CameraInfo<'_>>(INFO, |k, m| {
            let bytes: &'static [u8] = m.cdr.clone().leak();
            let mut info: CameraInfo<'static> = from_bytes(bytes, Format::CdrLittleEndian).unwrap();
            change(k, &mut info);
            *m = sent(&m.topic.clone(), m.time, &info);
        })
    }

    fn images(
        self,
        topic: &str,
        to: &str,
        mut change: impl FnMut(usize, Image<'static>) -> Image<'static>,
    ) -> Self {
        self.edit::<Image<'_>>(topic, |k, m| {
            let bytes: &'static [u8] = m.cdr.clone().leak();
            let image = from_bytes(bytes, Format::CdrLittleEndian).unwrap();
            *m = sent(to, m.time, &change(k, image));
        })
    }

    fn rename(mut self, from: &str, to: &str) -> Self {
        let all = self.messages.iter_mut().filter(|m| m.topic == from);
        all.for_each(|m| m.topic = to.to_owned());
        self
    }

    fn path(&self) -> PathBuf {
        put(self.dir.path(), "file.mcap", &mcap(&self.messages, None))
    }

    fn open(&self) -> Input {
        self.open_with(OpenOptions::default()).unwrap()
    }

    fn open_with(&self, options: OpenOptions) -> Result<Input, String> {
        open(&self.path(), &options).map_err(|e| e.to_string())
    }

    /// Refused with all of these words.
    fn refused(&self, parts: &[&str]) {
        let said = self.open_with(OpenOptions::default()).unwrap_err();
        for part in parts {
            assert!(said.contains(part), "{said:?} lacks {part:?}");
        }
    }
}

fn said(input: &Input) -> String {
    [input.guesses(), input.warnings()].concat().join("\n")
}

fn k(input: &Input) -> [f64; 4] {
    let c = input.camera().camera;
    [c.fx, c.fy, c.cx, c.cy]
}

const K: [f64; 4] = [30.0, 30.0, 15.5, 11.5];

#[test]
fn the_first_info_that_holds_a_calibration_is_used() {
    let late = Recorded::new().infos(|i, info| {
        if i < 3 {
            info.k = [0.0; 9];
        }
    });
    let input = late.open();
    assert_eq!(k(&input), K);
    assert!(
        said(&input).contains("first 3 camera infos"),
        "{}",
        said(&input)
    );
    Recorded::new()
        .infos(|_, info| info.k = [0.0; 9])
        .refused(&["a calibrated camera", "fx = 0.0", "--camera"]);
    let projected = Recorded::new().infos(|_, info| {
        info.k = [0.0; 9];
        (info.p[0], info.p[5], info.p[2], info.p[6]) = (31.0, 31.5, 15.0, 11.0);
    });
    let input = projected.open();
    assert_eq!(k(&input), [31.0, 31.5, 15.0, 11.0]);
    assert!(said(&input).contains("projection matrix P"));
}

#[test]
fn figures_that_no_camera_has_are_refused_before_the_run() {
    for (figures, parts) in [
        ([30.0, 30.0, 0.0, 0.0], ["cx = 0.0", "3 to 28 px"]),
        ([30.0, 30.0, 15.5, 23.0], ["cy = 23.0", "principal point"]),
        ([30.0, 1.0, 15.5, 11.5], ["fy = 1.0", "factor of 2"]),
        ([1e-300, 1e-300, 15.5, 11.5], ["fx = 1e-300", "focal"]),
        (
            [30.0, 30.0, -1e6, 11.5],
            ["cx = -1000000.0", "principal point"],
        ),
        ([30.0, 0.0, 0.0, 0.0], ["fy = 0.0", "calibrated"]),
    ] {
        let bad = Recorded::new().infos(|_, info| {
            let [fx, fy, cx, cy] = figures;
            info.k = [fx, 0.0, cx, 0.0, fy, cy, 0.0, 0.0, 1.0];
        });
        bad.refused(&parts);
        bad.refused(&["camera info of /camera/color/image_raw", "--camera"]);
    }
    Recorded::new()
        .infos(|_, info| {
            info.distortion_model = "equidistant".into();
            info.d = vec![10.0, -20.0, 30.0, -40.0];
        })
        .refused(&["lens model that can be inverted", "10.0, -20.0"]);
}

#[test]
fn binning_is_applied_and_a_region_that_does_not_fit_is_said() {
    let binned = Recorded::new().infos(|_, info| {
        (info.width, info.height) = (64, 48);
        info.k = [60.0, 0.0, 31.0, 0.0, 60.0, 23.0, 0.0, 0.0, 1.0];
        (info.binning_x, info.binning_y) = (2, 2);
    });
    assert_eq!(k(&binned.open()), K);
    let beyond = Recorded::new().infos(|_, info| {
        info.k[2] = 23.5;
        info.k[5] = 15.5;
        info.roi = RegionOfInterest {
            x_offset: 8,
            y_offset: 4,
            width: 32,
            height: 24,
            ..RegionOfInterest::default()
        };
    });
    let input = beyond.open();
    assert_eq!(k(&input), K);
    let said = input.warnings().join("\n");
    assert!(
        said.contains("region of interest") && said.contains("does not fit"),
        "{said}"
    );
}

#[test]
fn an_info_of_another_name_is_found_by_frame_and_size() {
    let throttled = || {
        Recorded::new()
            .rename(COLOUR, "/throttled_image")
            .rename(INFO, "/throttled_camera_info")
            .rename(DEPTH, "/throttled_image_depth")
    };
    let input = throttled().open();
    assert_eq!(k(&input), K);
    assert!(
        said(&input).contains("/throttled_camera_info"),
        "{}",
        said(&input)
    );
    // One of another frame is nobody's.
    let mut other = throttled();
    let of = |frame: &'static str, fx: f64| {
        let mut info = CameraInfo {
            width: WIDTH,
            height: HEIGHT,
            k: [fx, 0.0, 15.5, 0.0, fx, 11.5, 0.0, 0.0, 1.0],
            ..CameraInfo::default()
        };
        info.header.frame_id = frame.into();
        info
    };
    other
        .messages
        .push(sent("/other_info", 1, &of("rear", 25.0)));
    assert_eq!(k(&other.open()), K);
    // Two of the same: the user decides.
    other
        .messages
        .push(sent("/second_info", 1, &of("camera_optical", 40.0)));
    other.refused(&[
        "several",
        "/throttled_camera_info",
        "/second_info",
        "--info-topic",
    ]);
    let named = |topic: &str| OpenOptions {
        info_topic: Some(topic.into()),
        ..OpenOptions::default()
    };
    assert_eq!(k(&other.open_with(named("/second_info")).unwrap())[0], 40.0);
    let refused = other.open_with(named("/none")).unwrap_err();
    assert!(
        refused.contains("--info-topic") && refused.contains("/other_info"),
        "{refused}"
    );
    let mut without = throttled();
    without
        .messages
        .retain(|m| m.topic != "/throttled_camera_info");
    without.refused(&["a camera info beside /throttled_image", "--info-topic"]);
}

#[test]
fn what_only_looks_like_depth_has_to_be_named() {
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
fn floats_in_millimetres_are_noticed_and_read_by_their_scale() {
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
fn depth_as_png_of_the_compressed_transport_is_read() {
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
fn depth_of_half_the_size_is_read_as_the_same_view() {
    let input = Recorded::new().images(DEPTH, DEPTH, half).open();
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
fn mosaics_and_planes_are_colour() {
    let green = |encoding: &'static str| {
        move |_: usize, image: Image<'static>| {
            let pixels = (WIDTH * HEIGHT) as usize;
            let data = match encoding {
                // Luminance 145, chroma of BT.601's green.
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
        let input = Recorded::new()
            .images(COLOUR, COLOUR, green(encoding))
            .open();
        let found = frames(&input);
        assert_eq!(found.len(), FRAMES, "{encoding}");
        // The weight of green.
        assert!(found[0].gray.at(9, 9).abs_diff(149) <= 2, "{encoding}");
    }
    Recorded::new()
        .images(COLOUR, COLOUR, green("bayer_none8"))
        .refused(&["bayer_none8"]);
}

/// What a live node decides by is the same.
#[test]
fn incoming_messages_are_judged_alike() {
    let read = |topic: &str| {
        let m = camera("/camera", 1).into_iter().find(|m| m.topic == topic);
        m.unwrap().cdr
    };
    let [colour, depth, info] = [COLOUR, DEPTH, INFO].map(read);
    let colour = ImageMessage::read(&colour, false).unwrap();
    let mut depth: Image<'_> = from_bytes(&depth, Format::CdrLittleEndian).unwrap();
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
    let half = half(
        0,
        Image {
            data: depth.data.to_vec().into(),
            encoding: "16UC1".into(),
            header: Header {
                frame_id: "camera_optical".into(),
                ..Header::default()
            },
            ..image_of(&depth)
        },
    );
    let small = ImageMessage::Raw(half);
    let frame = new(&small, &info)
        .unwrap()
        .frame(FrameId(0), (1.0, 1.0), &colour, &small, false);
    assert_eq!(frame.unwrap().depth.at(31, 23), 1.112);
    depth.encoding = "16UC1".into();
    info.k[2] = 0.0;
    let refused = new(&ImageMessage::Raw(depth), &info)
        .unwrap_err()
        .to_string();
    assert!(refused.contains("cx = 0.0"), "{refused}");
}

/// The same image without its pixels.
fn image_of(image: &Image<'_>) -> Image<'static> {
    Image {
        width: image.width,
        height: image.height,
        step: image.step,
        ..Image::default()
    }
}
