//! Runtimes on small networks made here. ONNX Runtime is included if `ORT_DYLIB_PATH` names its library.
// Tests may search for the library; the crate may not.
#![allow(clippy::disallowed_methods, clippy::unwrap_used)]

use super::*;
use crate::wire::Message;

#[cfg_attr(not(feature = "onnxruntime"), allow(unused_mut))]
fn runtimes() -> Vec<Runtime> {
    let mut found = vec![Runtime::Rten];
    #[cfg(feature = "onnxruntime")]
    match std::env::var_os("ORT_DYLIB_PATH") {
        Some(file) => found.push(Runtime::OnnxRuntime(
            OnnxRuntime::load(std::path::Path::new(&file)).unwrap(),
        )),
        None => stillpoint_testdata::skipped("ORT_DYLIB_PATH names no library of ONNX Runtime"),
    }
    found
}

fn noise(count: usize, mut state: u32) -> Vec<f32> {
    (0..count)
        .map(|_| {
            state = state.wrapping_mul(1_664_525).wrapping_add(1_013_904_223);
            (state >> 8) as f32 / (1 << 23) as f32 - 1.0
        })
        .collect()
}

fn port(name: &str, shape: &[&str]) -> Message {
    let dimension = |d: &&str| match d.parse() {
        Ok(size) => Message::new().integer(1, size),
        Err(_) => Message::new().field(2, d),
    };
    let sizes = shape
        .iter()
        .fold(Message::new(), |s, d| s.message(1, &dimension(d)));
    let tensor = Message::new().integer(1, 1).message(2, &sizes);
    let kind = Message::new().message(1, &tensor);
    Message::new().field(1, name).message(2, &kind)
}

fn node(operator: &str, input: &[&str], output: &str) -> Message {
    let inputs = input.iter().fold(Message::new(), |n, i| n.field(1, i));
    inputs.field(2, output).field(4, operator)
}

/// A graph of these nodes after a convolution of 3 x 3 to 8 channels, whose result is `c`.
fn network(nodes: &[Message], outputs: &[(&str, u64)]) -> Vec<u8> {
    let bytes =
        |values: Vec<f32>| -> Vec<u8> { values.iter().flat_map(|v| v.to_le_bytes()).collect() };
    let weights = [8, 3, 3, 3]
        .iter()
        .fold(Message::new(), |t, &s| t.integer(1, s));
    let weights = weights
        .integer(2, 1)
        .field(8, "w")
        .field(9, bytes(noise(216, 1)));
    let bias = Message::new().integer(1, 8).integer(2, 1).field(8, "b");
    let bias = bias.field(9, bytes(noise(8, 2)));
    // `rten` requires attributes that have defaults.
    let integers = |name: &str, values: &[u64]| {
        let attribute = Message::new().field(1, name).integer(20, 7);
        values.iter().fold(attribute, |a, &v| a.integer(8, v))
    };
    let convolution = node("Conv", &["image", "w", "b"], "c")
        .message(5, &integers("strides", &[1, 1]))
        .message(5, &integers("dilations", &[1, 1]))
        .message(5, &integers("pads", &[0, 0, 0, 0]));
    let mut graph = Message::new()
        .message(1, &convolution)
        .field(2, "test")
        .message(5, &weights)
        .message(5, &bias)
        .message(11, &port("image", &["1", "3", "h", "w"]));
    graph = nodes.iter().fold(graph, |g, n| g.message(1, n));
    for &(name, element) in outputs {
        let kind = Message::new().message(1, &Message::new().integer(1, element));
        graph = graph.message(12, &Message::new().field(1, name).message(2, &kind));
    }
    Message::new()
        .integer(1, 8)
        .message(7, &graph)
        .message(8, &Message::new().field(1, "").integer(2, 13))
        .into_bytes()
}

/// Scores and, as integers, their shape.
pub(super) fn scores() -> Vec<u8> {
    network(
        &[
            node("Sigmoid", &["c"], "scores"),
            node("Shape", &["scores"], "shape"),
        ],
        &[("scores", 1), ("shape", 7)],
    )
}

/// The network's expected output, computed directly.
fn expected(planes: &[f32], width: usize, height: usize) -> Vec<f32> {
    let (weights, bias) = (noise(216, 1), noise(8, 2));
    let mut scores = Vec::new();
    for channel in 0..8 {
        for y in 0..height - 2 {
            for x in 0..width - 2 {
                let mut sum = f64::from(bias[channel]);
                for (tap, &weight) in weights[channel * 27..][..27].iter().enumerate() {
                    let (plane, row, column) = (tap / 9, tap / 3 % 3, tap % 3);
                    let at = (plane * height + y + row) * width + x + column;
                    sum += f64::from(weight) * f64::from(planes[at]);
                }
                scores.push((1.0 / (1.0 + libm::exp(-sum))) as f32);
            }
        }
    }
    scores
}

