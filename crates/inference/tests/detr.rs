//! Queries with boxes and scores (RT-DETR, D-FINE, DEIM, RF-DETR) on small graphs made by hand, run by all available runtimes and compared
//! with an independent reference in double precision.

use crate::common::{Graph, coloured, conv, int, ints, options, weights, with_card};
use stillpoint_detection::{ClassId, Detection, Detector};
use stillpoint_imaging::{ColourImage, FrameId};
use stillpoint_inference::{Classes, Head, InputSize, ModelCard, ModelError, OnnxDetector};

const WIDTH: usize = 64;
const HEIGHT: usize = 48;
/// A query per cell of 16 px.
const STRIDE: usize = 16;
const QUERIES: usize = (WIDTH / STRIDE) * (HEIGHT / STRIDE);

/// Offset that makes most scores low, and some high.
const OFFSET: f32 = -1.5;

/// Seeds of the random weights of scores and of boxes.
const SCORES: usize = 31;
const BOXES: usize = 57;

/// Scores `[1, queries, classes]` and boxes in fractions, from the colour of each cell's first pixel.
fn queries(shape: &[usize], classes: usize) -> Graph {
    let mut graph = Graph::new(shape);
    for (name, seed, depth) in [("logits", SCORES, classes), ("raw_boxes", BOXES, 4)] {
        let (w, mut b) = weights(depth, seed);
        if seed == SCORES {
            b.iter_mut().for_each(|b| *b += OFFSET);
        }
        let [w_name, b_name, map, sides, flat] =
            ["w", "b", "map", "sides", "flat"].map(|part| format!("{part}_{name}"));
        let perm = [ints("perm", &[0, 2, 1])];
        graph = graph
            .floats(&w_name, &[depth, 3, 1, 1], &w)
            .floats(&b_name, &[depth], &b)
            .integers(&sides, &[1, depth as i64, QUERIES as i64])
            .node(
                "Conv",
                &["images", &w_name, &b_name],
                &[&map],
                &conv(STRIDE),
            )
            .node("Reshape", &[&map, &sides], &[&flat], &[])
            .node("Transpose", &[&flat], &[name], &perm);
    }
    graph.node("Sigmoid", &["raw_boxes"], &["shares"], &[])
}

/// Both outputs under these names, for a fixed input.
fn raw(classes: usize, [scores, boxes]: [&str; 2]) -> Vec<u8> {
    queries(&[1, 3, HEIGHT, WIDTH], classes)
        .node("Identity", &["logits"], &[scores], &[])
        .node("Identity", &["shares"], &[boxes], &[])
        .output(boxes, Some(&[1, QUERIES, 4]))
        .output(scores, Some(&[1, QUERIES, classes]))
        .model()
}

/// With the postprocessing of D-FINE's exporter: the best pairs of query and class, and boxes in px of the size in a second input, for any
/// number of images.
fn picked(classes: usize) -> Vec<u8> {
    let axis = |i: i64| [int("axis", i)];
    queries(&[0, 3, HEIGHT, WIDTH], classes)
        .integer_input("orig_target_sizes", &[0, 2])
        .integers("all", &[1, (QUERIES * classes) as i64])
        .integers("most", &[QUERIES as i64])
        .integers("classes", &[classes as i64])
        .integers("halves", &[2])
        .integers("last", &[2])
        .integers("fours", &[1, 1, 4])
        .floats("half", &[1], &[0.5])
        .node("Sigmoid", &["logits"], &["done"], &[])
        .node("Reshape", &["done", "all"], &["row"], &[])
        .node(
            "TopK",
            &["row", "most"],
            &["scores", "index"],
            &[int("axis", 1)],
        )
        .node("Mod", &["index", "classes"], &["labels"], &[])
        .node("Div", &["index", "classes"], &["query"], &[])
        .node("Unsqueeze", &["query", "last"], &["query1"], &[])
        .node("Tile", &["query1", "fours"], &["query4"], &[])
        .node("Split", &["shares"], &["centre", "size"], &axis(2))
        .node("Mul", &["size", "half"], &["radius"], &[])
        .node("Sub", &["centre", "radius"], &["upper"], &[])
        .node("Add", &["centre", "radius"], &["lower"], &[])
        .node("Concat", &["upper", "lower"], &["corners"], &axis(2))
        .node("Cast", &["orig_target_sizes"], &["wh"], &[int("to", 1)])
        .node("Concat", &["wh", "wh"], &["whwh"], &axis(1))
        .node("Mul", &["corners", "whwh"], &["px"], &[])
        .node("GatherElements", &["px", "query4"], &["boxes"], &axis(1))
        .integer_output("labels", &[0, QUERIES])
        .output("boxes", Some(&[0, QUERIES, 4]))
        .output("scores", Some(&[0, QUERIES]))
        .model()
}

