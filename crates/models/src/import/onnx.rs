//! Writes the network as an ONNX file: operators of version 13, with free image size.
//!
//! Field numbers are those of `onnx.proto` (ONNX IR version 8).

use super::fold::{Convolution, Window};
use super::network::{Map, Network, Node, Operation};
use stillpoint_inference::wire::Message;

/// Version of the file's structure; the oldest that has operators of version 13 and 14 in common runtimes.
const IR_VERSION: u64 = 8;
const OPERATORS: u64 = 13;
const IMAGE: &str = "images";

/// Writes the file. `notes` become the model's properties.
pub(super) fn write(network: &Network, name: &str, notes: &[(&str, String)]) -> Vec<u8> {
    let mut graph = Graph::default();
    for (i, node) in network.nodes.iter().enumerate() {
        graph.node(network, i + 1, node);
    }
    let mut message = graph.message.field(2, name);
    message = message.message(11, &port(IMAGE, &network.maps[0]));
    for output in &network.head.outputs {
        let map = &network.maps[output.map];
        message = message.message(12, &port(&value(network, output.map), map));
    }
    let model = Message::new()
        .integer(1, IR_VERSION)
        .field(2, "stillpoint")
        .field(3, env!("CARGO_PKG_VERSION"))
        .message(7, &message)
        .message(8, &Message::new().field(1, "").integer(2, OPERATORS));
    let model = notes.iter().fold(model, |model, (key, text)| {
        model.message(14, &Message::new().field(1, key).field(2, text))
    });
    model.into_bytes()
}

/// Name of a map: those of the head are named by their stride.
fn value(network: &Network, number: usize) -> String {
    if number == 0 {
        return IMAGE.to_owned();
    }
    match network.head.outputs.iter().find(|o| o.map == number) {
        Some(output) => format!("stride{}", output.stride),
        None => format!("map{number}"),
    }
}

/// Description of an input or output [1, channels, height / stride, width / stride].
fn port(name: &str, map: &Map) -> Message {
    let free = |side: &str| {
        let name = match map.stride {
            1 => side.to_owned(),
            stride => format!("{side}/{stride}"),
        };
        Message::new().field(2, name)
    };
    let shape = Message::new()
        .message(1, &Message::new().integer(1, 1))
        .message(1, &Message::new().integer(1, map.channels as u64))
        .message(1, &free("height"))
        .message(1, &free("width"));
    let tensor = Message::new().integer(1, FLOAT).message(2, &shape);
    Message::new()
        .field(1, name)
        .message(2, &Message::new().message(1, &tensor))
}

const FLOAT: u64 = 1;

#[derive(Default)]
struct Graph {
    message: Message,
}

impl Graph {
    fn node(&mut self, network: &Network, number: usize, node: &Node) {
        let inputs: Vec<String> = node.inputs.iter().map(|&i| value(network, i)).collect();
        let inputs: Vec<&str> = inputs.iter().map(String::as_str).collect();
        let output = &value(network, number);
        match &node.operation {
            Operation::Conv(convolution) => self.conv(convolution, &inputs, output, node),
            Operation::LeakyRelu(slope) => {
                self.push(
                    "LeakyRelu",
                    &inputs,
                    output,
                    node,
                    &[float("alpha", *slope)],
                );
            }
            Operation::Relu => self.push("Relu", &inputs, output, node, &[]),
            Operation::Silu => {
                let logistic = format!("{output}.sigmoid");
                self.push("Sigmoid", &inputs, &logistic, node, &[]);
                self.push("Mul", &[inputs[0], &logistic], output, node, &[]);
            }
            Operation::Concat => {
                self.push("Concat", &inputs, output, node, &[integer("axis", 1)]);
            }
            Operation::MaxPool(window) => {
                self.push("MaxPool", &inputs, output, node, &window_attributes(window));
            }
            Operation::Upsample(factor) => self.upsample(*factor, inputs[0], output, node),
        }
    }

    fn conv(&mut self, convolution: &Convolution, inputs: &[&str], output: &str, node: &Node) {
        let [height, width] = convolution.window.kernel;
        let inputs_each = convolution.inputs / convolution.groups;
        let weight = format!("{output}.weight");
        let bias = format!("{output}.bias");
        let shape = [convolution.outputs, inputs_each, height, width];
        self.tensor(&weight, &shape, &convolution.weight);
        self.tensor(&bias, &[convolution.outputs], &convolution.bias);
        let mut attributes = window_attributes(&convolution.window);
        attributes.push(integers("dilations", &convolution.window.dilation));
        attributes.push(integer("group", convolution.groups));
        self.push(
            "Conv",
            &[inputs[0], &weight, &bias],
            output,
            node,
            &attributes,
        );
    }

    /// Nearest pixel, as in PyTorch: pixel i comes from floor(i / factor).
    fn upsample(&mut self, factor: usize, input: &str, output: &str, node: &Node) {
        let scales = format!("{output}.scales");
        let factor = factor as f32;
        self.tensor(&scales, &[4], &[1.0, 1.0, factor, factor]);
        let attributes = [
            text("mode", "nearest"),
            text("coordinate_transformation_mode", "asymmetric"),
            text("nearest_mode", "floor"),
        ];
        self.push("Resize", &[input, "", &scales], output, node, &attributes);
    }

    /// `NodeProto`: inputs 1, outputs 2, name 3, operator 4, attributes 5.
    fn push(
        &mut self,
        operator: &str,
        inputs: &[&str],
        output: &str,
        node: &Node,
        attributes: &[Message],
    ) {
        let message = inputs.iter().fold(Message::new(), |m, i| m.field(1, i));
        let message = message
            .field(2, output)
            .field(3, format!("{}/{operator}", node.path))
            .field(4, operator);
        let message = attributes.iter().fold(message, |m, a| m.message(5, a));
        self.add(1, &message);
    }

    /// `TensorProto`: dimensions 1, type 2, name 8, raw data 9 (little endian).
    fn tensor(&mut self, name: &str, shape: &[usize], values: &[f32]) {
        let mut raw = Vec::with_capacity(4 * values.len());
        for value in values {
            raw.extend_from_slice(&value.to_le_bytes());
        }
        let dimensions = shape.iter();
        let message = dimensions.fold(Message::new(), |m, &d| m.integer(1, d as u64));
        let message = message.integer(2, FLOAT).field(8, name).field(9, raw);
        self.add(5, &message);
    }

    fn add(&mut self, number: u64, message: &Message) {
        self.message = std::mem::take(&mut self.message).message(number, message);
    }
}

fn window_attributes(window: &Window) -> Vec<Message> {
    let [vertical, horizontal] = window.padding;
    vec![
        integers("kernel_shape", &window.kernel),
        integers("strides", &window.stride),
        integers("pads", &[vertical, horizontal, vertical, horizontal]),
    ]
}

/// `AttributeProto`: name 1, float 2, integer 3, text 4, integers 8, type 20.
fn float(name: &str, value: f32) -> Message {
    Message::new().field(1, name).float(2, value).integer(20, 1)
}

fn integer(name: &str, value: usize) -> Message {
    let message = Message::new().field(1, name);
    message.integer(3, value as u64).integer(20, 2)
}

fn text(name: &str, value: &str) -> Message {
    Message::new().field(1, name).field(4, value).integer(20, 3)
}

fn integers(name: &str, values: &[usize]) -> Message {
    let message = Message::new().field(1, name);
    let message = values.iter().fold(message, |m, &v| m.integer(8, v as u64));
    message.integer(20, 7)
}
