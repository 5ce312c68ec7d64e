//! Networks: against ONNX Runtime on the shared images, where there are any, and what is refused.
// A test may look for its data; the library may not.
#![allow(clippy::disallowed_methods, clippy::print_stderr, clippy::unwrap_used)]
#![cfg(feature = "onnx")]

use std::path::{Path, PathBuf};
use std::sync::Arc;
use stillpoint_detection::{
    ClassId, DetectError, Detection, Detector, DetectorKind, ModelError, OnnxDetector, OnnxOptions,
};
use stillpoint_imaging::{ColourImage, DepthImage, FrameId, RgbdFrame};

/// The folder that holds models, images and data sets, if it is there.
fn shared(file: &str) -> Option<PathBuf> {
    let data = std::env::var_os("STILLPOINT_DATA").map_or_else(
        || PathBuf::from(concat!(env!("CARGO_MANIFEST_DIR"), "/../../../shared/data")),
        PathBuf::from,
    );
    let path = data.join("..").join(file);
    if path.exists() {
        return Some(path);
    }
    eprintln!("SKIPPED: there is no {}", path.display());
    None
}

fn load(path: &Path, options: &OnnxOptions) -> OnnxDetector {
    OnnxDetector::from_bytes(std::fs::read(path).unwrap(), "yolox_nano", options).unwrap()
}

fn decode(path: &Path) -> ColourImage {
    let decoded = image::open(path).unwrap().to_rgb8();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    // The reference reads these: JPEG decoders differ in the last bits.
    if let Some(folder) = std::env::var_os("STILLPOINT_PIXELS") {
        let name = Path::new(path.file_name().unwrap()).with_extension("png");
        decoded.save(Path::new(&folder).join(name)).unwrap();
    }
    ColourImage::from_vec(width, height, decoded.into_raw()).unwrap()
}

fn frame(colour: Option<ColourImage>, width: usize, height: usize) -> RgbdFrame {
    RgbdFrame {
        id: FrameId(7),
        stamp: 1.5,
        depth_stamp: 1.5,
        gray: stillpoint_imaging::GrayImage::new(width, height),
        colour: colour.map(Arc::new),
        depth: DepthImage::default(),
    }
}

/// The golden detections of an image, best first.
fn golden(image: &str) -> Vec<Detection> {
    let text = include_str!("golden/yolox_nano.csv");
    let rows = text.lines().filter_map(|line| {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |i: usize| columns[i].parse::<f64>().unwrap();
        (columns[0] == image).then(|| Detection {
            class: ClassId::from_name(columns[1]).unwrap(),
            score: number(2) as f32,
            bounds: stillpoint_detection::BoundingBox {
                x0: number(3),
                y0: number(4),
                x1: number(5),
                y1: number(6),
            },
        })
    });
    rows.collect()
}

#[test]
fn boxes_agree_with_onnx_runtime() {
    let images = [
        "images/bus.jpg",
        "images/zidane.jpg",
        "data/fr1_xyz_walkers/rgb/1305031102.175304.jpg",
        "data/fr1_xyz_walkers/rgb/1305031105.711309.jpg",
        "data/fr1_xyz_walkers/rgb/1305031109.043277.jpg",
    ];
    let Some(model) = shared("models/yolox_nano_416.onnx") else {
        return;
    };
    let mut detector = load(&model, &OnnxOptions::default());
    let paths: Vec<PathBuf> = images.into_iter().filter_map(shared).collect();
    let pixels: Vec<ColourImage> = paths.iter().map(|path| decode(path)).collect();
    for (path, image) in paths.iter().zip(&pixels) {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let found = detector.detect_image(image, FrameId(0)).unwrap();
        let expected = golden(name);
        assert!(!expected.is_empty(), "{name} has no golden detections");
        assert_eq!(found.len(), expected.len(), "{name}: {found:?}");
        // Scores that are equal to within the tolerance may change places.
        let mut left = expected;
        for d in &found {
            let place = left.iter().position(|e| {
                let (a, b) = (d.bounds, e.bounds);
                let sides = [a.x0 - b.x0, a.y0 - b.y0, a.x1 - b.x1, a.y1 - b.y1];
                d.class == e.class
                    && (d.score - e.score).abs() <= 1e-3
                    && sides.iter().all(|s| s.abs() <= 0.5)
            });
            let place = place.unwrap_or_else(|| panic!("{name}: no match for {d:?} in {left:?}"));
            left.remove(place);
        }
    }
}

#[test]
fn the_same_image_gives_the_same_bits_with_any_number_of_threads() {
    let (Some(model), Some(picture)) = (
        shared("models/yolox_nano_416.onnx"),
        shared("images/zidane.jpg"),
    ) else {
        return;
    };
    let picture = decode(&picture);
    let mut results = [1, 1, 2].into_iter().map(|threads| {
        let options = OnnxOptions {
            threads,
            ..OnnxOptions::default()
        };
        let mut detector = load(&model, &options);
        let first = detector.detect_image(&picture, FrameId(0)).unwrap();
        assert_eq!(first, detector.detect_image(&picture, FrameId(1)).unwrap());
        first
    });
    let first = results.next().unwrap();
    assert!(!first.is_empty());
    assert!(results.all(|r| r == first));
}

