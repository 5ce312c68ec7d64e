//! Right and wrong cards, and models with built-in suppression, on small graphs made by hand.

use crate::common::{Graph, STRIDES, anchors, coloured, conv, flat, maps, options, with_card};
use stillpoint_detection::{ClassId, Detection};
use stillpoint_imaging::FrameId;
use stillpoint_inference::{
    Classes, Head, InputSize, ModelCard, ModelError, OnnxDetector, OnnxOptions, Runtime,
};

#[test]
fn cards_contradicting_the_model_are_refused() {
    let model = anchors(&[1, 3, 64, 64]);
    let base = ModelCard::new(Head::YoloAnchors);
    let refuse = |card: &ModelCard| match with_card(&model, card, InputSize::Fit).unwrap_err() {
        ModelError::Card { key, .. } => key,
        other => panic!("{other}"),
    };
    for head in Head::ALL.into_iter().filter(|&h| h != Head::YoloAnchors) {
        assert_eq!(refuse(&ModelCard::new(head)), "head");
    }
    let mut card = base.clone();
    card.classes = Classes::Listed(vec![Some(ClassId::PERSON); 79]);
    assert_eq!(refuse(&card), "head");
    let error = with_card(&model, &card, InputSize::Fit)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("[1, 252, 8, 8]") && error.contains("[1, 255, 8, 8]"),
        "{error}"
    );
    let mut card = base.clone();
    card.output.sigmoid = true;
    assert_eq!(refuse(&card), "output.sigmoid");
    let mut card = base.clone();
    card.input.size = Some([96, 64]);
    assert_eq!(refuse(&card), "input.size");
    let mut card = base.clone();
    card.output.anchors.clear();
    assert_eq!(refuse(&card), "card");
    assert!(with_card(&model, &base, InputSize::Fit).is_ok());
}

/// Classes that the card omits are not detected; the others have the card's names.
#[test]
fn card_defines_the_classes() {
    let depth = 3 * 7;
    let graph = STRIDES
        .iter()
        .fold(maps(&[1, 3, 64, 64], depth), |graph, stride| {
            graph.output(&format!("map{stride}"), None)
        });
    let model = graph.model();
    assert!(OnnxDetector::from_bytes(model.clone(), "m", &options(InputSize::Fit)).is_err());
    let mut card = ModelCard::new(Head::YoloAnchors);
    let image = coloured(64, 64);
    let mut look = |classes: [Option<u8>; 2]| {
        card.classes = Classes::Listed(classes.map(|c| c.map(ClassId)).to_vec());
        let mut detector = with_card(&model, &card, InputSize::Model).unwrap();
        detector.detect_image(&image, FrameId(0)).unwrap()
    };
    let (both, one) = (look([Some(56), Some(0)]), look([None, Some(0)]));
    assert!(both.iter().any(|d| d.class == ClassId(56)));
    let people: Vec<Detection> = both.into_iter().filter(|d| d.class.0 == 0).collect();
    assert!(!people.is_empty());
    assert_eq!(one, people);
    // Two numbers of one class are one class.
    let same = look([Some(0), Some(0)]);
    assert!(same.iter().all(|d| d.class == ClassId::PERSON));
    let strict = OnnxOptions {
        iou_threshold: 0.3,
        ..options(InputSize::Model)
    };
    let mut count = |classes: [u8; 2]| {
        card.classes = Classes::Listed(classes.map(|c| Some(ClassId(c))).to_vec());
        let runtime = Runtime::default();
        let detector = OnnxDetector::with_card(model.clone(), "m", Some(&card), &runtime, &strict);
        let found = detector.unwrap().detect_image(&image, FrameId(0)).unwrap();
        found.len()
    };
    let (apart, together) = (count([56, 0]), count([0, 0]));
    assert!(0 < together && together < apart, "{together}, {apart}");
}

/// A classifier of six or seven classes is not a table of one box.
#[test]
fn classifiers_are_not_recognised_as_detectors() {
    for columns in [6, 7] {
        let model = end_to_end(columns, &vec![1.0; columns]);
        let error = OnnxDetector::from_bytes(model, "m", &OnnxOptions::default()).unwrap_err();
        assert!(matches!(error, ModelError::Interface { .. }), "{error}");
    }
}

/// A constant table, as built-in suppression would give for an input of 64 x 64.
fn end_to_end(columns: usize, table: &[f32]) -> Vec<u8> {
    Graph::new(&[1, 3, 64, 64])
        .floats("zero", &[1, 3, 1, 1], &[0.0; 3])
        .floats("table", &[table.len() / columns, columns], table)
        .integers("sides", &[1, 1])
        .node("GlobalAveragePool", &["images"], &["mean"], &[])
        .node("Conv", &["mean", "zero"], &["none"], &conv(1))
        .node("Reshape", &["none", "sides"], &["number"], &[])
        .node("Add", &["number", "table"], &["boxes"], &[])
        .output("boxes", None)
        .model()
}

#[test]
fn end_to_end_boxes_are_mapped_to_the_image() {
    let model = end_to_end(
        7,
        &[
            0.0, 8.0, 20.0, 16.0, 40.0, 56.0, 0.5, // a chair
            0.0, 8.0, 20.0, 16.0, 40.0, 0.0, 0.9, // a person at the same place
            0.0, 8.0, 20.0, 16.0, 41.0, 0.0, 0.8, // a duplicate that the model kept
            0.0, 8.0, 0.0, 16.0, 15.0, 0.0, 0.9, // in the padding
        ],
    );
    let mut detector = OnnxDetector::from_bytes(model, "m", &OnnxOptions::default()).unwrap();
    assert_eq!(detector.card().head, Head::EndToEnd);
    // Two to one: half of the input is padding, 16 px above and below, and a pixel of it is two of the image.
    let found = detector
        .detect_image(&flat(128, 64, 9), FrameId(0))
        .unwrap();
    assert_eq!(detector.input_size(), (64, 64));
    let scores: Vec<f32> = found.iter().map(|d| d.score).collect();
    assert_eq!(scores, [0.9, 0.8, 0.5]);
    let b = found[0].bounds;
    assert_eq!([b.x0, b.y0, b.x1, b.y1], [15.5, 7.5, 31.5, 47.5]);
    assert_eq!(found[2].class, ClassId(56));
    let input = InputSize::Fixed {
        width: 64,
        height: 32,
    };
    let row = [8.0, 20.0, 16.0, 40.0, 0.5, 56.0];
    let model = end_to_end(6, &[row, row].concat());
    let detector = OnnxDetector::from_bytes(model.clone(), "m", &OnnxOptions::default()).unwrap();
    assert_eq!(detector.card().output.columns.len(), 6);
    let error = OnnxDetector::from_bytes(model, "m", &options(input)).unwrap_err();
    assert!(matches!(error, ModelError::Size { .. }), "{error}");
}
