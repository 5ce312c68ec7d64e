//! Models made to break their runtime. Each is refused with a message, in bounded time and memory.

use crate::common::{check, stderr, stillpoint, tiny_model};
use stillpoint::inference::wire::Message;

/// Checks that a graph from an image of 64 x 64 px to `output` is refused.
fn refused(graph: &Message, parts: &[&str]) {
    let sizes = [1, 3, 64, 64];
    let graph = Message::new()
        .raw_of(graph)
        .message(11, &tiny_model::port("images", &sizes))
        .message(12, &tiny_model::port("output", &sizes));
    let opset = Message::new().field(1, "").integer(2, 13);
    let model = Message::new()
        .integer(1, 8)
        .message(8, &opset)
        .message(7, &graph);
    refused_bytes(&model.into_bytes(), parts);
}

fn refused_bytes(model: &[u8], parts: &[&str]) {
    let dir = tempfile::tempdir().unwrap();
    let path = dir.path().join("bad.onnx");
    std::fs::write(&path, model).unwrap();
    let output = stillpoint([
        "models",
        "check",
        "--runtime",
        "rten",
        path.to_str().unwrap(),
    ]);
    check(&output, 2, &["error: models check ", "bad.onnx: expected"]);
    check(&output, 2, parts);
    // One message, without panics or traces of a runtime.
    let said = stderr(&output);
    assert!(
        !said.contains("panicked") && !said.contains("stack"),
        "{said}"
    );
}

trait Fields {
    fn raw_of(self, other: &Message) -> Self;
}

impl Fields for Message {
    /// With all fields of another.
    fn raw_of(self, other: &Message) -> Self {
        let bytes = other.clone().into_bytes();
        let fields = stillpoint::inference::wire::fields(&bytes);
        fields.fold(self, |m, field| m.raw(&field.unwrap()))
    }
}

fn node(operator: &str, inputs: &[&str], output: &str) -> Message {
    tiny_model::node(operator, inputs, output, &[])
}

fn integers(name: &str, values: &[i64]) -> Message {
    let raw = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    tiny_model::tensor(name, 7, &[values.len() as u64], raw)
}

#[test]
fn overflowing_tensor_sizes_are_refused() {
    let weight = Message::new()
        .integer(1, 1 << 32)
        .integer(1, 1 << 32)
        .integer(2, 1)
        .field(8, "w");
    refused(
        &Message::new().message(5, &weight),
        &["a tensor of [4294967296, 4294967296]"],
    );
}

#[test]
fn long_chains_and_deep_nesting_are_refused() {
    let step = |g: Message, i: usize| {
        g.message(
            1,
            &node("Relu", &[&format!("x{i}")], &format!("x{}", i + 1)),
        )
    };
    refused(
        &(0..60_000).fold(Message::new(), step),
        &["over 16384 nodes"],
    );
    let nested = (0..2000).fold(Message::new(), |inner, _| {
        let branch = Message::new()
            .field(1, "then_branch")
            .message(6, &inner)
            .integer(20, 5);
        Message::new().message(1, &node("If", &["x"], "y").message(5, &branch))
    });
    refused(&nested, &["over 4 deep"]);
}

#[test]
fn endless_loop_is_refused() {
    let body = Message::new()
        .field(1, "body")
        .message(6, &Message::new())
        .integer(20, 5);
    let endless = node("Loop", &["", "go"], "output").message(5, &body);
    refused(
        &Message::new().message(1, &endless),
        &["a loop whose turns are not stated"],
    );
}

#[test]
fn huge_outputs_are_refused() {
    let shape = integers("s", &[1 << 20, 1 << 20]);
    let graph = Message::new()
        .message(5, &shape)
        .message(1, &node("Expand", &["images", "s"], "output"));
    refused(
        &graph,
        &["an operator Expand that makes 1099511627776 numbers"],
    );
    // Values computed in the graph are only known by running it, which happens in a separate process.
    let side = integers("side", &[1 << 19]);
    let computed = Message::new()
        .message(5, &side)
        .message(1, &node("Mul", &["side", "side"], "s"))
        .message(1, &node("ConstantOfShape", &["s"], "zeros"))
        .message(1, &node("ReduceMax", &["zeros"], "zero"))
        .message(1, &node("Add", &["images", "zero"], "output"));
    refused(&computed, &["found"]);
}

/// A file of some kilobytes whose values double at every step takes no more than the memory of an ordinary detector.
#[cfg(target_os = "linux")]
#[test]
fn exponentially_growing_values_are_refused() {
    let axis = Message::new().field(1, "axis").integer(3, 2).integer(20, 2);
    let step = |graph: Message, i: usize| {
        let (from, to) = (format!("x{i}"), format!("x{}", i + 1));
        let twice = node("Concat", &[&from, &from], &to).message(5, &axis);
        graph.message(1, &twice)
    };
    let first = Message::new().message(1, &node("Relu", &["images"], "x0"));
    let last = node("ReduceMax", &["x30"], "peak");
    let graph = (0..30)
        .fold(first, step)
        .message(1, &last)
        .message(1, &node("Add", &["images", "peak"], "output"));
    refused(
        &graph,
        &["ends the process that runs it", "over 0.9 GB or 8 s"],
    );
}

/// NaN scores reach no threshold: such a network would silently detect nothing.
#[test]
fn networks_returning_nan_are_refused() {
    refused_bytes(
        &tiny_model::with_offset(f32::NAN),
        &["NaN", "values of output 0"],
    );
}
