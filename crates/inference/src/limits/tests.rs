use super::*;
use crate::wire::Message;
use proptest::prelude::*;

fn model(graph: &Message) -> Vec<u8> {
    Message::new().integer(1, 8).message(7, graph).into_bytes()
}

fn node(operator: &str, inputs: &[&str], output: &str) -> Message {
    let node = inputs.iter().fold(Message::new(), |n, i| n.field(1, i));
    node.field(2, output).field(4, operator)
}

fn integers(name: &str, values: &[i64]) -> Message {
    let raw: Vec<u8> = values.iter().flat_map(|v| v.to_le_bytes()).collect();
    Message::new()
        .integer(1, values.len() as u64)
        .integer(2, 7)
        .field(8, name)
        .field(9, raw)
}

fn refusal(graph: &Message) -> String {
    check(&model(graph)).unwrap_err()
}

#[test]
fn weight_sizes_must_match_their_data() {
    let weight = |sizes: &[u64], bytes: usize| {
        let tensor = sizes.iter().fold(Message::new(), |t, &s| t.integer(1, s));
        Message::new().message(5, &tensor.integer(2, 1).field(9, vec![0; bytes]))
    };
    assert_eq!(check(&model(&weight(&[2, 3], 24))), Ok(()));
    assert_eq!(check(&model(&weight(&[0], 0))), Ok(()));
    // The product of the first is 0 in 64 bits.
    for sizes in [
        &[1 << 32, 1 << 32][..],
        &[1 << 20, 1 << 20],
        &[u64::MAX],
        &[0, 1 << 40, 1 << 40],
        &[1; 100],
    ] {
        let said = refusal(&weight(sizes, 24));
        assert!(said.starts_with("a tensor of ["), "{sizes:?}: {said}");
    }
    // The same in a constant.
    let tensor = Message::new().integer(1, 1 << 32).integer(1, 1 << 32);
    let attribute = Message::new().field(1, "value").message(5, &tensor);
    let constant = node("Constant", &[], "c").message(5, &attribute);
    assert!(refusal(&Message::new().message(1, &constant)).contains("4294967296, 4294967296"));
}

#[test]
fn long_chains_and_deep_nesting_are_refused() {
    let chain = |n: usize| {
        let [x, y] = [0, 1].map(|k| move |i: usize| format!("x{}", i + k));
        let step = |g: Message, i| g.message(1, &node("Relu", &[&x(i)], &y(i)));
        (0..n).fold(Message::new(), step)
    };
    assert_eq!(check(&model(&chain(LONGEST_CHAIN))), Ok(()));
    assert!(refusal(&chain(LONGEST_CHAIN + 1)).contains("over 2500 nodes one behind"));
    let beside = |n: usize| {
        let step = |g: Message, i| g.message(1, &node("Relu", &["x"], &format!("y{i}")));
        (0..n).fold(Message::new(), step)
    };
    assert_eq!(check(&model(&beside(MOST_NODES))), Ok(()));
    assert!(refusal(&beside(MOST_NODES + 1)).contains("over 16384 nodes"));
    // The same chain in reverse order.
    let backwards = Message::new()
        .message(1, &node("Relu", &["x1"], "x2"))
        .message(1, &node("Relu", &["x0"], "x1"));
    assert!(refusal(&backwards).contains("in front of those"));
    // Half of a chain around the other half.
    let branch = Message::new()
        .field(1, "then_branch")
        .message(6, &chain(LONGEST_CHAIN / 2));
    let half = LONGEST_CHAIN / 2 + 1;
    let both = [0, 1].map(|less| {
        let last = format!("x{}", half - 2 * less);
        let outer = chain(half - 2 * less);
        outer.message(1, &node("If", &[&last], "y").message(5, &branch))
    });
    assert!(refusal(&both[0]).contains("one behind"));
    assert_eq!(check(&model(&both[1])), Ok(()));
    let nest = |depth: usize| {
        (0..depth).fold(chain(1), |inner, _| {
            let branch = Message::new().field(1, "then_branch").message(6, &inner);
            Message::new().message(1, &node("If", &["x0"], "y").message(5, &branch))
        })
    };
    assert_eq!(check(&model(&nest(MOST_DEPTH))), Ok(()));
    for depth in [MOST_DEPTH + 1, 2000] {
        assert!(refusal(&nest(depth)).contains("over 4 deep"), "{depth}");
    }
}

