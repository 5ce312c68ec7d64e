//! Detections against ONNX Runtime in Python, on the shared images if available. `golden/reference.py` writes the files.

use crate::common::{decode, shared};
use stillpoint_detection::{BoundingBox, ClassId, Detection};
use stillpoint_imaging::FrameId;
use stillpoint_inference::{Head, InputSize, OnnxDetector, OnnxOptions};

const IMAGES: [&str; 5] = [
    "images/bus.jpg",
    "images/zidane.jpg",
    "data/fr1_xyz_walkers/rgb/1305031102.175304.jpg",
    "data/fr1_xyz_walkers/rgb/1305031105.711309.jpg",
    "data/fr1_xyz_walkers/rgb/1305031109.043277.jpg",
];

/// At the model's own size, and at four to three.
const SMALL: InputSize = InputSize::Fixed {
    width: 416,
    height: 320,
};

fn detector(model: &str, input: InputSize) -> Option<OnnxDetector> {
    let options = OnnxOptions {
        input,
        ..OnnxOptions::default()
    };
    let bytes = std::fs::read(shared(model)?).unwrap();
    Some(OnnxDetector::from_bytes(bytes, model, &options).unwrap())
}

/// The golden detections of an image, best first.
fn golden(text: &str, image: &str) -> Vec<Detection> {
    let rows = text.lines().filter_map(|line| {
        let columns: Vec<&str> = line.split(',').collect();
        let number = |i: usize| columns[i].parse::<f64>().unwrap();
        (columns[0] == image).then(|| Detection {
            class: ClassId::from_name(columns[1]).unwrap(),
            score: number(2) as f32,
            bounds: BoundingBox {
                x0: number(3),
                y0: number(4),
                x1: number(5),
                y1: number(6),
            },
        })
    });
    rows.collect()
}

/// Largest difference of the sides, px; infinite for different classes or scores.
fn distance(a: &Detection, b: &Detection) -> f64 {
    if a.class != b.class || (a.score - b.score).abs() > 1e-3 {
        return f64::INFINITY;
    }
    let (a, b) = (a.bounds, b.bounds);
    let sides = [a.x0 - b.x0, a.y0 - b.y0, a.x1 - b.x1, a.y1 - b.y1];
    sides.iter().fold(0.0, |most, s| most.max(s.abs()))
}

fn agrees(mut detector: OnnxDetector, text: &str) {
    for path in IMAGES.into_iter().filter_map(shared) {
        let name = path.file_stem().unwrap().to_str().unwrap();
        let found = detector.detect_image(&decode(&path), FrameId(0)).unwrap();
        // Scores that are equal to within the tolerance may change places.
        let mut left = golden(text, name);
        assert!(!left.is_empty(), "{name} has no golden detections");
        assert_eq!(found.len(), left.len(), "{name}: {found:?}");
        for d in &found {
            let place = (0..left.len())
                .min_by(|&i, &j| distance(d, &left[i]).total_cmp(&distance(d, &left[j])))
                .unwrap();
            let off = distance(d, &left[place]);
            assert!(off <= 0.1, "{name}: no match for {d:?} in {left:?}");
            left.remove(place);
        }
    }
}

const YOLOX: &str = "models/yolox_nano_416.onnx";
const PICODET: &str = "models/picodet_s_416_coco.onnx";

#[test]
fn yolox_matches_the_reference_at_its_own_size() {
    if let Some(detector) = detector(YOLOX, InputSize::Model) {
        assert_eq!(detector.card().head, Head::Yolox);
        agrees(detector, include_str!("golden/yolox_nano.csv"));
    }
}

#[test]
fn yolox_matches_the_reference_at_another_size() {
    if let Some(detector) = detector(YOLOX, SMALL) {
        agrees(detector, include_str!("golden/yolox_nano_416x320.csv"));
    }
}

#[test]
fn picodet_matches_the_reference_at_its_own_size() {
    if let Some(detector) = detector(PICODET, InputSize::Model) {
        assert_eq!(detector.card().head, Head::Distribution);
        agrees(detector, include_str!("golden/picodet_s.csv"));
    }
}

/// Its graph holds the size in 20 constants, which are rewritten.
#[test]
fn picodet_matches_the_reference_at_another_size() {
    if let Some(detector) = detector(PICODET, SMALL) {
        agrees(detector, include_str!("golden/picodet_s_416x320.csv"));
    }
}

/// By default the input has the image's aspect: for 640x480 the size of the test above, for others another one.
#[test]
fn input_size_follows_the_image_aspect() {
    for model in [YOLOX, PICODET] {
        let (Some(mut fit), Some(mut fixed)) =
            (detector(model, InputSize::Fit), detector(model, SMALL))
        else {
            return;
        };
        for (file, size) in [
            (IMAGES[2], (416, 320)),
            (IMAGES[0], (320, 416)),
            (IMAGES[1], (416, 256)),
            (IMAGES[3], (416, 320)),
        ] {
            let Some(path) = shared(file) else {
                return;
            };
            let image = decode(&path);
            let found = fit.detect_image(&image, FrameId(0)).unwrap();
            assert_eq!(fit.input_size(), size, "{model} {file}");
            assert!(
                found.iter().any(|d| d.class == ClassId::PERSON),
                "{model} {file}"
            );
            if size == (416, 320) {
                assert_eq!(found, fixed.detect_image(&image, FrameId(0)).unwrap());
            }
        }
        assert_eq!(stillpoint_detection::Detector::remark(&fit), None);
    }
}
