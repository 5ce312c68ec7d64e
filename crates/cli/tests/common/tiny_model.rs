//! A network small enough to be made in a test, with the inputs and outputs of YOLOX: it detects a person wherever the image is bright.

use std::path::{Path, PathBuf};
use stillpoint::inference::wire::Message;

/// Width and height of its input, px.
pub const SIZE: u64 = 64;

/// Numbers per cell: box, objectness, COCO's classes.
const COLUMNS: u64 = 85;
const FLOAT: u64 = 1;
const INT64: u64 = 7;

pub fn write(folder: &Path) -> PathBuf {
    let path = folder.join("tiny.onnx");
    std::fs::write(&path, model()).unwrap();
    path
}

/// The model's bytes: on each of three maps, a 1x1 convolution turns the mean of the cell into objectness.
pub fn model() -> Vec<u8> {
    with_offset(0.0)
}

/// The model with an offset added to all its outputs.
pub fn with_offset(offset: f32) -> Vec<u8> {
    let mut graph = Message::new().field(2, "tiny");
    let mut maps = Vec::new();
    for stride in [8, 16, 32] {
        let name = |part: &str| format!("{part}{stride}");
        let [pooled, map, bright, rows] = ["pooled", "map", "bright", "rows"].map(name);
        let square = ints("kernel_shape", &[stride, stride]);
        // Not every runtime has defaults for these.
        let every = ["kernel_shape", "strides", "dilations"].map(|name| ints(name, &[1, 1]));
        let step = ints("strides", &[stride, stride]);
        graph = graph
            .message(
                1,
                &node("AveragePool", &["images"], &pooled, &[square, step]),
            )
            .message(1, &node("Conv", &[&pooled, "weight", "bias"], &map, &every))
            .message(1, &node("Relu", &[&map], &bright, &[]))
            .message(1, &node("Reshape", &[&bright, "shape"], &rows, &[]));
        maps.push(rows);
    }
    let maps: Vec<&str> = maps.iter().map(String::as_str).collect();
    let order = ints("perm", &[0, 2, 1]);
    graph = graph
        .message(1, &node("Concat", &maps, "all", &[int("axis", 2)]))
        .message(1, &node("Transpose", &["all"], "rows", &[order]))
        .message(1, &node("Add", &["rows", "offset"], "output", &[]));
    let floats = |values: &[f32]| values.iter().flat_map(|v| v.to_le_bytes()).collect();
    let shape: Vec<u8> = [1_i64, COLUMNS as i64, -1]
        .iter()
        .flat_map(|v| v.to_le_bytes())
        .collect();
    let (weight, bias) = weights();
    let graph = graph
        .message(
            5,
            &tensor("weight", FLOAT, &[COLUMNS, 3, 1, 1], floats(&weight)),
        )
        .message(5, &tensor("bias", FLOAT, &[COLUMNS], floats(&bias)))
        .message(5, &tensor("shape", INT64, &[3], shape))
        .message(5, &tensor("offset", FLOAT, &[1], floats(&[offset])))
        .message(11, &port("images", &[1, 3, SIZE, SIZE]))
        .message(12, &port("output", &[1, 64 + 16 + 4, COLUMNS]));
    let opset = Message::new().field(1, "").integer(2, 13);
    Message::new()
        .integer(1, 8)
        .message(8, &opset)
        .message(7, &graph)
        .into_bytes()
}

/// Objectness runs from -1 in black to 1 in white, and is clipped below 0: neither padding nor grey is detected.
fn weights() -> (Vec<f32>, Vec<f32>) {
    let mut weight = vec![0.0; 3 * COLUMNS as usize];
    let mut bias = vec![0.0; COLUMNS as usize];
    weight[3 * 4..3 * 5].fill(2.0 / (3.0 * 255.0));
    bias[4] = -1.0;
    // At the centre of the cell, twice its size.
    bias[0..2].fill(0.5);
    bias[2..4].fill(2.0_f32.ln());
    bias[5] = 0.9;
    (weight, bias)
}

pub fn node(operator: &str, inputs: &[&str], output: &str, attributes: &[Message]) -> Message {
    let mut node = Message::new();
    for input in inputs {
        node = node.field(1, input);
    }
    node = node.field(2, output).field(4, operator);
    attributes.iter().fold(node, |n, a| n.message(5, a))
}

fn ints(name: &str, values: &[u64]) -> Message {
    let attribute = Message::new().field(1, name);
    let attribute = values.iter().fold(attribute, |a, v| a.integer(8, *v));
    attribute.integer(20, 7)
}

fn int(name: &str, value: u64) -> Message {
    let attribute = Message::new().field(1, name).integer(3, value);
    attribute.integer(20, 2)
}

pub fn tensor(name: &str, kind: u64, shape: &[u64], bytes: Vec<u8>) -> Message {
    let tensor = shape.iter().fold(Message::new(), |t, n| t.integer(1, *n));
    tensor.integer(2, kind).field(8, name).field(9, bytes)
}

pub fn port(name: &str, shape: &[u64]) -> Message {
    let shape = shape.iter().fold(Message::new(), |s, n| {
        s.message(1, &Message::new().integer(1, *n))
    });
    let tensor = Message::new().integer(1, FLOAT).message(2, &shape);
    let kind = Message::new().message(1, &tensor);
    Message::new().field(1, name).message(2, &kind)
}
