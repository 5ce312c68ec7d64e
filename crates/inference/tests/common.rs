//! Shared by the tests of networks: shared files, if available, and small graphs made by hand.
// Tests may search for files; the crate may not.
#![allow(clippy::disallowed_methods)]

use std::path::{Path, PathBuf};
use stillpoint_imaging::ColourImage;
use stillpoint_inference::wire::Message;
use stillpoint_inference::{
    Head, InputSize, ModelCard, ModelError, OnnxDetector, OnnxOptions, Runtime,
};

/// A file beside the data sets, if it exists.
pub(crate) fn shared(file: &str) -> Option<PathBuf> {
    stillpoint_testdata::beside(file)
}

pub(crate) fn decode(path: &Path) -> ColourImage {
    let decoded = image::open(path).unwrap().to_rgb8();
    let (width, height) = (decoded.width() as usize, decoded.height() as usize);
    // The files that the reference reads: JPEG decoders differ in the last bits.
    if let Some(folder) = std::env::var_os("STILLPOINT_PIXELS") {
        let name = Path::new(path.file_name().unwrap()).with_extension("png");
        decoded.save(Path::new(&folder).join(name)).unwrap();
    }
    ColourImage::from_vec(width, height, decoded.into_raw()).unwrap()
}

pub(crate) fn flat(width: usize, height: usize, value: u8) -> ColourImage {
    ColourImage::from_vec(width, height, vec![value; 3 * width * height]).unwrap()
}

/// Builds an ONNX graph by hand.
#[derive(Default)]
pub(crate) struct Graph {
    fields: Message,
}

impl Graph {
    /// With an image input of this shape; zero denotes a free size.
    pub(crate) fn new(shape: &[usize]) -> Self {
        Self {
            fields: Message::new()
                .field(2, "test")
                .message(11, &port("images", Some(shape))),
        }
    }

    /// Adds a node; attributes are whole messages.
    pub(crate) fn node(
        mut self,
        operator: &str,
        inputs: &[&str],
        outputs: &[&str],
        attributes: &[Message],
    ) -> Self {
        let mut node = inputs.iter().fold(Message::new(), |n, i| n.field(1, i));
        node = outputs.iter().fold(node, |n, o| n.field(2, o));
        node = node.field(4, operator);
        node = attributes.iter().fold(node, |n, a| n.message(5, a));
        self.fields = self.fields.message(1, &node);
        self
    }

    pub(crate) fn floats(mut self, name: &str, shape: &[usize], data: &[f32]) -> Self {
        let bytes: Vec<u8> = data.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.fields = self.fields.message(5, &tensor(name, shape, 1, &bytes));
        self
    }

    pub(crate) fn integers(mut self, name: &str, data: &[i64]) -> Self {
        let bytes: Vec<u8> = data.iter().flat_map(|v| v.to_le_bytes()).collect();
        self.fields = self
            .fields
            .message(5, &tensor(name, &[data.len()], 7, &bytes));
        self
    }

    /// Adds an output; `None` leaves the shape undeclared.
    pub(crate) fn output(mut self, name: &str, shape: Option<&[usize]>) -> Self {
        self.fields = self.fields.message(12, &port(name, shape));
        self
    }

    /// Adds an input, as old exporters list their weights.
    pub(crate) fn input(mut self, name: &str, shape: &[usize]) -> Self {
        self.fields = self.fields.message(11, &port(name, Some(shape)));
        self
    }

    /// Adds a two-dimensional input of 64-bit integers.
    pub(crate) fn integer_input(mut self, name: &str, shape: &[usize]) -> Self {
        self.fields = self.fields.message(11, &typed(name, Some(shape), 7));
        self
    }

    /// Adds a two-dimensional output of 64-bit integers.
    pub(crate) fn integer_output(mut self, name: &str, shape: &[usize]) -> Self {
        self.fields = self.fields.message(12, &typed(name, Some(shape), 7));
        self
    }

    pub(crate) fn model(self) -> Vec<u8> {
        Message::new()
            .integer(1, 8)
            .message(7, &self.fields)
            .message(8, &Message::new().field(1, "").integer(2, 13))
            .into_bytes()
    }
}

pub(crate) fn ints(name: &str, values: &[i64]) -> Message {
    let attribute = Message::new().field(1, name);
    let attribute = values
        .iter()
        .fold(attribute, |a, &v| a.integer(8, v as u64));
    attribute.integer(20, 7)
}

