//! Detectable damage: contents that contradict stated sizes or checksums are reported and never used.

use crate::files::{frames, put};
use crate::writers::*;
use image::{DynamicImage, ImageFormat, RgbImage};
use std::io::Cursor;
use stillpoint_imaging::FrameSource;
use stillpoint_recordings::{FrameOptions, OpenOptions, info, open};
use stillpoint_ros_messages::*;

const FRAMES: usize = 10;
/// Bytes at the end of an MCAP without a summary: the data end record, a footer and the signature.
const END: usize = 13 + 29 + 8;

/// Top-level records of an MCAP: their opcodes and bodies.
pub(crate) fn records_of(mut bytes: &[u8]) -> Vec<(u8, Vec<u8>)> {
    let mut all = Vec::new();
    while bytes.len() >= 9 {
        let length = u64::from_le_bytes(bytes[1..9].try_into().unwrap()) as usize;
        all.push((bytes[0], bytes[9..9 + length].to_vec()));
        bytes = &bytes[9 + length..];
    }
    all
}

/// The compression and the decompressed contents of a chunk.
pub(crate) fn chunk_of(body: &[u8]) -> (String, Vec<u8>) {
    let name = u32::from_le_bytes(body[28..32].try_into().unwrap()) as usize;
    let how = String::from_utf8(body[32..32 + name].to_vec()).unwrap();
    let packed = &body[40 + name..];
    let mut unpacked = Vec::new();
    match how.as_str() {
        "lz4" => {
            let mut decoder = lz4_flex::frame::FrameDecoder::new(packed);
            std::io::Read::read_to_end(&mut decoder, &mut unpacked).unwrap();
        }
        _ => unpacked.extend(packed),
    }
    (how, unpacked)
}

/// The body of a chunk of records with their checksum.
pub(crate) fn chunk(how: &str, records: &[u8], crc: u32) -> Vec<u8> {
    let mut body = vec![0; 16];
    body.extend((records.len() as u64).to_le_bytes());
    body.extend(crc.to_le_bytes());
    text(&mut body, how);
    let packed = match how {
        "lz4" => lz4(records),
        "zstd" => {
            ruzstd::encoding::compress_to_vec(records, ruzstd::encoding::CompressionLevel::Fastest)
        }
        _ => records.to_vec(),
    };
    body.extend((packed.len() as u64).to_le_bytes());
    body.extend(packed);
    body
}

/// An MCAP with one compression and checksums in its chunks; `damage` modifies the contents of a numbered chunk after its checksum was
/// computed.
fn sealed(how: &str, damage: impl Fn(usize, &mut Vec<u8>)) -> Vec<u8> {
    let plain = mcap(&camera("/camera", FRAMES), Some((7, false)));
    let mut file = plain[..8].to_vec();
    let mut number = 0;
    for (op, mut body) in records_of(&plain[8..plain.len() - 8]) {
        if op == 6 {
            let (_, mut records) = chunk_of(&body);
            let crc = crc32fast::hash(&records);
            damage(number, &mut records);
            body = chunk(how, &records, crc);
            number += 1;
        }
        record(&mut file, op, &body);
    }
    file.extend(&plain[..8]);
    file
}

/// Doubles the focal lengths in some bytes, by changing one byte each.
fn zoom(bytes: &mut [u8]) {
    let from = 30.0_f64.to_le_bytes();
    let places: Vec<usize> = (0..bytes.len() - 8)
        .filter(|i| bytes[*i..*i + 8] == from)
        .collect();
    for at in places {
        bytes[at..at + 8].copy_from_slice(&60.0_f64.to_le_bytes());
    }
}

