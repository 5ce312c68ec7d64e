//! A model's file made to take another input size. Exporters write the size of the image into the graph where the network
//! itself would take any: as the input's shape, as shapes of what is computed, and into the constants of reshapes.
//!
//! The new file is a trial: a graph may hold its size in other places too, e.g. coordinates of all cells. Then it does not run,
//! or gives outputs of other shapes than its head expects.

use super::size::Size;
use crate::wire::{Message, Value, WireError, fields, text, varints};
use std::collections::BTreeSet;

/// Fields of `ModelProto`.
const IR_VERSION: u64 = 1;
const GRAPH: u64 = 7;
/// Fields of `GraphProto`.
const NODE: u64 = 1;
const WEIGHT: u64 = 5;
const INPUT: u64 = 11;
const OUTPUT: u64 = 12;
const VALUE_INFO: u64 = 13;

/// The model with its image input of this size. Weights that the file lists among its inputs, as old exporters did, are taken
/// off that list, since a runtime cannot prepare for a weight that might change. Nodes that have the name of a value lose it,
/// since `rten` takes the one for the other; the format allows it, and PicoDet's exporter does it.
///
/// # Errors
/// Damaged fields on the way.
pub(super) fn resized(
    model: &[u8],
    input: &str,
    own: Option<Size>,
    size: Size,
) -> Result<Vec<u8>, WireError> {
    let mut version = 0;
    for field in fields(model) {
        let field = field?;
        if let (IR_VERSION, Some(number)) = (field.number, field.value.integer()) {
            version = number;
        }
    }
    let mut copy = Message::new();
    for field in fields(model) {
        let field = field?;
        copy = match (field.number, field.value.bytes()) {
            (GRAPH, Some(graph)) => {
                let patch = Patch {
                    input,
                    own: own.filter(|own| *own != size),
                    size,
                    // Before version 4 weights had to be inputs.
                    weights: if version >= 4 {
                        weights(graph)?
                    } else {
                        BTreeSet::new()
                    },
                    shapes: shapes(graph)?,
                    values: values(graph)?,
                };
                copy.message(GRAPH, &patch.graph(graph, own == Some(size))?)
            }
            _ => copy.raw(&field),
        };
    }
    Ok(copy.into_bytes())
}

/// What is changed in a graph.
struct Patch<'a> {
    input: &'a str,
    /// The size that is in the graph, if it is another one.
    own: Option<Size>,
    size: Size,
    /// Names of the weights.
    weights: BTreeSet<&'a str>,
    /// Names of the constants that are shapes and nothing else.
    shapes: BTreeSet<&'a str>,
    /// Names of what nodes take and give.
    values: BTreeSet<&'a str>,
}

