//! Networks: repeatability and refusals.

use crate::common::{Graph, conv, decode, flat, shared};
use std::path::Path;
use std::sync::Arc;
use stillpoint_detection::{DetectError, Detector, DetectorKind};
use stillpoint_imaging::{ColourImage, DepthImage, FrameId, RgbdFrame};
use stillpoint_inference::{ModelError, OnnxDetector, OnnxOptions};

fn load(path: &Path, options: &OnnxOptions) -> OnnxDetector {
    OnnxDetector::from_bytes(std::fs::read(path).unwrap(), "yolox_nano", options).unwrap()
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

#[test]
fn results_are_independent_of_the_number_of_threads() {
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
fn unusable_frames_are_refused() {
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
    assert_eq!(info.head.as_deref(), Some("yolox"));
    assert_eq!((info.input, info.threads), (Some((416, 416)), Some(1)));

    let error = detector.detect(&frame(None, 64, 48)).unwrap_err();
    assert_eq!(error, DetectError::NoColour { frame: FrameId(7) });
    let grey = |w: usize, h: usize| flat(w, h, 90);
    let error = detector
        .detect(&frame(Some(grey(32, 48)), 64, 48))
        .unwrap_err();
    assert!(
        error.to_string().contains("64x48 px, found 32x48 px"),
        "{error}"
    );
    assert!(detector.detect(&frame(Some(grey(0, 0)), 0, 0)).is_err());
    // Every size works, from one pixel to a sliver.
    for (w, h) in [(1, 1), (1, 2000), (2000, 1), (64, 48), (417, 415)] {
        let found = detector.detect(&frame(Some(grey(w, h)), w, h)).unwrap();
        assert_eq!((found.frame, found.stamp), (FrameId(7), 1.5));
    }
}

/// The message about an unknown model: its interface, the heads' expectations, and the remedy.
#[test]
fn unknown_models_are_refused_with_their_interface() {
    let mut graph = Graph::new(&[1, 3, 64, 64])
        .floats("weights", &[10, 3, 1, 1], &[0.0; 30])
        .input("weights", &[10, 3, 1, 1])
        .node("Conv", &["images", "weights"], &["scores"], &conv(1))
        .output("scores", Some(&[1, 10, 64, 64]));
    for i in 0..30 {
        let name = format!("copy{i}");
        graph = graph
            .node("Relu", &["scores"], &[&name], &[])
            .output(&name, None);
    }
    let options = OnnxOptions::default();
    let error = OnnxDetector::from_bytes(graph.model(), "models/odd.onnx", &options).unwrap_err();
    let text = error.to_string();
    assert!(matches!(error, ModelError::Interface { .. }), "{text}");
    for part in [
        "models/odd.onnx: expected a detector that is known or has a card, found one with\n",
        "\n  input   images [1, 3, 64, 64]\n",
        "\n  output  scores [1, 10, 64, 64]\n",
        "\n  output  copy0 [1, 10, 64, 64]\n",
        "\n  and 20 more\n",
        "\n  yolox         one output ",
        "\n  end-to-end    one output ",
        "models/odd.toml",
        "  head = \"yolo-grid\"",
    ] {
        assert!(text.contains(part), "{part:?} is not in: {text}");
    }
    assert!(
        text.lines().count() < 30 && text.lines().all(|l| l.len() < 140),
        "{text}"
    );

    // Models that take no images are not even loaded.
    for shape in [&[1_usize, 1, 64, 64][..], &[1, 3, 64], &[4, 3, 64, 64]] {
        let model = Graph::new(shape)
            .node("Relu", &["images"], &["y"], &[])
            .output("y", None)
            .model();
        let error = OnnxDetector::from_bytes(model, "odd", &options).unwrap_err();
        assert!(error.to_string().contains("odd.toml"), "{error}");
    }
    let two = Graph::new(&[1, 3, 64, 64])
        .input("scale", &[1, 2])
        .node("Relu", &["images"], &["y"], &[])
        .output("y", None);
    let error = OnnxDetector::from_bytes(two.model(), "odd", &options).unwrap_err();
    assert!(
        error.to_string().contains("\n  input   scale [1, 2]\n"),
        "{error}"
    );
}

#[test]
fn invalid_model_bytes_are_refused() {
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
fn truncated_model_is_refused() {
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
fn reported_runtime_version_matches_the_lock_file() {
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