#[test]
fn chunk_with_a_wrong_checksum_is_skipped() {
    let dir = tempfile::tempdir().unwrap();
    for how in ["", "lz4", "zstd"] {
        let good = put(dir.path(), "good.mcap", &sealed(how, |_, _| {}));
        let input = open(&good, &OpenOptions::default()).unwrap();
        assert!(input.warnings().is_empty(), "{how}: {:?}", input.warnings());
        assert_eq!(frames(&input).len(), FRAMES, "{how}");
        // The first chunk, which describes the camera.
        let first = sealed(how, |number, records| {
            if number == 0 {
                zoom(records);
            }
        });
        let input = open(
            &put(dir.path(), "first.mcap", &first),
            &OpenOptions::default(),
        )
        .unwrap();
        let said = input.warnings().join("\n");
        assert!(
            said.contains("the chunk at byte") && said.contains("damaged (its CRC-32"),
            "{how}: {said}"
        );
        assert_eq!(input.camera().camera.fx, 30.0, "{how}");
        let left = frames(&input).len();
        assert!((FRAMES - 3..FRAMES).contains(&left), "{how}: {left}");
        // All chunks: nothing usable remains.
        let path = put(
            dir.path(),
            "all.mcap",
            &sealed(how, |_, records| zoom(records)),
        );
        assert!(open(&path, &OpenOptions::default()).is_err(), "{how}");
        let remarks = info(&path).unwrap().remarks;
        let damaged = remarks.iter().filter(|r| r.contains("damaged")).count();
        assert_eq!(damaged, (3 * FRAMES).div_ceil(7), "{how}: {remarks:?}");
    }
}

#[test]
fn zstandard_frame_checksum_is_verified() {
    let dir = tempfile::tempdir().unwrap();
    let whole = mcap(&camera("/camera", FRAMES), None);
    let mut packed =
        ruzstd::encoding::compress_to_vec(&*whole, ruzstd::encoding::CompressionLevel::Fastest);
    let good = put(dir.path(), "good.mcap.zstd", &packed);
    assert_eq!(
        frames(&open(&good, &OpenOptions::default()).unwrap()).len(),
        FRAMES
    );
    *packed.last_mut().unwrap() ^= 1;
    let bad = put(dir.path(), "bad.mcap.zstd", &packed);
    let said = open(&bad, &OpenOptions::default()).unwrap_err().to_string();
    assert!(said.contains("its checksum is"), "{said}");
    // The other files are used.
    let folder = dir.path().join("folder");
    std::fs::create_dir(&folder).unwrap();
    put(&folder, "a_0.mcap.zstd", &packed);
    put(&folder, "a_1.mcap", &whole);
    let input = open(&folder, &OpenOptions::default()).unwrap();
    let said = input.warnings().join("\n");
    assert!(
        said.contains("a file is left out") && said.contains("checksum"),
        "{said}"
    );
    assert_eq!(frames(&input).len(), FRAMES);
}

#[test]
fn data_section_checksum_covers_unchunked_messages() {
    let dir = tempfile::tempdir().unwrap();
    let seal = |mut file: Vec<u8>, from: usize| {
        let end = file.len() - END;
        let crc = crc32fast::hash(&file[from..end]);
        file[end + 9..end + 13].copy_from_slice(&crc.to_le_bytes());
        file
    };
    let plain = mcap(&camera("/camera", FRAMES), None);
    // From the first byte, as by writers, or from the first record, as the specification may be read.
    for from in [0, 8] {
        let path = put(dir.path(), "good.mcap", &seal(plain.clone(), from));
        let input = open(&path, &OpenOptions::default()).unwrap();
        assert!(input.warnings().is_empty(), "{:?}", input.warnings());
        assert_eq!(frames(&input).len(), FRAMES);
    }
    let mut bad = seal(plain.clone(), 0);
    zoom(&mut bad);
    let path = put(dir.path(), "bad.mcap", &bad);
    assert!(open(&path, &OpenOptions::default()).is_err());
    let said = info(&path).unwrap().remarks.join("\n");
    assert!(
        said.contains("30 messages that no checksum") && said.contains("mcap recover"),
        "{said}"
    );
    // Messages in chunks with valid checksums are kept.
    let mut chunks = seal(sealed("lz4", |_, _| {}), 0);
    let end = chunks.len() - END;
    chunks[end + 9] ^= 1;
    let input = open(
        &put(dir.path(), "chunks.mcap", &chunks),
        &OpenOptions::default(),
    )
    .unwrap();
    assert_eq!(frames(&input).len(), FRAMES);
}

fn jpeg(k: usize) -> Vec<u8> {
    let noise = |x: u32, y: u32| image::Rgb([grey(k, x, y); 3]);
    let mut out = Cursor::new(Vec::new());
    DynamicImage::ImageRgb8(RgbImage::from_fn(WIDTH, HEIGHT, noise))
        .write_to(&mut out, ImageFormat::Jpeg)
        .unwrap();
    out.into_inner()
}