/// Attributes of a 1 x 1 convolution.
pub(crate) fn conv(stride: usize) -> [Message; 4] {
    [
        ints("kernel_shape", &[1, 1]),
        ints("strides", &[stride as i64; 2]),
        ints("dilations", &[1, 1]),
        ints("pads", &[0; 4]),
    ]
}

pub(crate) fn int(name: &str, value: i64) -> Message {
    Message::new()
        .field(1, name)
        .integer(3, value as u64)
        .integer(20, 2)
}

fn tensor(name: &str, shape: &[usize], element: u64, bytes: &[u8]) -> Message {
    shape
        .iter()
        .fold(Message::new(), |t, &s| t.integer(1, s as u64))
        .integer(2, element)
        .field(8, name)
        .field(9, bytes)
}

fn port(name: &str, shape: Option<&[usize]>) -> Message {
    typed(name, shape, 1)
}

/// An input or output of this element type.
fn typed(name: &str, shape: Option<&[usize]>, element: u64) -> Message {
    let mut kind = Message::new().integer(1, element);
    if let Some(shape) = shape {
        let shape = shape.iter().fold(Message::new(), |m, &s| {
            m.message(
                1,
                &match s {
                    0 => Message::new().field(2, "free"),
                    s => Message::new().integer(1, s as u64),
                },
            )
        });
        kind = kind.message(2, &shape);
    }
    Message::new()
        .field(1, name)
        .message(2, &Message::new().message(1, &kind))
}

pub(crate) const STRIDES: [usize; 3] = [8, 16, 32];

/// Pseudo-random numbers from -1 to 1.
pub(crate) fn noise(count: usize, seed: u64) -> Vec<f32> {
    let mut state = seed;
    let mut next = || {
        state = state
            .wrapping_mul(6_364_136_223_846_793_005)
            .wrapping_add(1_442_695_040_888_963_407);
        (state >> 40) as f32 / 8_388_608.0 - 1.0
    };
    (0..count).map(|_| next()).collect()
}

/// Weights of a map's convolution: `depth` x 3, and `depth` offsets.
pub(crate) fn weights(depth: usize, stride: usize) -> (Vec<f32>, Vec<f32>) {
    let scaled = |values: Vec<f32>| values.into_iter().map(|v| 1.5 * v).collect();
    let seed = stride as u64;
    (
        scaled(noise(3 * depth, seed)),
        scaled(noise(depth, seed + 1)),
    )
}

/// One 1 x 1 convolution per map: every eighth, sixteenth and thirty-second pixel of the image, with random weights. The outputs are called
/// `map8` and so on; the weights are listed among the inputs, as old exporters do.
pub(crate) fn maps(shape: &[usize], depth: usize) -> Graph {
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
pub(crate) fn anchors(shape: &[usize]) -> Vec<u8> {
    STRIDES
        .iter()
        .fold(maps(shape, 255), |graph, &stride| {
            let sides = [1, 255, shape[2] / stride, shape[3] / stride];
            let known = (shape[2] > 0).then_some(&sides[..]);
            graph.output(&format!("map{stride}"), known)
        })
        .model()
}

pub(crate) fn options(input: InputSize) -> OnnxOptions {
    OnnxOptions {
        iou_threshold: 1.0,
        score_threshold: 0.4,
        input,
        ..OnnxOptions::default()
    }
}

pub(crate) fn detector(model: &[u8], input: InputSize) -> OnnxDetector {
    OnnxDetector::from_bytes(model.to_vec(), "m.onnx", &options(input)).unwrap()
}

/// A model of raw maps with YOLOv7's anchors in its detector.
pub(crate) fn yolov7(model: &[u8], input: InputSize) -> OnnxDetector {
    with_card(model, &ModelCard::new(Head::YoloAnchors), input).unwrap()
}

pub(crate) fn with_card(
    model: &[u8],
    card: &ModelCard,
    input: InputSize,
) -> Result<OnnxDetector, ModelError> {
    let runtime = Runtime::default();
    OnnxDetector::with_card(
        model.to_vec(),
        "m.onnx",
        Some(card),
        &runtime,
        &options(input),
    )
}

pub(crate) fn coloured(width: usize, height: usize) -> ColourImage {
    let data = noise(3 * width * height, 99)
        .iter()
        .map(|v| (128.0 + 127.0 * v) as u8)
        .collect();
    ColourImage::from_vec(width, height, data).unwrap()
}