/// Class, score and sides, best first: one pair of query and class per query.
fn reference(image: &ColourImage, card: &ModelCard, threshold: f64) -> Vec<(u8, f64, [f64; 4])> {
    let (width, height) = (image.width(), image.height());
    let sigmoid = |x: f64| 1.0 / (1.0 + (-x).exp());
    let classes = card.class_count();
    let mut found = Vec::new();
    for (y, x) in (0..HEIGHT / STRIDE).flat_map(|y| (0..WIDTH / STRIDE).map(move |x| (y, x))) {
        let pixel = &image.data()[3 * (y * STRIDE * width + x * STRIDE)..][..3];
        let values = |depth: usize, seed: usize, offset: f32| -> Vec<f64> {
            let (w, b) = weights(depth, seed);
            let value = |k: usize| {
                let colour = |c: usize| {
                    let level = f64::from(pixel[c]) - f64::from(card.input.mean[c]);
                    level / f64::from(card.input.std[c])
                };
                let sum: f64 = (0..3).map(|c| f64::from(w[3 * k + c]) * colour(c)).sum();
                sigmoid(sum + f64::from(b[k] + offset))
            };
            (0..depth).map(value).collect()
        };
        let b = values(4, BOXES, 0.0);
        let side = |centre: f64, size: f64, sign: f64, whole: usize| {
            let at = (centre + sign * size / 2.0) * whole as f64 - 0.5;
            at.clamp(-0.5, whole as f64 - 0.5)
        };
        let sides = [
            side(b[0], b[2], -1.0, width),
            side(b[1], b[3], -1.0, height),
            side(b[0], b[2], 1.0, width),
            side(b[1], b[3], 1.0, height),
        ];
        for (class, score) in values(classes, SCORES, OFFSET).into_iter().enumerate() {
            found.push((class, score, sides));
        }
    }
    found.sort_by(|a, b| b.1.total_cmp(&a.1));
    found.truncate(QUERIES);
    found.retain(|(_, score, _)| *score >= threshold);
    let known = |(class, score, sides)| Some((card.class(class)?.0, score, sides));
    found.into_iter().filter_map(known).collect()
}

fn agrees(found: &[Detection], expected: &[(u8, f64, [f64; 4])]) {
    assert!(expected.len() >= 5, "{expected:?}");
    assert_eq!(found.len(), expected.len(), "{found:?}\n{expected:?}");
    for (d, (class, score, sides)) in found.iter().zip(expected) {
        assert_eq!(d.class.0, *class);
        assert!((f64::from(d.score) - score).abs() < 1e-4, "{d:?} {score}");
        let b = d.bounds;
        for (side, expected) in [b.x0, b.y0, b.x1, b.y1].iter().zip(sides) {
            assert!((side - expected).abs() < 1e-2, "{d:?} {sides:?}");
        }
    }
}

fn known(model: Vec<u8>) -> OnnxDetector {
    OnnxDetector::from_bytes(model, "m.onnx", &options(InputSize::Fit)).unwrap()
}

#[test]
fn detr_scores_and_boxes_match_the_formula() {
    let image = coloured(WIDTH, HEIGHT);
    for names in [["class", "pred_boxes"], ["a", "b"]] {
        let mut detector = known(raw(80, names));
        assert_eq!(detector.card(), &ModelCard::new(Head::Detr), "{names:?}");
        let found = detector.detect_image(&image, FrameId(0)).unwrap();
        agrees(&found, &reference(&image, detector.card(), 0.4));
    }
}

/// RF-DETR: 91 classes, some of which are unused, and colours by ImageNet's statistics.
#[test]
fn coco91_models_use_imagenet_normalisation() {
    let image = coloured(WIDTH, HEIGHT);
    let mut detector = known(raw(91, ["labels", "dets"]));
    let card = detector.card().clone();
    assert_eq!((card.head, &card.classes), (Head::Detr, &Classes::Coco91));
    assert_eq!(card.input.std[0], 58.395);
    let found = detector.detect_image(&image, FrameId(0)).unwrap();
    agrees(&found, &reference(&image, &card, 0.4));
    // The recognised card can be written and parsed.
    let written = ModelCard::parse("m", &card.to_toml()).unwrap();
    assert_eq!(written, card);
    let with = with_card(&raw(91, ["labels", "dets"]), &written, InputSize::Model);
    assert_eq!(
        with.unwrap().detect_image(&image, FrameId(0)).unwrap(),
        found
    );
}