/// The same camera with its colour as JPEG, which `cut` may shorten.
fn compressed(cut: impl Fn(usize, &mut Vec<u8>)) -> Vec<Sent> {
    let mut all = camera("/camera", FRAMES);
    let mut k = 0;
    for sent_one in &mut all {
        if sent_one.topic != "/camera/color/image_raw" {
            continue;
        }
        let image: Image<'_> = from_bytes(&sent_one.cdr, Format::CdrLittleEndian).unwrap();
        let mut data = jpeg(k);
        cut(k, &mut data);
        let message = CompressedImage {
            header: image.header.clone(),
            format: "rgb8; jpeg compressed bgr8".into(),
            data: data.into(),
        };
        *sent_one = sent(
            "/camera/color/image_raw/compressed",
            sent_one.time,
            &message,
        );
        k += 1;
    }
    all
}

#[test]
fn truncated_jpeg_is_refused() {
    let dir = tempfile::tempdir().unwrap();
    let third = |k: usize, data: &mut Vec<u8>| {
        if k == 3 {
            data.truncate(data.len() * 2 / 3);
        }
    };
    let path = put(dir.path(), "one.mcap", &mcap(&compressed(third), None));
    let input = open(&path, &OpenOptions::default()).unwrap();
    let mut source = input.frames(&FrameOptions::default()).unwrap();
    let all: Vec<_> = std::iter::from_fn(|| source.next_frame()).collect();
    assert_eq!(all.len(), FRAMES);
    for (k, frame) in all.iter().enumerate() {
        match frame {
            Ok(_) => assert_ne!(k, 3),
            Err(e) => {
                assert_eq!(k, 3);
                assert!(
                    e.recoverable && e.message.contains("cut off: no end of image"),
                    "{}",
                    e.message
                );
            }
        }
    }
    let every = |_: usize, data: &mut Vec<u8>| data.truncate(data.len() - 2);
    let path = put(dir.path(), "all.mcap", &mcap(&compressed(every), None));
    let said = open(&path, &OpenOptions::default())
        .unwrap_err()
        .to_string();
    assert!(
        said.contains("/camera/color/image_raw/compressed") && said.contains("cut off"),
        "{said}"
    );
}

/// The image is refused for its size before its invalid pixels are decoded.
#[test]
fn image_of_another_size_is_not_decoded() {
    let dir = tempfile::tempdir().unwrap();
    let larger = |k: usize, data: &mut Vec<u8>| {
        if k == 3 {
            let mut out = Cursor::new(Vec::new());
            let image = RgbImage::from_fn(320, 200, |x, y| image::Rgb([(x * y) as u8; 3]));
            image.write_to(&mut out, ImageFormat::Png).unwrap();
            *data = out.into_inner();
            data.truncate(data.len() / 2);
        }
    };
    let path = put(dir.path(), "one.mcap", &mcap(&compressed(larger), None));
    let input = open(&path, &OpenOptions::default()).unwrap();
    let mut source = input.frames(&FrameOptions::default()).unwrap();
    let all: Vec<_> = std::iter::from_fn(|| source.next_frame()).collect();
    let said = &all[3].as_ref().unwrap_err().message;
    assert!(said.contains("found 320 x 200 px"), "{said}");
    assert_eq!(all.iter().filter(|f| f.is_ok()).count(), FRAMES - 1);
}

#[test]
fn non_finite_samples_are_counted() {
    let dir = tempfile::tempdir().unwrap();
    let mut all = camera("/camera", FRAMES);
    for k in 0..10_u64 {
        let mut imu = Imu::default();
        imu.header.stamp.sec = 5;
        imu.header.stamp.nanosec = k as u32 * 30_000_000 + 1;
        imu.angular_velocity.y = if k % 4 == 1 { f64::NAN } else { 0.1 };
        all.push(sent("/imu", 5_000_000_000 + k * 30_000_000, &imu));
        let mut odometry = Odometry::default();
        odometry.header.stamp = imu.header.stamp;
        odometry.pose.pose.orientation.w = 1.0;
        odometry.pose.pose.position.x = if k == 7 { f64::INFINITY } else { 0.5 };
        all.push(sent("/odom", 5_000_000_000 + k * 30_000_000, &odometry));
    }
    for (name, bytes) in crate::files::variants(&all) {
        let input = open(&put(dir.path(), name, &bytes), &OpenOptions::default()).unwrap();
        let said = input.warnings().join("\n");
        assert!(
            said.contains("topic /imu: 3 of 10 samples") && said.contains("topic /odom: 1 of 10"),
            "{name}: {said}"
        );
    }
}