#[test]
fn loops_need_a_bounded_iteration_count() {
    let turns = |turns: Option<i64>, inner: &Message| {
        let body = Message::new().field(1, "body").message(6, inner);
        let graph = match turns {
            Some(n) => Message::new().message(5, &integers("n", &[n])),
            None => Message::new(),
        };
        graph.message(1, &node("Loop", &["n", "go"], "y").message(5, &body))
    };
    let plain = Message::new();
    assert_eq!(check(&model(&turns(Some(1000), &plain))), Ok(()));
    for bad in [None, Some(1001), Some(i64::MAX), Some(-1)] {
        assert!(refusal(&turns(bad, &plain)).contains("a loop"), "{bad:?}");
    }
    // A hundred times a hundred.
    assert!(refusal(&turns(Some(100), &turns(Some(100), &plain))).contains("a loop"));
    assert_eq!(
        check(&model(&turns(Some(10), &turns(Some(10), &plain)))),
        Ok(())
    );
}

#[test]
fn declared_huge_outputs_are_refused() {
    let of = |operator: &str, constants: &[(&str, &[i64])], inputs: &[&str]| {
        let graph = constants.iter().fold(Message::new(), |g, (name, v)| {
            g.message(5, &integers(name, v))
        });
        graph.message(1, &node(operator, inputs, "y"))
    };
    let huge: &[i64] = &[1 << 20, 1 << 20];
    for (operator, inputs) in [
        ("Expand", &["x", "s"][..]),
        ("Tile", &["x", "s"]),
        ("ConstantOfShape", &["s"]),
        ("TopK", &["x", "s"]),
        ("OneHot", &["x", "s", "v"]),
        ("Resize", &["x", "", "", "s"]),
        ("Pad", &["x", "s"]),
    ] {
        let said = refusal(&of(operator, &[("s", huge)], inputs));
        assert!(said.contains(operator), "{said}");
        assert_eq!(
            check(&model(&of(operator, &[("s", &[1, 80, 80])], inputs))),
            Ok(())
        );
    }
    let range = |limit| {
        of(
            "Range",
            &[("a", &[0]), ("b", &[limit]), ("c", &[1])],
            &["a", "b", "c"],
        )
    };
    assert!(refusal(&range(1 << 40)).contains("Range"));
    assert_eq!(check(&model(&range(8400))), Ok(()));
    // A shape in an attribute.
    let ints = Message::new().field(1, "value_ints").integer(8, 1 << 40);
    let graph = Message::new()
        .message(1, &node("Constant", &[], "s").message(5, &ints))
        .message(1, &node("Expand", &["x", "s"], "y"));
    assert!(refusal(&graph).contains("Expand"));
}

#[test]
fn functions_sparse_and_random_operators_are_refused() {
    let function = Message::new()
        .integer(1, 8)
        .message(7, &Message::new())
        .message(25, &Message::new());
    assert!(
        check(&function.into_bytes())
            .unwrap_err()
            .contains("functions")
    );
    assert!(refusal(&Message::new().message(15, &Message::new())).contains("sparse"));
    assert!(
        refusal(&Message::new().message(1, &node("RandomNormal", &[], "y"))).contains("random")
    );
}

proptest! {
    /// Checking terminates for any bytes.
    #[test]
    fn checking_terminates_for_any_bytes(bytes in prop::collection::vec(any::<u8>(), 0..300)) {
        let _ = check(&bytes);
        let _ = check(&Message::new().field(7, &bytes).into_bytes());
        let _ = check(&model(&Message::new().field(1, &bytes).field(5, &bytes)));
    }
}