impl Patch<'_> {
    fn graph(&self, graph: &[u8], same: bool) -> Result<Message, WireError> {
        let mut copy = Message::new();
        for field in fields(graph) {
            let field = field?;
            let Some(bytes) = field.value.bytes() else {
                copy = copy.raw(&field);
                continue;
            };
            copy = match field.number {
                INPUT => match text(bytes, 1)? {
                    Some(name) if name == self.input => copy.message(INPUT, &self.image(bytes)?),
                    Some(name) if self.weights.contains(name) => copy,
                    _ => copy.raw(&field),
                },
                OUTPUT if !same => copy.message(OUTPUT, &without_shape(bytes)?),
                VALUE_INFO if !same => copy,
                WEIGHT => match self.constant(bytes, text(bytes, 8)?)? {
                    Some(tensor) => copy.message(WEIGHT, &tensor),
                    None => copy.raw(&field),
                },
                NODE => match self.node(bytes)? {
                    Some(node) => copy.message(NODE, &node),
                    None => copy.raw(&field),
                },
                _ => copy.raw(&field),
            };
        }
        Ok(copy)
    }

    /// The image input with its size.
    fn image(&self, port: &[u8]) -> Result<Message, WireError> {
        let sides = [1, 3, self.size.height, self.size.width];
        let shape = sides.iter().fold(Message::new(), |shape, &side| {
            shape.message(1, &Message::new().integer(1, side as u64))
        });
        with_type(port, |tensor| Ok(without(tensor, 2)?.message(2, &shape)))
    }

    /// A node that changes: a `Constant` that holds a shape, or one that has the name of a value.
    fn node(&self, node: &[u8]) -> Result<Option<Message>, WireError> {
        // Its only output.
        let output = text(node, 2)?;
        let is_shape =
            text(node, 4)? == Some("Constant") && output.is_some_and(|n| self.shapes.contains(n));
        let is_ambiguous = text(node, 3)?.is_some_and(|n| self.values.contains(n));
        if !is_shape && !is_ambiguous {
            return Ok(None);
        }
        let mut copy = Message::new();
        for field in fields(node) {
            let field = field?;
            copy = match (field.number, field.value.bytes()) {
                (3, _) if is_ambiguous => copy,
                (5, Some(attribute)) if is_shape => {
                    copy.message(5, &self.attribute(attribute, output)?)
                }
                _ => copy.raw(&field),
            };
        }
        Ok(Some(copy))
    }

    /// The attribute of a `Constant` that holds a shape.
    fn attribute(&self, attribute: &[u8], output: Option<&str>) -> Result<Message, WireError> {
        let mut copy = Message::new();
        for field in fields(attribute) {
            let field = field?;
            let changed = match (field.number, field.value.bytes()) {
                (5, Some(tensor)) => self.constant(tensor, output)?,
                _ => None,
            };
            copy = match changed {
                Some(tensor) => copy.message(5, &tensor),
                None => copy.raw(&field),
            };
        }
        Ok(copy)
    }

    /// A shape that ends with a map's height and width, for the new size. `None` where nothing changes.
    fn constant(&self, tensor: &[u8], name: Option<&str>) -> Result<Option<Message>, WireError> {
        let (Some(own), Some(name)) = (self.own, name) else {
            return Ok(None);
        };
        if !self.shapes.contains(name) {
            return Ok(None);
        }
        let new = integers(tensor)?.and_then(|shape| rescaled(&shape, own, self.size));
        Ok(new.map(|shape| {
            let data: Vec<u8> = shape.iter().flat_map(|v| v.to_le_bytes()).collect();
            Message::new()
                .integer(1, shape.len() as u64)
                .integer(2, INT64)
                .field(8, text(tensor, 8).ok().flatten().unwrap_or(name))
                .field(9, data)
        }))
    }
}

/// Element type of a tensor of 64-bit integers.
const INT64: u64 = 7;

/// A shape whose last two sizes are a map's of the old input, with those of the new one. `None` if they are none, or if it is not
/// clear which map's.
fn rescaled(shape: &[i64], own: Size, size: Size) -> Option<Vec<i64>> {
    let (first, &[height, width]) = shape.split_last_chunk()?;
    let cells = |side: usize, stride: usize| side.div_ceil(stride) as i64;
    let mut found: Option<[i64; 2]> = None;
    for stride in [1, 2, 4, 8, 16, 32, 64] {
        if (height, width) != (cells(own.height, stride), cells(own.width, stride)) {
            continue;
        }
        let new = [cells(size.height, stride), cells(size.width, stride)];
        if found.is_some_and(|f| f != new) {
            return None;
        }
        found = Some(new);
    }
    let found = found.filter(|_| first.len() >= 2)?;
    Some([first, &found].concat())
}

/// Names of a graph's weights.
fn weights(graph: &[u8]) -> Result<BTreeSet<&str>, WireError> {
    let mut names = BTreeSet::new();
    for field in fields(graph) {
        let field = field?;
        if let (WEIGHT, Some(tensor)) = (field.number, field.value.bytes()) {
            names.extend(text(tensor, 8)?);
        }
    }
    Ok(names)
}

/// Names of what a graph's nodes take and give.
fn values(graph: &[u8]) -> Result<BTreeSet<&str>, WireError> {
    let mut names = BTreeSet::new();
    for field in fields(graph) {
        let field = field?;
        let (NODE, Some(node)) = (field.number, field.value.bytes()) else {
            continue;
        };
        for field in fields(node) {
            let field = field?;
            if let (1 | 2, Some(name)) = (field.number, field.value.text()) {
                names.insert(name);
            }
        }
    }
    Ok(names)
}

/// Names of a graph's values that serve as the shape of a `Reshape` or the sizes of a `Resize`, and as nothing else.
fn shapes(graph: &[u8]) -> Result<BTreeSet<&str>, WireError> {
    let (mut shapes, mut others) = (BTreeSet::new(), BTreeSet::new());
    for field in fields(graph) {
        let field = field?;
        let (NODE, Some(node)) = (field.number, field.value.bytes()) else {
            continue;
        };
        let place = match text(node, 4)? {
            Some("Reshape") => Some(1),
            Some("Resize") => Some(3),
            _ => None,
        };
        let inputs = fields(node).filter(|f| f.is_ok_and(|f| f.number == 1));
        for (i, input) in inputs.enumerate() {
            if let Some(name) = input?.value.text() {
                let set = if place == Some(i) {
                    &mut shapes
                } else {
                    &mut others
                };
                set.insert(name);
            }
        }
    }
    shapes.retain(|name| !others.contains(name));
    Ok(shapes)
}

