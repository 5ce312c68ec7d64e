//! Recorded checkpoints, imported and run: the results equal those of PyTorch.

use super::small::Small;
use super::support::{Lies, entries, fixture, fixtures, zip};
use rten::{Model, NodeId, ValueView};
use rten_tensor::prelude::*;
use std::path::Path;
use stillpoint_detection::ClassId;
use stillpoint_inference::{Classes, Head, OnnxDetector, OnnxOptions, Resize, Runtime};
use stillpoint_models::import::{HeadKind, Imported, Precision, import_checkpoint};

/// Largest difference due to single precision in outputs of magnitude 1 to 10.
const TOLERANCE: f32 = 1e-3;

/// The image `pattern` of `make_checkpoint.py`.
fn pattern(height: usize, width: usize) -> Vec<f32> {
    let pixels = 0..3 * height * width;
    let mixed = pixels.map(|i| (i as u32).wrapping_mul(2_654_435_761) >> 8);
    mixed.map(|m| m as f32 / 16_777_216.0).collect()
}

/// Outputs of the network for this image, in order, with their shapes.
fn run(onnx: &[u8], height: usize, width: usize) -> Vec<(Vec<usize>, Vec<f32>)> {
    let model = Model::load(onnx.to_vec()).unwrap();
    let input: NodeId = model.input_ids()[0];
    let pixels = pattern(height, width);
    let shape = [1, 3, height, width];
    let image = ValueView::from_shape(shape.as_slice(), pixels.as_slice()).unwrap();
    let outputs = model
        .run(vec![(input, image.into())], model.output_ids(), None)
        .unwrap();
    let read = |value: rten::Value| {
        let shape = value.shape().to_vec();
        let rten::Value::FloatTensor(tensor) = value else {
            panic!("no floats");
        };
        (shape, tensor.into_data().to_vec())
    };
    outputs.into_iter().map(read).collect()
}

fn difference(folder: &Path, name: &str, imported: &Imported, height: usize, width: usize) -> f32 {
    let outputs = run(&imported.onnx, height, width);
    assert_eq!(outputs.len(), 3);
    let classes = imported.report.classes.len();
    let mut largest = 0.0_f32;
    for (stride, (shape, values)) in [8, 16, 32].into_iter().zip(outputs) {
        let expected = [1, 3 * (classes + 5), height / stride, width / stride];
        assert_eq!(shape, expected);
        let bytes = std::fs::read(folder.join(format!("{name}.stride{stride}.f32"))).unwrap();
        let (numbers, rest) = bytes.as_chunks::<4>();
        assert!(rest.is_empty() && numbers.len() == values.len());
        for (number, value) in numbers.iter().zip(values) {
            largest = largest.max((f32::from_le_bytes(*number) - value).abs());
        }
    }
    largest
}

#[test]
fn implicit_head_matches_pytorch() {
    let imported = import_checkpoint(&fixture("idetect.pt"), "idetect").unwrap();
    let report = &imported.report;
    assert_eq!(report.head, HeadKind::ImplicitDetect);
    assert_eq!(report.precision, Precision::Half);
    assert_eq!((report.layers, report.norms), (78, 55));
    assert_eq!(
        (report.network, report.format.as_deref()),
        ("model", Some("3"))
    );
    assert_eq!(report.left_out, ["forklift"]);
    let largest = difference(&fixtures(), "idetect", &imported, 64, 96);
    println!("largest difference to PyTorch: {largest:e}");
    assert!(largest < TOLERANCE, "{largest}");
}

#[test]
fn folded_plain_head_matches_pytorch() {
    let imported = import_checkpoint(&fixture("detect.pt"), "detect").unwrap();
    let report = &imported.report;
    assert_eq!(report.head, HeadKind::Detect);
    assert_eq!(report.precision, Precision::Single);
    assert_eq!((report.layers, report.norms), (78, 0));
    // The network under "model" there is a decoy.
    assert_eq!(report.network, "ema");
    let largest = difference(&fixtures(), "detect", &imported, 32, 64);
    println!("largest difference to PyTorch: {largest:e}");
    assert!(largest < TOLERANCE, "{largest}");
}

