//! Networks written value by value: import, and refusals with paths.

use super::small::{self, Small, TensorSpec, V, ints, pool, text};
use super::support::{error_of, message_of, replaced, with_pickle};
use stillpoint_inference::wire;
use stillpoint_models::import::{ImportError, Precision, import_checkpoint};

#[test]
fn class_names_may_be_a_dictionary() {
    let names = V::Dict(vec![(V::Int(0), text("dog"))]);
    let small = Small {
        names,
        ..Small::default()
    };
    let imported = import_checkpoint(&small.bytes(), "small").unwrap();
    assert_eq!(imported.report.classes, ["dog"]);
}

/// A change of the small network, and a string that the error must contain.
fn refused(what: &str, change: impl FnOnce(&mut Small)) {
    let mut small = Small::default();
    change(&mut small);
    let error = import_checkpoint(&small.bytes(), "small").unwrap_err();
    let message = error.to_string();
    assert!(message.contains(what), "{message}");
    assert!(
        message.contains("expected") && message.contains("found"),
        "{message}"
    );
}

#[test]
fn inconsistent_networks_are_refused_with_their_path() {
    refused(
        "model.1: expected stride 16, as the layers before have it, found 8",
        |s| s.first = pool(16),
    );
    refused(
        "model.1.m.0.weight: expected shape [6, 3, 1, 1], found [3, 6, 1, 1]",
        |s| {
            s.weight = TensorSpec::new("w", &[3, 6, 1, 1]);
        },
    );
    refused("model.1.anchors: expected shape [1, 1, 2]", |s| {
        s.anchors = TensorSpec::new("w", &[1, 2]);
    });
    refused(
        "model.1: expected inputs from layers before number 1, found [1]",
        |s| {
            s.from = V::List(vec![V::Int(1)]);
        },
    );
    refused("found [-9]", |s| s.from = V::List(vec![V::Int(-9)]));
    refused("found []", |s| s.from = V::List(vec![]));
    refused("1 names, as many as the head has classes, found 2", |s| {
        s.names = V::List(vec![text("person"), text("dog")]);
    });
    refused("classes: expected the name of a class at least", |s| {
        s.names = V::List(vec![text("forklift")]);
    });
    refused("model.1.m.0: expected a window whose output", |s| {
        s.kernel = ints([3, 3])
    });
    refused("a size or two as `kernel_size`, found None", |s| {
        s.kernel = V::None
    });
    refused("a size or two as `kernel_size`, found a tuple of 2", |s| {
        s.kernel = ints([1 << 40, 1]);
    });
    refused("model.0: expected a module, found None", |s| {
        s.first = V::None
    });
}

#[test]
fn all_unknown_layers_are_reported_at_once() {
    let bytes = with_pickle("idetect.pt", |pickle| {
        let pickle = replaced(&pickle, b"models.common\nMP\n", b"models.common\nRepConv\n");
        replaced(&pickle, b"models.common\nSP\n", b"models.common\nGhost\n")
    });
    let error = import_checkpoint(&bytes, "x").unwrap_err();
    let kinds = ["models.common.Ghost", "models.common.RepConv"].map(str::to_owned);
    assert_eq!(
        error,
        ImportError::Layers {
            kinds: kinds.to_vec()
        }
    );
    let bytes = with_pickle("idetect.pt", |pickle| {
        replaced(&pickle, b"activation\nLeakyReLU\n", b"activation\nMish\n")
    });
    let message = import_checkpoint(&bytes, "x").unwrap_err().to_string();
    assert!(
        message.starts_with("model.0.act: expected an activation LeakyReLU"),
        "{message}"
    );
    assert!(
        message.contains("torch.nn.modules.activation.Mish"),
        "{message}"
    );
}

#[test]
fn weights_without_a_network_are_refused() {
    let state = small::dict([("model.0.weight", TensorSpec::new("w", &[4]).value())]);
    let pickle = small::pickle(&state);
    let message = import_checkpoint(&small::archive(&pickle), "x")
        .unwrap_err()
        .to_string();
    assert!(
        message.contains("the weights alone do not say"),
        "{message}"
    );
}

#[test]
fn number_of_layers_is_limited() {
    // Sequences of a hundred times the previous sequence.
    let mut layer = small::pool(1);
    for _ in 0..3 {
        let children = (0..20)
            .map(|i| (text(&i.to_string()), layer.clone()))
            .collect();
        layer = small::module(
            "torch.nn.modules.container.Sequential",
            vec![(text("f"), V::Int(-1))],
            [
                ("_parameters", small::nothing()),
                ("_buffers", small::nothing()),
                ("_modules", V::Dict(children)),
            ],
        );
    }
    let first = layer;
    let error = error_of(
        &Small {
            first,
            ..Small::default()
        }
        .bytes(),
    );
    assert!(
        matches!(error, ImportError::Limit { what: "layers", .. }),
        "{error}"
    );
}

/// The small network with another description of its weights.
fn weight(change: impl FnOnce(&mut TensorSpec)) -> String {
    let mut small = Small::default();
    change(&mut small.weight);
    let message = message_of(&small.bytes());
    assert!(
        message.starts_with("model.1.m.0.weight: expected"),
        "{message}"
    );
    message
}