/// A tensor's numbers, if they are 64-bit integers in one row.
fn integers(tensor: &[u8]) -> Result<Option<Vec<i64>>, WireError> {
    let (mut is_int64, mut data) = (false, Vec::new());
    for field in fields(tensor) {
        let field = field?;
        match (field.number, field.value) {
            (2, Value::Varint(INT64)) => is_int64 = true,
            (7, Value::Varint(value)) => data.push(value as i64),
            (7, Value::Bytes(packed)) => match varints(packed) {
                Some(values) => data.extend(values.into_iter().map(|v| v as i64)),
                None => return Ok(None),
            },
            (9, Value::Bytes(raw)) => {
                let (numbers, _) = raw.as_chunks::<8>();
                data.extend(numbers.iter().map(|&n| i64::from_le_bytes(n)));
            }
            _ => {}
        }
    }
    Ok(is_int64.then_some(data))
}

/// A port without what is said about its shape.
fn without_shape(port: &[u8]) -> Result<Message, WireError> {
    with_type(port, |tensor| without(tensor, 2))
}

/// A port (`ValueInfoProto`) whose tensor type is changed: type 2 { tensor 1 { element 1, shape 2 } }.
fn with_type(
    port: &[u8],
    change: impl Fn(&[u8]) -> Result<Message, WireError>,
) -> Result<Message, WireError> {
    let mut copy = Message::new();
    for field in fields(port) {
        let field = field?;
        let (2, Some(kind)) = (field.number, field.value.bytes()) else {
            copy = copy.raw(&field);
            continue;
        };
        let mut inner = Message::new();
        for field in fields(kind) {
            let field = field?;
            inner = match (field.number, field.value.bytes()) {
                (1, Some(tensor)) => inner.message(1, &change(tensor)?),
                _ => inner.raw(&field),
            };
        }
        copy = copy.message(2, &inner);
    }
    Ok(copy)
}