/// With `STILLPOINT_CHECKPOINTS=DIR` after `make_checkpoint.py --full DIR`: the network's full width.
#[test]
#[ignore = "needs the 12 MB that make_checkpoint.py --full writes, in STILLPOINT_CHECKPOINTS"]
fn full_width_checkpoint_matches_pytorch() {
    let folder = std::env::var_os("STILLPOINT_CHECKPOINTS");
    let folder = folder.expect("STILLPOINT_CHECKPOINTS names the folder with full.pt");
    let bytes = std::fs::read(Path::new(&folder).join("full.pt")).unwrap();
    let imported = import_checkpoint(&bytes, "full").unwrap();
    println!("{}", imported.report);
    assert_eq!(imported.card.classes, Classes::Coco);
    let largest = difference(Path::new(&folder), "full", &imported, 192, 256);
    println!("largest difference to PyTorch: {largest:e}");
    assert!(largest < TOLERANCE, "{largest}");
}

#[test]
fn card_takes_anchors_and_classes_of_the_checkpoint() {
    let card = import_checkpoint(&fixture("idetect.pt"), "x").unwrap().card;
    assert_eq!(card.head, Head::YoloAnchors);
    assert_eq!(card.input.size, Some([640, 640]));
    assert_eq!(card.input.resize, Resize::Centre);
    assert_eq!(card.output.strides, [8, 16, 32]);
    // The checkpoint has them in cells and half precision; in pixels they are exact integers.
    let anchors = [
        vec![12.0, 16.0, 19.0, 36.0, 40.0, 28.0],
        vec![36.0, 75.0, 76.0, 55.0, 72.0, 146.0],
        vec![142.0, 110.0, 192.0, 243.0, 459.0, 401.0],
    ];
    assert_eq!(card.output.anchors, anchors);
    let named = |name| ClassId::from_name(name);
    let classes = ["person", "bicycle", "forklift", "dog", "chair", "cup"].map(named);
    assert_eq!(classes[2], None);
    assert_eq!(card.classes, Classes::Listed(classes.to_vec()));
    let coco = import_checkpoint(&fixture("detect.pt"), "x").unwrap().card;
    assert_eq!(coco.classes, Classes::Coco);
}

#[test]
fn detector_accepts_the_imported_network_and_card() {
    for name in ["idetect.pt", "detect.pt"] {
        let imported = import_checkpoint(&fixture(name), name).unwrap();
        let card = Some(&imported.card);
        let (runtime, options) = (Runtime::default(), OnnxOptions::default());
        // Loading tries the network on a grey image.
        let detector = OnnxDetector::with_card(imported.onnx, name, card, &runtime, &options);
        assert_eq!(detector.unwrap().card(), &imported.card);
    }
}

#[test]
fn imported_network_accepts_any_size_in_whole_cells() {
    let imported = import_checkpoint(&fixture("idetect.pt"), "x").unwrap();
    for (height, width) in [(32, 32), (96, 32), (64, 160)] {
        let outputs = run(&imported.onnx, height, width);
        assert_eq!(outputs[0].0, [1, 33, height / 8, width / 8]);
        assert_eq!(outputs[2].0, [1, 33, height / 32, width / 32]);
    }
}

#[test]
fn import_is_deterministic() {
    let bytes = fixture("idetect.pt");
    let files = [(); 2].map(|()| import_checkpoint(&bytes, "x").unwrap().onnx);
    assert_eq!(files[0], files[1]);
}

#[test]
fn unaligned_archive_is_read() {
    let bytes = fixture("idetect.pt");
    let plain = zip(&entries(&bytes), Lies::default());
    assert!(plain.len() < bytes.len());
    let files = [bytes, plain].map(|b| import_checkpoint(&b, "x").unwrap().onnx);
    assert_eq!(files[0], files[1]);
}

#[test]
fn small_network_of_other_layers_is_imported() {
    let imported = import_checkpoint(&Small::default().bytes(), "small").unwrap();
    assert_eq!(imported.report.parameters, 6 * 3 + 6);
    assert_eq!(imported.card.output.strides, [8]);
    assert_eq!(imported.card.output.anchors, [[4.0, 4.0]]);
    let outputs = run(&imported.onnx, 16, 24);
    assert_eq!(outputs[0].0, [1, 6, 2, 3]);
    // Each output is half the sum over the channels of the largest value in its window.
    let image = pattern(16, 24);
    let largest = |channel: usize| {
        let window = (0..8).flat_map(|y| (0..8).map(move |x| (y, x)));
        window.fold(0.0_f32, |m, (y, x)| {
            m.max(image[(channel * 16 + y) * 24 + x])
        })
    };
    let expected = 0.5 * (largest(0) + largest(1) + largest(2));
    assert!((outputs[0].1[0] - expected).abs() < 1e-6);
}
