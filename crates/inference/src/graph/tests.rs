//! Files rewritten for another size.

use super::*;
use crate::interface::{Dimension, Interface};

const SQUARE: Size = Size {
    width: 416,
    height: 416,
};
const FLAT: Size = Size {
    width: 416,
    height: 320,
};

#[test]
fn shapes_scale_with_the_input_size() {
    for (shape, expected) in [
        (vec![1, 2, 48, 52, 52], Some(vec![1, 2, 48, 40, 52])),
        (vec![1, 255, 13, 13], Some(vec![1, 255, 10, 13])),
        // A map whose cells extend beyond the input.
        (vec![1, 8, 7, 7], Some(vec![1, 8, 5, 7])),
        (vec![1, 85, -1], None),
        (vec![1, 255, 12, 12], None),
        (vec![52, 52], None),
        (vec![], None),
    ] {
        assert_eq!(rescaled(&shape, SQUARE, FLAT), expected, "{shape:?}");
    }
    // A map of one cell may have 32 or 64 px cells.
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
fn resized_model_keeps_everything_else() {
    let new = resized(&model(7), "images", None, Some(SQUARE), FLAT).unwrap();
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
fn own_size_changes_only_the_input_list() {
    let old = model(7);
    let new = resized(&old, "images", None, Some(SQUARE), SQUARE).unwrap();
    let interface = Interface::read(&new).unwrap();
    assert_eq!(interface, Interface::read(&old).unwrap());
    assert!(new.len() < old.len());
    // Files of old versions must list their weights.
    assert_eq!(
        resized(&model(3), "images", None, Some(SQUARE), SQUARE),
        Ok(model(3))
    );
}

#[test]
fn truncated_graph_is_reported() {
    let whole = model(7);
    let mut graph = graph_of(&whole);
    graph.truncate(graph.len() - 1);
    let cut = Message::new().integer(1, 7).field(7, graph).into_bytes();
    assert!(resized(&cut, "images", None, Some(SQUARE), FLAT).is_err());
}