#[test]
fn a_frame_is_told_apart_from_one_that_cannot_be_used() {
    let Some(model) = shared("models/yolox_nano_416.onnx") else {
        return;
    };
    let mut detector = load(&model, &OnnxOptions::default());
    let info = detector.info();
    assert_eq!(
        (info.kind, info.name.as_str()),
        (DetectorKind::Onnx, "yolox_nano")
    );
    assert_eq!(info.sha256.map(|s| s.len()), Some(64));

    let error = detector.detect(&frame(None, 64, 48)).unwrap_err();
    assert_eq!(error, DetectError::NoColour { frame: FrameId(7) });
    let grey = |w: usize, h: usize| ColourImage::from_vec(w, h, vec![90; 3 * w * h]).unwrap();
    let error = detector
        .detect(&frame(Some(grey(32, 48)), 64, 48))
        .unwrap_err();
    assert!(
        error.to_string().contains("64x48 px, found 32x48 px"),
        "{error}"
    );
    assert!(detector.detect(&frame(Some(grey(0, 0)), 0, 0)).is_err());
    // From one pixel to a sliver, every size works.
    for (w, h) in [(1, 1), (1, 2000), (2000, 1), (64, 48), (417, 415)] {
        let found = detector.detect(&frame(Some(grey(w, h)), w, h)).unwrap();
        assert_eq!((found.frame, found.stamp), (FrameId(7), 1.5));
    }
}

#[test]
fn other_models_are_refused_with_what_they_have() {
    let Some(model) = shared("models/picodet_s_416_coco.onnx") else {
        return;
    };
    let options = OnnxOptions::default();
    let error =
        OnnxDetector::from_bytes(std::fs::read(model).unwrap(), "picodet", &options).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, ModelError::Interface { .. }), "{text}");
    for part in [
        "picodet: expected a YOLOX model",
        "image [1, 3, 416, 416]",
        "outputs: ",
        "[1, 2704, 80]",
    ] {
        assert!(text.contains(part), "{part} is not in: {text}");
    }
}

#[test]
fn bytes_that_are_no_model_are_refused() {
    let options = OnnxOptions::default();
    for bytes in [
        vec![],
        b"not a model".to_vec(),
        vec![0; 1000],
        vec![255; 1000],
        vec![8, 7, 58, 0],
    ] {
        let error = OnnxDetector::from_bytes(bytes, "broken", &options).unwrap_err();
        assert!(
            error.to_string().starts_with("broken: expected "),
            "{error}"
        );
    }
}

#[test]
fn a_cut_model_is_refused() {
    let Some(path) = shared("models/yolox_nano_416.onnx") else {
        return;
    };
    let bytes = std::fs::read(path).unwrap();
    for part in [1, 100, 10_000, 1_000_000, bytes.len() - 1] {
        let result =
            OnnxDetector::from_bytes(bytes[..part].to_vec(), "cut", &OnnxOptions::default());
        assert!(result.is_err(), "{part} of {} bytes", bytes.len());
    }
}

#[test]
fn options_out_of_range_are_refused_by_name() {
    let sane = OnnxOptions::default();
    let cases = [
        (
            "score_threshold",
            OnnxOptions {
                score_threshold: 0.0,
                ..sane
            },
        ),
        (
            "score_threshold",
            OnnxOptions {
                score_threshold: f32::NAN,
                ..sane
            },
        ),
        (
            "iou_threshold",
            OnnxOptions {
                iou_threshold: 1.5,
                ..sane
            },
        ),
        ("threads", OnnxOptions { threads: 0, ..sane }),
    ];
    for (name, options) in cases {
        let error = OnnxDetector::from_bytes(vec![], "model", &options).unwrap_err();
        assert!(
            matches!(error, ModelError::Option { option, .. } if option == name),
            "{error}"
        );
    }
}

/// Summaries name the runtime with its version.
#[test]
fn the_runtime_is_the_one_that_is_locked() {
    let Some(model) = shared("models/yolox_nano_416.onnx") else {
        return;
    };
    let runtime = load(&model, &OnnxOptions::default())
        .info()
        .runtime
        .unwrap();
    let (name, version) = runtime.split_once(' ').unwrap();
    let lock =
        std::fs::read_to_string(concat!(env!("CARGO_MANIFEST_DIR"), "/../../Cargo.lock")).unwrap();
    let entry = format!("name = \"{name}\"\nversion = \"{version}\"\n");
    assert!(
        lock.replace("\r\n", "\n").contains(&entry),
        "{runtime} is not in Cargo.lock"
    );
}