/// A message without the fields of a number.
fn without(message: &[u8], number: u64) -> Result<Message, WireError> {
    let mut copy = Message::new();
    for field in fields(message) {
        let field = field?;
        if field.number != number {
            copy = copy.raw(&field);
        }
    }
    Ok(copy)
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::onnx::interface::{Dimension, Interface};

    const SQUARE: Size = Size {
        width: 416,
        height: 416,
    };
    const FLAT: Size = Size {
        width: 416,
        height: 320,
    };

    #[test]
    fn shapes_follow_the_size() {
        for (shape, expected) in [
            (vec![1, 2, 48, 52, 52], Some(vec![1, 2, 48, 40, 52])),
            (vec![1, 255, 13, 13], Some(vec![1, 255, 10, 13])),
            // The border of a map that does not go into whole cells.
            (vec![1, 8, 7, 7], Some(vec![1, 8, 5, 7])),
            (vec![1, 85, -1], None),
            (vec![1, 255, 12, 12], None),
            (vec![52, 52], None),
            (vec![], None),
        ] {
            assert_eq!(rescaled(&shape, SQUARE, FLAT), expected, "{shape:?}");
        }
        // Whether a map of one cell is that of 32 or of 64 px cells is not clear.
        let small = Size {
            width: 32,
            height: 32,
        };
        assert_eq!(rescaled(&[1, 9, 1, 1], small, SQUARE), None);
        assert_eq!(
            rescaled(&[1, 9, 4, 4], small, SQUARE),
            Some(vec![1, 9, 52, 52])
        );
    }

    fn port(name: &str, sides: &[u64]) -> Message {
        let shape = sides.iter().fold(Message::new(), |s, &side| {
            s.message(1, &Message::new().integer(1, side))
        });
        let tensor = Message::new().integer(1, 1).message(2, &shape);
        Message::new()
            .field(1, name)
            .message(2, &Message::new().message(1, &tensor))
            .field(3, "words")
    }

    fn model(version: u64) -> Vec<u8> {
        let packed: Vec<u8> = Message::new()
            .integer(1, 2)
            .field(8, "shape")
            .integer(2, 7)
            .field(7, [1, 3, 52, 52])
            .into_bytes();
        let constant = Message::new()
            .field(2, "constant")
            .field(4, "Constant")
            .message(5, &Message::new().field(1, "value").field(5, &packed));
        let reshape = |shape: &str, name: &str| {
            let node = Message::new().field(1, "x").field(1, shape).field(2, "y");
            node.field(3, name).field(4, "Reshape")
        };
        let graph = Message::new()
            .message(1, &constant)
            .message(1, &reshape("constant", "first"))
            .message(
                1,
                &reshape("shape", if version == 3 { "second" } else { "y" }),
            )
            .field(5, &packed)
            .message(11, &port("images", &[1, 3, 416, 416]))
            .message(11, &port("shape", &[4]))
            .message(12, &port("y", &[1, 3, 52, 52]))
            .message(13, &port("x", &[1, 3, 52, 52]))
            .integer(99, 5);
        let mut model = Message::new()
            .integer(1, version)
            .message(7, &graph)
            .field(98, "unknown");
        model = model.integer(5, 3);
        model.into_bytes()
    }

    fn graph_of(model: &[u8]) -> Vec<u8> {
        let graph = fields(model)
            .map(Result::unwrap)
            .find(|f| f.number == 7)
            .unwrap();
        graph.value.bytes().unwrap().to_vec()
    }

    #[test]
    fn a_file_gets_its_new_size_and_keeps_the_rest() {
        let new = resized(&model(7), "images", Some(SQUARE), FLAT).unwrap();
        let interface = Interface::read(&new).unwrap();
        let fixed = |sides: [u64; 4]| Some(sides.map(Dimension::Fixed).to_vec());
        assert_eq!(interface.inputs.len(), 1);
        assert_eq!(interface.inputs[0].shape, fixed([1, 3, 320, 416]));
        assert_eq!(interface.outputs[0].shape, None);
        let numbers: Vec<u64> = fields(&new).map(|f| f.unwrap().number).collect();
        assert_eq!(numbers, [1, 7, 98, 5], "unknown fields stay");
        let graph = graph_of(&new);
        let numbers: Vec<u64> = fields(&graph).map(|f| f.unwrap().number).collect();
        assert_eq!(
            numbers,
            [1, 1, 1, 5, 11, 12, 99],
            "the weight is no input any more"
        );
        let nodes = fields(&graph).map(Result::unwrap).filter(|f| f.number == 1);
        let names: Vec<_> = nodes
            .map(|f| text(f.value.bytes().unwrap(), 3).unwrap())
            .collect();
        assert_eq!(
            names,
            [None, Some("first"), None],
            "one had the name of a value"
        );
        let mut tensors = Vec::new();
        for field in fields(&graph).map(Result::unwrap) {
            let bytes = field.value.bytes().unwrap_or_default();
            if field.number == 5 {
                tensors.push(bytes.to_vec());
            } else if text(bytes, 4) == Ok(Some("Constant")) {
                let attribute = fields(bytes)
                    .map(Result::unwrap)
                    .find(|f| f.number == 5)
                    .unwrap();
                let attribute = attribute.value.bytes().unwrap();
                let tensor = fields(attribute)
                    .map(Result::unwrap)
                    .find(|f| f.number == 5)
                    .unwrap();
                tensors.push(tensor.value.bytes().unwrap().to_vec());
            }
        }
        assert_eq!(tensors.len(), 2);
        for tensor in tensors {
            assert_eq!(integers(&tensor), Ok(Some(vec![1, 3, 40, 52])));
            assert_eq!(text(&tensor, 8), Ok(Some("shape")));
        }
    }

    #[test]
    fn at_its_own_size_only_the_list_of_inputs_changes() {
        let old = model(7);
        let new = resized(&old, "images", Some(SQUARE), SQUARE).unwrap();
        let interface = Interface::read(&new).unwrap();
        assert_eq!(interface, Interface::read(&old).unwrap());
        assert!(new.len() < old.len());
        // Files of old versions must list their weights.
        assert_eq!(
            resized(&model(3), "images", Some(SQUARE), SQUARE),
            Ok(model(3))
        );
    }

    #[test]
    fn a_cut_graph_is_told() {
        let whole = model(7);
        let mut graph = graph_of(&whole);
        graph.truncate(graph.len() - 1);
        let cut = Message::new().integer(1, 7).field(7, graph).into_bytes();
        assert!(resized(&cut, "images", Some(SQUARE), FLAT).is_err());
    }
}
