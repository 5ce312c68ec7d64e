//! From an image to boxes, on small graphs made by hand: against an independent reference, and at sizes that a graph allows or not.

use crate::common::{
    Graph, STRIDES, anchors, coloured, detector, int, ints, maps, options, weights, with_card,
    yolov7,
};
use stillpoint_detection::{Detection, Detector};
use stillpoint_imaging::{ColourImage, FrameId};
use stillpoint_inference::{Head, InputSize, ModelCard, ModelError, OnnxDetector};

/// YOLOv7's formula on the random convolutions of an image of the input's size, in double precision: class, score and sides, best first.
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
fn yolov7_with_random_weights_matches_the_formula() {
    let mut detector = yolov7(&anchors(&[1, 3, 64, 96]), InputSize::Model);
    assert_eq!(detector.card(), &ModelCard::new(Head::YoloAnchors));
    let image = coloured(96, 64);
    let found = detector.detect_image(&image, FrameId(0)).unwrap();
    agrees(&found, &reference(&image, 0.4));
}

/// The same file at other sizes than that of its export.
#[test]
fn graph_adapts_to_the_image_size() {
    let model = anchors(&[1, 3, 96, 96]);
    let mut fit = yolov7(&model, InputSize::Fit);
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
    let found = yolov7(&model, fixed)
        .detect_image(&image, FrameId(0))
        .unwrap();
    agrees(&found, &reference(&image, 0.4));
    // At its own size the image is padded.
    let mut own = yolov7(&model, InputSize::Model);
    own.detect_image(&coloured(96, 64), FrameId(0)).unwrap();
    assert_eq!(own.input_size(), (96, 96));
}

#[test]
fn sizes_not_divisible_into_cells_are_refused() {
    for (width, height) in [(100, 96), (0, 32), (8192, 32)] {
        let input = InputSize::Fixed { width, height };
        let model = anchors(&[1, 3, 96, 96]);
        let card = ModelCard::new(Head::YoloAnchors);
        let error = with_card(&model, &card, input).unwrap_err();
        assert!(matches!(error, ModelError::Size { .. }), "{error}");
        assert!(error.to_string().contains("multiples of 32"), "{error}");
    }
}

/// A model that leaves its size free has the one of its card.
#[test]
fn free_input_size_comes_from_the_card() {
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
}

/// Shapes do not depend on the anchors, so a card is required.
#[test]
fn raw_maps_without_a_card_are_refused_with_example_cards() {
    for shape in [&[1, 3, 64, 96], &[0, 3, 0, 0]] {
        let error = OnnxDetector::from_bytes(anchors(shape), "m.onnx", &options(InputSize::Fit));
        let error = error.unwrap_err();
        let raw = matches!(error, ModelError::Interface { raw_maps: true, .. });
        let text = error.to_string();
        assert!(raw, "{text}");
        assert!(text.contains("beside it:\nm.toml\n"), "{text}");
        // Both are valid cards.
        let lines = text.lines().filter(|l| l.starts_with("  anchors = [["));
        let cards: Vec<ModelCard> = lines
            .map(|l| format!("head = \"yolo-anchors\"\n[output]\n{l}"))
            .map(|text| ModelCard::parse("m.toml", &text).unwrap())
            .collect();
        assert_eq!(cards[0], ModelCard::new(Head::YoloAnchors));
        let tiny = cards[1].output.anchors.iter().flatten().copied();
        assert_eq!(tiny.sum::<f32>(), 1760.0);
        assert_eq!(cards.len(), 2);
    }
}

/// Three rows per cell in fractions of the input, as some exporters write them: nothing would be detected.
#[test]
fn rows_in_fractions_of_the_input_are_refused() {
    let shares = rows(&[1, 3, 32, 64], |graph, rows| {
        graph
            .node("Concat", &[rows; 3], &["all3"], &[int("axis", 1)])
            .output("all3", Some(&[1, 126, 85]))
    });
    let grid = ModelCard::new(Head::YoloGrid);
    let known = OnnxDetector::from_bytes(shares.clone(), "m", &options(InputSize::Model));
    for result in [known, with_card(&shares, &grid, InputSize::Model)] {
        let text = result.unwrap_err().to_string();
        assert!(
            text.contains("head: expected yolo-grid with boxes in px"),
            "{text}"
        );
        assert!(text.contains("shares of the input"), "{text}");
    }
}

#[test]
fn oversized_outputs_are_refused_before_allocation() {
    let huge = maps(&[1, 3, 64, 64], 255).output("map8", Some(&[1, 1 << 20, 1 << 20]));
    let error = OnnxDetector::from_bytes(huge.model(), "m", &options(InputSize::Fit)).unwrap_err();
    assert!(error.to_string().contains("67 million numbers"), "{error}");
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
fn fixed_size_graph_runs_at_its_own_size_with_a_remark() {
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
    assert!(remark.contains("1 more sizes failed"), "{remark}");
    assert_eq!(own.remark(), None);
    let fixed = InputSize::Fixed {
        width: 64,
        height: 32,
    };
    let error = OnnxDetector::from_bytes(model, "m", &options(fixed)).unwrap_err();
    assert!(matches!(error, ModelError::Size { .. }), "{error}");
    assert!(error.to_string().contains("use 64x64 px"), "{error}");
}

/// Cell coordinates in the graph would be wrong for another size with the same number of cells.
#[test]
fn decoded_boxes_are_checked_against_their_cells() {
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
    // One row per cell is YOLOX's, and so is the input.
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

/// The maximum number of nodes, in one chain: a thread's stack of two megabytes, as a test's and a detector's have, suffices to prepare and
/// run them.
#[test]
fn longest_accepted_chain_runs() {
    let name = |i: usize| {
        if i == 0 {
            "map8".to_owned()
        } else {
            format!("step{i}")
        }
    };
    let steps = 2499;
    let graph = (0..steps).fold(maps(&[1, 3, 64, 96], 255), |graph, i| {
        graph.node("Relu", &[&name(i)], &[&name(i + 1)], &[])
    });
    let model = graph
        .output(&name(steps), Some(&[1, 255, 8, 12]))
        .output("map16", Some(&[1, 255, 4, 6]))
        .output("map32", Some(&[1, 255, 2, 3]))
        .model();
    let mut chain = yolov7(&model, InputSize::Model);
    assert!(chain.detect_image(&coloured(96, 64), FrameId(0)).is_ok());
}
