//! The whole way from an image to boxes, on small graphs made by hand: against an own reference, at sizes that a graph allows
//! or not, with cards that are right or not.
#![allow(clippy::disallowed_methods, clippy::print_stderr, clippy::unwrap_used)]
#![cfg(feature = "onnx")]

mod onnx_common;

use onnx_common::{Graph, conv, flat, int, ints};
use stillpoint_detection::{
    ClassId, Classes, Detection, Detector, Head, InputSize, ModelCard, ModelError, OnnxDetector,
    OnnxOptions, Runtime,
};
use stillpoint_imaging::{ColourImage, FrameId};

const STRIDES: [usize; 3] = [8, 16, 32];

/// Numbers from -1 to 1 that look random.
fn noise(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / 8_388_608.0 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// The weights of the convolution of a map: `depth` x 3, and `depth` offsets.
fn weights(depth: usize, stride: usize) -> (Vec<f32>, Vec<f32>) {
    let scaled = |values: Vec<f32>| values.into_iter().map(|v| 1.5 * v).collect();
    let seed = stride as u64;
    (
        scaled(noise(3 * depth, seed)),
        scaled(noise(depth, seed + 1)),
    )
}

/// One convolution of one pixel per map: every eighth, sixteenth and thirty-second pixel of the image, with random weights. The
/// outputs are called `map8` and so on; the weights are listed among the inputs, as old exporters do.
fn maps(shape: &[usize], depth: usize) -> Graph {
    STRIDES.iter().fold(Graph::new(shape), |graph, &stride| {
        let (w, b) = weights(depth, stride);
        let names = ["w", "b", "map"].map(|n| format!("{n}{stride}"));
        let [w_name, b_name, map] = names.each_ref().map(String::as_str);
        graph
            .floats(w_name, &[depth, 3, 1, 1], &w)
            .input(w_name, &[depth, 3, 1, 1])
            .floats(b_name, &[depth], &b)
            .node("Conv", &["images", w_name, b_name], &[map], &conv(stride))
    })
}

/// Raw maps of YOLOv7 for an input of this shape, with 80 classes.
fn anchors(shape: &[usize]) -> Vec<u8> {
    STRIDES
        .iter()
        .fold(maps(shape, 255), |graph, &stride| {
            let sides = [1, 255, shape[2] / stride, shape[3] / stride];
            let known = (shape[2] > 0).then_some(&sides[..]);
            graph.output(&format!("map{stride}"), known)
        })
        .model()
}

fn options(input: InputSize) -> OnnxOptions {
    OnnxOptions {
        // Nothing is suppressed.
        iou_threshold: 1.0,
        score_threshold: 0.4,
        input,
        ..OnnxOptions::default()
    }
}

fn detector(model: &[u8], input: InputSize) -> OnnxDetector {
    OnnxDetector::from_bytes(model.to_vec(), "m.onnx", &options(input)).unwrap()
}

fn with_card(model: &[u8], card: &ModelCard, input: InputSize) -> Result<OnnxDetector, ModelError> {
    let runtime = Runtime::default();
    OnnxDetector::with_card(
        model.to_vec(),
        "m.onnx",
        Some(card),
        &runtime,
        &options(input),
    )
}

fn coloured(width: usize, height: usize) -> ColourImage {
    let data = noise(3 * width * height, 99)
        .iter()
        .map(|v| (128.0 + 127.0 * v) as u8)
        .collect();
    ColourImage::from_vec(width, height, data).unwrap()
}

/// What YOLOv7's formula makes of the random convolutions of an image that has the input's size, in double precision: class,
/// score and sides, best first.
fn reference(image: &ColourImage, threshold: f64) -> Vec<(usize, f64, [f64; 4])> {
    let (width, height) = (image.width(), image.height());
    let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
    let sizes = [
        [[12.0, 16.0], [19.0, 36.0], [40.0, 28.0]],
        [[36.0, 75.0], [76.0, 55.0], [72.0, 146.0]],
        [[142.0, 110.0], [192.0, 243.0], [459.0, 401.0]],
    ];
    let mut found = Vec::new();
    for (stride, sizes) in STRIDES.into_iter().zip(sizes) {
        let (w, b) = weights(255, stride);
        for (y, x) in (0..height / stride).flat_map(|y| (0..width / stride).map(move |x| (y, x))) {
            let pixel = &image.data()[3 * (y * stride * width + x * stride)..][..3];
            let value = |k: usize| {
                let sum: f64 = (0..3)
                    .map(|c| f64::from(w[3 * k + c]) * f64::from(pixel[c]) / 255.0)
                    .sum();
                sigmoid(sum + f64::from(b[k]))
            };
            for (a, [aw, ah]) in sizes.into_iter().enumerate() {
                let at = |k: usize| value(85 * a + k);
                let class = (0..80)
                    .max_by(|&i, &j| at(5 + i).total_cmp(&at(5 + j)))
                    .unwrap();
                let score = at(4) * at(5 + class);
                if score >= threshold {
                    let cx = (2.0 * at(0) - 0.5 + x as f64) * stride as f64;
                    let cy = (2.0 * at(1) - 0.5 + y as f64) * stride as f64;
                    let (bw, bh) = (4.0 * at(2) * at(2) * aw, 4.0 * at(3) * at(3) * ah);
                    let x_in = |v: f64| (v - 0.5).clamp(-0.5, width as f64 - 0.5);
                    let y_in = |v: f64| (v - 0.5).clamp(-0.5, height as f64 - 0.5);
                    found.push((
                        class,
                        score,
                        [
                            x_in(cx - bw / 2.0),
                            y_in(cy - bh / 2.0),
                            x_in(cx + bw / 2.0),
                            y_in(cy + bh / 2.0),
                        ],
                    ));
                }
            }
        }
    }
    found.retain(|(_, _, [x0, y0, x1, y1])| x0 < x1 && y0 < y1);
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    found
}

fn agrees(found: &[Detection], expected: &[(usize, f64, [f64; 4])]) {
    assert!(expected.len() >= 10, "{}", expected.len());
    assert_eq!(found.len(), expected.len());
    for (d, (class, score, sides)) in found.iter().zip(expected) {
        assert_eq!(usize::from(d.class.0), *class);
        assert!((f64::from(d.score) - score).abs() < 1e-4, "{d:?} {score}");
        let b = d.bounds;
        for (side, expected) in [b.x0, b.y0, b.x1, b.y1].iter().zip(sides) {
            assert!((side - expected).abs() < 1e-2, "{d:?} {sides:?}");
        }
    }
}

#[test]
fn yolov7_on_random_weights_agrees_with_its_formula() {
    let mut detector = detector(&anchors(&[1, 3, 64, 96]), InputSize::Model);
    assert_eq!(detector.card(), &ModelCard::new(Head::YoloAnchors));
    let image = coloured(96, 64);
    let found = detector.detect_image(&image, FrameId(0)).unwrap();
    agrees(&found, &reference(&image, 0.4));
}

/// The same file for other sizes than the one it was exported for.
#[test]
fn a_graph_takes_the_size_of_the_image() {
    let model = anchors(&[1, 3, 96, 96]);
    let mut fit = detector(&model, InputSize::Fit);
    for (width, height) in [(96, 64), (64, 96), (96, 96), (96, 32), (96, 64)] {
        let image = coloured(width, height);
        let found = fit.detect_image(&image, FrameId(0)).unwrap();
        assert_eq!(fit.input_size(), (width, height));
        assert_eq!(fit.info().input, Some((width, height)));
        agrees(&found, &reference(&image, 0.4));
    }
    assert_eq!(fit.remark(), None);
    let fixed = InputSize::Fixed {
        width: 160,
        height: 128,
    };
    let image = coloured(160, 128);
    let found = detector(&model, fixed)
        .detect_image(&image, FrameId(0))
        .unwrap();
    agrees(&found, &reference(&image, 0.4));
    // By its own size the image is padded.
    let mut own = detector(&model, InputSize::Model);
    own.detect_image(&coloured(96, 64), FrameId(0)).unwrap();
    assert_eq!(own.input_size(), (96, 96));
}

#[test]
fn sizes_that_no_cell_fits_are_refused() {
    for (width, height) in [(100, 96), (0, 32), (8192, 32)] {
        let input = InputSize::Fixed { width, height };
        let model = anchors(&[1, 3, 96, 96]);
        let error = OnnxDetector::from_bytes(model, "m", &options(input)).unwrap_err();
        assert!(matches!(error, ModelError::Size { .. }), "{error}");
        assert!(error.to_string().contains("multiples of 32"), "{error}");
    }
}

/// A model that leaves its size free has the one of its card.
#[test]
fn a_free_size_comes_from_the_card() {
    let model = anchors(&[0, 3, 0, 0]);
    let mut card = ModelCard::new(Head::YoloAnchors);
    card.input.size = Some([96, 64]);
    let mut own = with_card(&model, &card, InputSize::Model).unwrap();
    assert_eq!(own.input_size(), (96, 64));
    let image = coloured(96, 64);
    agrees(
        &own.detect_image(&image, FrameId(0)).unwrap(),
        &reference(&image, 0.4),
    );
    // Without a card it is recognised by what comes out of it.
    let known = detector(&model, InputSize::Model);
    assert_eq!(
        (known.input_size(), known.card().head),
        ((640, 640), Head::YoloAnchors)
    );
}

/// Rows of 85 columns from the maps, whose sizes are in the constants of the reshapes, so that no other size runs.
fn rows(shape: &[usize], then: impl Fn(Graph, &str) -> Graph) -> Vec<u8> {
    let mut graph = maps(shape, 85);
    for stride in STRIDES {
        let cells = (shape[2] / stride * (shape[3] / stride)) as i64;
        let names = ["map", "shape", "flat"].map(|n| format!("{n}{stride}"));
        let [map, sides, flat] = names.each_ref().map(String::as_str);
        graph = graph
            .integers(sides, &[1, 85, cells])
            .node("Reshape", &[map, sides], &[flat], &[]);
    }
    let flats = STRIDES.map(|s| format!("flat{s}"));
    let flats = flats.each_ref().map(String::as_str);
    let graph = graph
        .node("Concat", &flats, &["all"], &[int("axis", 2)])
        .node("Transpose", &["all"], &["raw"], &[ints("perm", &[0, 2, 1])])
        .node("Sigmoid", &["raw"], &["rows"], &[]);
    then(graph, "rows").model()
}

#[test]
fn a_graph_that_allows_no_other_size_runs_at_its_own_and_says_so() {
    let model = rows(&[1, 3, 64, 64], |graph, rows| {
        graph.output(rows, Some(&[1, 84, 85]))
    });
    let mut rigid = detector(&model, InputSize::Fit);
    assert_eq!(rigid.card().head, Head::Yolox);
    let mut own = detector(&model, InputSize::Model);
    for (width, height) in [(64, 32), (32, 64), (64, 64)] {
        let image = coloured(width, height);
        let found = rigid.detect_image(&image, FrameId(0)).unwrap();
        assert_eq!(rigid.input_size(), (64, 64));
        assert_eq!(found, own.detect_image(&image, FrameId(0)).unwrap());
    }
    let remark = rigid.remark().unwrap();
    assert!(
        remark.starts_with("m.onnx: the network is run at its own 64x64 px"),
        "{remark}"
    );
    assert!(remark.contains("at 64x32 px it gave"), "{remark}");
    assert_eq!(own.remark(), None);
    let fixed = InputSize::Fixed {
        width: 64,
        height: 32,
    };
    let error = OnnxDetector::from_bytes(model, "m", &options(fixed)).unwrap_err();
    assert!(matches!(error, ModelError::Size { .. }), "{error}");
    assert!(error.to_string().contains("use 64x64 px"), "{error}");
}

/// Coordinates of cells that are part of the graph would be wrong for a size of as many cells.
#[test]
fn decoded_boxes_are_recognised_and_held_against_their_cells() {
    let mut grid = Vec::new();
    for stride in STRIDES {
        for (y, x) in (0..32 / stride).flat_map(|y| (0..64 / stride).map(move |x| (y, x))) {
            let mut row = vec![0.0; 85];
            (row[0], row[1]) = ((x * stride) as f32, (y * stride) as f32);
            grid.extend(row);
        }
    }
    let model = rows(&[1, 3, 32, 64], |graph, rows| {
        graph
            .floats("grid", &[1, 42, 85], &grid)
            .node("Add", &[rows, "grid"], &["boxes"], &[])
            .output("boxes", Some(&[1, 42, 85]))
    });
    // One row per cell is YOLOX's, and so is what goes in.
    let mut upright = detector(&model, InputSize::Fit);
    let mut expected = ModelCard::new(Head::Yolox);
    expected.head = Head::YoloGrid;
    assert_eq!(upright.card(), &expected);
    let found = upright.detect_image(&coloured(32, 64), FrameId(0)).unwrap();
    assert_eq!(upright.input_size(), (64, 32));
    assert!(!found.is_empty() && upright.remark().is_some());

    let card = ModelCard::new(Head::Yolox);
    let error = with_card(&model, &card, InputSize::Model)
        .unwrap_err()
        .to_string();
    assert!(error.contains("head: expected yolox"), "{error}");
    assert!(
        error.contains("boxes in px, as yolo-grid has them"),
        "{error}"
    );
    let raw = rows(&[1, 3, 32, 64], |graph, rows| graph.output(rows, None));
    let card = ModelCard::new(Head::YoloGrid);
    let error = with_card(&raw, &card, InputSize::Model)
        .unwrap_err()
        .to_string();
    assert!(
        error.contains("offsets in cells, as yolox has them"),
        "{error}"
    );
}

#[test]
fn cards_that_contradict_the_model_are_refused() {
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

/// Classes that the card leaves out are not seen; the others have the names that it gives them.
#[test]
fn the_card_names_the_classes() {
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
}

/// A table whose rows do not depend on the image, as suppression inside a network would give it for an input of 64 x 64.
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
fn boxes_of_an_end_to_end_model_are_brought_to_the_image() {
    let model = end_to_end(
        7,
        &[
            0.0, 8.0, 20.0, 16.0, 40.0, 56.0, 0.5, // a chair
            0.0, 8.0, 20.0, 16.0, 40.0, 0.0, 0.9, // a person at its place
            0.0, 8.0, 20.0, 16.0, 41.0, 0.0, 0.8, // another one, which the model left in
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
    let model = end_to_end(6, &[8.0, 20.0, 16.0, 40.0, 0.5, 56.0]);
    let detector = OnnxDetector::from_bytes(model.clone(), "m", &OnnxOptions::default()).unwrap();
    assert_eq!(detector.card().output.columns.len(), 6);
    let error = OnnxDetector::from_bytes(model, "m", &options(input)).unwrap_err();
    assert!(matches!(error, ModelError::Size { .. }), "{error}");
}