#[test]
fn detr_labels_boxes_and_scores_match_the_formula() {
    let image = coloured(WIDTH, HEIGHT);
    let mut detector = known(picked(80));
    assert_eq!(detector.card(), &ModelCard::new(Head::Detr));
    let found = detector.detect_image(&image, FrameId(0)).unwrap();
    agrees(&found, &reference(&image, detector.card(), 0.4));
}

/// Images are stretched to the input, whatever their aspect.
#[test]
fn detr_boxes_scale_with_a_stretched_image() {
    let image = ColourImage::from_vec(200, 90, [90, 140, 60].repeat(200 * 90)).unwrap();
    for model in [raw(80, ["class", "pred_boxes"]), picked(80)] {
        let mut detector = known(model);
        let found = detector.detect_image(&image, FrameId(0)).unwrap();
        assert_eq!(detector.input_size(), (WIDTH, HEIGHT));
        assert_eq!(detector.remark(), None);
        agrees(&found, &reference(&image, detector.card(), 0.4));
    }
}

#[test]
fn unsupported_sizes_and_classes_are_refused() {
    let input = InputSize::Fixed {
        width: 32,
        height: 48,
    };
    let model = raw(80, ["class", "pred_boxes"]);
    let error = OnnxDetector::from_bytes(model, "m", &options(input)).unwrap_err();
    assert!(matches!(error, ModelError::Size { .. }), "{error}");

    let three = raw(3, ["class", "pred_boxes"]);
    let error = OnnxDetector::from_bytes(three.clone(), "m.onnx", &options(InputSize::Fit));
    let text = error.unwrap_err().to_string();
    assert!(text.contains("output  class [1, 12, 3]"), "{text}");
    assert!(
        text.contains("\n  detr          scores [1, queries"),
        "{text}"
    );
    let error = with_card(&three, &ModelCard::new(Head::Detr), InputSize::Fit).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("head: expected detr with scores [1, n, 80]"),
        "{text}"
    );
    assert!(text.contains("(pred_boxes, class)"), "{text}");

    let mut card = ModelCard::new(Head::Detr);
    card.classes = Classes::Listed(vec![Some(ClassId(56)), None, Some(ClassId::PERSON)]);
    let image = coloured(WIDTH, HEIGHT);
    let mut detector = with_card(&three, &card, InputSize::Fit).unwrap();
    let found = detector.detect_image(&image, FrameId(0)).unwrap();
    assert_eq!(found.len(), reference(&image, &card, 0.4).len());
    assert!(found.iter().all(|d| [0, 56].contains(&d.class.0)));
}

/// Boxes in px where fractions are expected, and an unknown input.
#[test]
fn wrong_units_and_unknown_inputs_are_refused() {
    let sizes = [64.0_f32, 48.0, 64.0, 48.0];
    let model = queries(&[1, 3, HEIGHT, WIDTH], 80)
        .floats("sizes", &[4], &sizes)
        .node("Mul", &["shares", "sizes"], &["boxes"], &[])
        .output("logits", None)
        .output("boxes", None)
        .model();
    let error = OnnxDetector::from_bytes(model, "m", &options(InputSize::Fit)).unwrap_err();
    let text = error.to_string();
    assert!(
        text.contains("expected detr with boxes in shares"),
        "{text}"
    );
    let error = queries(&[1, 3, HEIGHT, WIDTH], 80)
        .integer_input("im_shape", &[1, 2])
        .output("logits", None)
        .output("shares", None)
        .model();
    let error = OnnxDetector::from_bytes(error, "m", &options(InputSize::Fit)).unwrap_err();
    assert!(matches!(error, ModelError::Interface { .. }), "{error}");
    assert!(error.to_string().contains("im_shape [1, 2]"), "{error}");
}

/// The size of the image becomes a constant of the graph, which ONNX Runtime accepts as well.
#[cfg(feature = "onnxruntime")]
#[test]
fn detr_matches_the_formula_in_onnxruntime() {
    use stillpoint_inference::{OnnxRuntime, Runtime};
    let Some(file) = crate::runtimes::library() else {
        return;
    };
    let runtime = Runtime::OnnxRuntime(OnnxRuntime::load(&file).unwrap());
    let image = coloured(WIDTH, HEIGHT);
    for model in [
        raw(80, ["class", "pred_boxes"]),
        raw(91, ["labels", "dets"]),
        picked(80),
    ] {
        let options = options(InputSize::Fit);
        let mut detector = OnnxDetector::with_card(model, "m", None, &runtime, &options).unwrap();
        let found = detector.detect_image(&image, FrameId(0)).unwrap();
        agrees(&found, &reference(&image, detector.card(), 0.4));
    }
}