#[test]
fn all_runtimes_compute_the_graph_at_any_size() {
    for runtime in runtimes() {
        for threads in [1, 2] {
            let mut session = load(scores(), "image", threads, &runtime).unwrap();
            for (width, height) in [(16, 12), (32, 20), (16, 12), (3, 3)] {
                let planes = noise(3 * width * height, 3);
                let outputs = session.run(&planes, width, height).unwrap();
                let name = session.runtime();
                let [scores, shape] = &outputs[..] else {
                    panic!("{name}: {outputs:?}");
                };
                assert_eq!(scores.shape, [1, 8, height - 2, width - 2], "{name}");
                let sizes: Vec<f32> = scores.shape.iter().map(|&s| s as f32).collect();
                assert_eq!(
                    (&shape.shape[..], &shape.data),
                    (&[4][..], &sizes),
                    "{name}"
                );
                for (found, expected) in scores.data.iter().zip(expected(&planes, width, height)) {
                    assert!(
                        (found - expected).abs() < 1e-5,
                        "{name}: {found}, {expected}"
                    );
                }
            }
        }
    }
}

#[test]
fn same_image_gives_identical_outputs() {
    let planes = noise(3 * 64 * 48, 4);
    let bits = |outputs: Vec<Tensor>| -> Vec<u32> {
        outputs
            .iter()
            .flat_map(|t| t.data.iter().map(|v| v.to_bits()))
            .collect()
    };
    for runtime in runtimes() {
        let mut first = load(scores(), "image", 1, &runtime).unwrap();
        let mut second = load(scores(), "image", 1, &runtime).unwrap();
        let wanted = bits(first.run(&planes, 64, 48).unwrap());
        for session in [&mut first, &mut second] {
            session.run(&noise(3 * 64 * 48, 5), 64, 48).unwrap();
            let found = bits(session.run(&planes, 64, 48).unwrap());
            assert!(found == wanted, "{}", session.runtime());
        }
    }
}

#[test]
fn runtime_errors_are_single_line_reasons() {
    for runtime in runtimes() {
        let refused = |bytes: Vec<u8>, input: &str| match load(bytes, input, 1, &runtime) {
            Ok(_) => panic!("{runtime:?} took it"),
            Err(reason) => reason,
        };
        let unknown = network(&[node("NoSuchOperator", &["c"], "x")], &[("x", 1)]);
        let reasons = [
            refused(unknown, "image"),
            refused(scores(), "another"),
            refused(b"not a model".to_vec(), "image"),
        ];
        assert!(reasons[0].contains("NoSuchOperator"), "{}", reasons[0]);
        assert!(reasons[1].contains("another"), "{}", reasons[1]);
        let mut session = load(scores(), "image", 1, &runtime).unwrap();
        // Smaller than the convolution; and planes of the wrong size.
        let small = session.run(&noise(12, 0), 2, 2).unwrap_err();
        let short = session.run(&noise(12, 0), 3, 3).unwrap_err();
        for reason in reasons.iter().chain([&small, &short]) {
            assert!(!reason.is_empty() && !reason.contains('\n'), "{reason}");
        }
        // It still works after that.
        assert_eq!(session.run(&noise(27, 0), 3, 3).unwrap().len(), 2);
    }
}

#[test]
fn boolean_outputs_are_refused_or_converted() {
    for runtime in runtimes() {
        // Compares each with itself: booleans, which `rten` keeps as integers.
        let model = network(&[node("Greater", &["c", "c"], "x")], &[("x", 9)]);
        let mut session = load(model, "image", 1, &runtime).unwrap();
        let result = session.run(&noise(27, 0), 3, 3);
        match &runtime {
            Runtime::Rten => {
                let outputs = result.unwrap();
                assert_eq!(outputs[0].shape, [1, 8, 1, 1]);
                assert!(outputs[0].data.iter().all(|&v| v == 0.0));
            }
            #[cfg(feature = "onnxruntime")]
            Runtime::OnnxRuntime(_) => {
                let reason = result.unwrap_err();
                assert!(reason.contains("output of"), "{reason}");
            }
        }
    }
}
