//! Rewrites a model's file for another input size. Exporters fix the image size in the graph even if the network itself would take any: in
//! the input's shape, in shapes of intermediate values, and in the constants of reshapes.
//!
//! The new file is a trial: a graph may contain its size in other places too, e.g. in coordinates of all cells. Then it does not run, or
//! its outputs have other shapes than its head expects.

use super::size::Size;
use crate::interface::inner;
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

/// The model with this image input size. Weights that the file lists among its inputs, as old exporters did, are removed from that list,
/// since a runtime cannot optimise weights that might change. Nodes named like a value lose their name, since `rten` confuses the two; the
/// format allows it, and PicoDet's exporter does it. An input `target`, the width and height in px for the network's boxes, becomes a
/// constant: the size of the image input.
///
/// # Errors
/// Damaged fields.
pub(super) fn resized(
    model: &[u8],
    input: &str,
    target: Option<&str>,
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
                    target,
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

struct Patch<'a> {
    input: &'a str,
    /// Name of the input for a width and a height, if any.
    target: Option<&'a str>,
    /// The size in the graph, if it differs.
    own: Option<Size>,
    size: Size,
    weights: BTreeSet<&'a str>,
    /// Names of constants used only as shapes.
    shapes: BTreeSet<&'a str>,
    /// Names of the nodes' inputs and outputs.
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
                    Some(name) if self.target == Some(name) => {
                        copy.message(WEIGHT, &self.constant_of(bytes, name)?)
                    }
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

    fn image(&self, port: &[u8]) -> Result<Message, WireError> {
        let sides = [1, 3, self.size.height, self.size.width];
        let shape = sides.iter().fold(Message::new(), |shape, &side| {
            shape.message(1, &Message::new().integer(1, side as u64))
        });
        with_type(port, |tensor| Ok(without(tensor, 2)?.message(2, &shape)))
    }

    /// The input for a width and a height, as a constant of its type.
    fn constant_of(&self, port: &[u8], name: &str) -> Result<Message, WireError> {
        let mut element = INT64;
        if let Some(tensor) = inner(port, &[2, 1])? {
            for field in fields(tensor) {
                let field = field?;
                if let (1, Some(kind)) = (field.number, field.value.integer()) {
                    element = kind;
                }
            }
        }
        let sides = [self.size.width, self.size.height];
        let data: Vec<u8> = match element {
            FLOAT => sides
                .iter()
                .flat_map(|&s| (s as f32).to_le_bytes())
                .collect(),
            INT32 => sides
                .iter()
                .flat_map(|&s| (s as i32).to_le_bytes())
                .collect(),
            // Sizes have no other type; the runtime refuses it.
            _ => sides
                .iter()
                .flat_map(|&s| (s as i64).to_le_bytes())
                .collect(),
        };
        let shape = Message::new().integer(1, 1).integer(1, 2);
        Ok(shape.integer(2, element).field(8, name).field(9, data))
    }

    /// A node that changes: a `Constant` that holds a shape, or one named like a value.
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

    /// A shape that ends with a map's height and width, for the new size. `None` if nothing changes.
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

/// Element types of tensors.
const FLOAT: u64 = 1;
const INT32: u64 = 6;
const INT64: u64 = 7;

/// A shape that ends with a map's height and width at the old input size, for the new size. `None` if it does not, or if the map is
/// ambiguous.
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

/// Names of values used only as the shape of a `Reshape` or the sizes of a `Resize`.
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

/// A tensor's numbers, if they are a one-dimensional array of 64-bit integers.
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

fn without_shape(port: &[u8]) -> Result<Message, WireError> {
    with_type(port, |tensor| without(tensor, 2))
}

/// A port (`ValueInfoProto`) with a changed tensor type: type 2 { tensor 1 { element 1, shape 2 } }.
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

/// A message without the fields of this number.
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
mod tests;