#[test]
fn tensors_beyond_their_storage_are_refused() {
    let huge = i64::MAX;
    for change in [
        |t: &mut TensorSpec| t.shape = vec![i64::MAX, i64::MAX, 1, 1],
        |t: &mut TensorSpec| t.shape = vec![1 << 32, 1 << 32, 1, 1],
        |t: &mut TensorSpec| t.shape = vec![6, 3, 2, 2],
        |t: &mut TensorSpec| t.strides = vec![i64::MAX, 1, 1, 1],
        |t: &mut TensorSpec| t.strides = vec![12, 2, 1, 1],
        |t: &mut TensorSpec| t.strides = vec![1],
        |t: &mut TensorSpec| t.offset = 47,
        |t: &mut TensorSpec| t.offset = i64::MAX,
    ] {
        assert!(weight(change).contains("a shape within the 64 numbers stored"));
    }
    for change in [
        |t: &mut TensorSpec| t.shape = vec![-6, 3, 1, 1],
        |t: &mut TensorSpec| t.strides = vec![3, -1, 1, 1],
        |t: &mut TensorSpec| t.offset = -1,
    ] {
        assert!(weight(change).contains("sizes and strides from 0 up"));
    }
    assert!(weight(|t| t.shape = vec![1; 9]).contains("at most 8 dimensions"));
    assert!(weight(|t| t.numbers = 65).contains("256 bytes"));
    assert!(weight(|t| t.numbers = huge).contains("256 bytes"));
    assert!(weight(|t| t.numbers = -64).contains("256 bytes"));
    assert!(weight(|t| t.storage = "torch.HalfStorage").contains("64 numbers of 2 bytes"));
    assert!(weight(|t| t.storage = "torch.IntStorage").contains("floating-point numbers"));
    assert!(weight(|t| t.storage = "torch.Size").contains("a type of numbers"));
    assert!(weight(|t| t.key = "n").contains("finite numbers, found NaN"));
    // Dimensions of one element need no step, and zero steps repeat values.
    let mut small = Small::default();
    small.weight.strides = vec![0, 0, i64::MAX, i64::MAX];
    import_checkpoint(&small.bytes(), "x").unwrap();
}

#[test]
fn repeated_shared_weights_are_limited() {
    let with = |times| Small {
        first: small::repeated_conv(times),
        stride: TensorSpec::new("one", &[1]),
        ..Small::default()
    };
    // Three layers of 729 weights are fewer numbers than the file has bytes, a hundred are more.
    import_checkpoint(&with(3).bytes(), "x").unwrap();
    let error = error_of(&with(100).bytes());
    let ImportError::Limit { what, .. } = &error else {
        panic!("{error}");
    };
    assert!(what.contains("one per byte of the file"), "{what}");
}

#[test]
fn all_precisions_of_weights_give_the_same_network() {
    let single = import_checkpoint(&Small::default().bytes(), "x").unwrap();
    for (key, storage, precision) in [
        ("h", "torch.HalfStorage", Precision::Half),
        ("b", "torch.BFloat16Storage", Precision::BFloat16),
        ("d", "torch.DoubleStorage", Precision::Double),
    ] {
        let mut small = Small::default();
        small.weight.key = key;
        small.weight.storage = storage;
        let imported = import_checkpoint(&small.bytes(), "x").unwrap();
        assert_eq!(imported.report.precision, precision);
        // The graph, without the properties, which name the precision.
        let graph = |onnx: &[u8]| {
            let mut graph = wire::fields(onnx).flatten().filter(|f| f.number == 7);
            graph.next().map(|f| f.raw.to_vec())
        };
        assert!(graph(&imported.onnx).is_some());
        assert_eq!(graph(&imported.onnx), graph(&single.onnx));
    }
}

#[test]
fn feature_map_memory_is_limited() {
    let no_parts = || ["_parameters", "_buffers", "_modules"].map(|name| (name, small::nothing()));
    let limit = |first: V| match error_of(
        &Small {
            first,
            ..Small::default()
        }
        .bytes(),
    ) {
        ImportError::Limit { place, what, .. } => (place, what),
        other => panic!("{other}"),
    };
    // The image 64 times over: no weights, and 300 MB.
    let joined = |times: usize| {
        let from = V::List(vec![V::Int(-1); times]);
        let own = vec![(text("f"), from), (text("d"), V::Int(1))];
        small::module("models.common.Concat", own, no_parts())
    };
    let (place, what) = limit(joined(64));
    assert_eq!(place, "model.0");
    assert!(what.contains("a map of"), "{what}");

    // The same small map, nine hundred times.
    let mut layers = vec![(text("0"), V::Remembered(0, Box::new(pool(1))))];
    layers.extend((1..900).map(|i| (text(&i.to_string()), V::Recalled(0))));
    let mut parts = no_parts();
    parts[2].1 = V::Dict(layers);
    let own = vec![(text("f"), V::Int(-1))];
    let first = small::module("torch.nn.modules.container.Sequential", own, parts);
    let (_, what) = limit(first);
    assert!(what.contains("all maps"), "{what}");
}
