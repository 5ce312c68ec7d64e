//! Damaged or malicious pickles: foreign functions, inconsistent stacks, bombs.

use super::small::{self, V, class, dict, text};
use super::support::{checkpoint, error_of, message_of, program, with_pickle};
use stillpoint_models::import::ImportError;

#[test]
fn truncated_pickles_are_refused() {
    for i in 0..100 {
        let bytes = with_pickle("idetect.pt", |p| p[..p.len() * i / 100].to_vec());
        let error = error_of(&bytes);
        assert!(matches!(error, ImportError::Pickle { .. }), "{error}");
    }
}

#[test]
fn foreign_functions_are_refused_by_name_and_not_run() {
    let folder = tempfile::tempdir().unwrap();
    let trace = folder.path().join("trace");
    let command = format!("touch {}", trace.display());
    for path in [
        "os.system",
        "posix.system",
        "builtins.eval",
        "__builtin__.exec",
        "torch.load",
    ] {
        let call = V::Call(Box::new(class(path)), vec![text(&command)]);
        let error = error_of(&small::archive(&small::pickle(&dict([("model", call)]))));
        assert!(matches!(error, ImportError::Refused { .. }), "{error}");
        assert!(error.to_string().contains(&format!("`{path}`")), "{error}");
        assert!(
            error.to_string().contains("nothing was executed"),
            "{error}"
        );
    }
    // The same by STACK_GLOBAL, with the name assembled on the stack.
    let message = message_of(&program(b"\x8c\x02os\x8c\x06system\x93"));
    assert!(message.contains("`os.system`"), "{message}");
    let message = message_of(&program(
        b"c__builtin__\ngetattr\nNX\x05\0\0\0__class__\x86R",
    ));
    assert!(message.contains("getattr"), "{message}");
    let message = message_of(&program(
        b"c__builtin__\ngetattr\nNX\x08\0\0\0__init__\x86R",
    ));
    assert!(
        message.contains("__builtin__.getattr(..., __init__)"),
        "{message}"
    );
    // A layer's class may be named, not called; functions beside the layers may not even be named.
    let message = message_of(&program(b"ctorch.nn.modules.conv\nConv2d\n)R"));
    assert!(
        message.contains("a call of torch.nn.modules.conv.Conv2d"),
        "{message}"
    );
    let message = message_of(&program(b"ctorch.nn.modules.utils\n_pair\n"));
    assert!(
        message.contains("`torch.nn.modules.utils._pair`"),
        "{message}"
    );
    assert!(!trace.exists());
}

#[test]
fn unknown_opcodes_are_refused_with_their_offset() {
    for opcode in [
        b'i', b'o', b'I', b'F', b'L', b'S', b'V', b'p', b'g', 0x82, 0x97, 0xff, 0,
    ] {
        let error = error_of(&program(&[b'N', opcode]));
        let ImportError::Pickle { at, found, .. } = error else {
            panic!("{error}");
        };
        assert_eq!((at, found), (3, format!("0x{opcode:02x}")));
    }
    assert!(message_of(&checkpoint(b"\x80\x01N.")).contains("protocol 1"));
    assert!(message_of(&checkpoint(b"\x80\x06N.")).contains("protocol 6"));
}

#[test]
fn inconsistent_stacks_are_refused() {
    for opcodes in [
        b"".as_slice(),
        b"0",
        b"1",
        b"2",
        b"a",
        b"e",
        b"s",
        b"u",
        b"t",
        b"l",
        b"d",
        b"R",
        b"b",
        b"Q",
        b"\x81",
        b"\x92",
        b"\x93",
        b"q\0",
        b"h\x07",
        b"j\xff\xff\xff\xff",
        b"\x94",
        b"NNa",
        b"]N(e(",
        b"N(Ns",
        b"}(Nu",
        b"N)R",
        b"NN\x93",
        b"]Nb",
        b"\x85",
        b"\x87",
        b"\x90",
        b"c",
        b"cos",
        b"ccollections\nOrderedDict\n](NeR",
        b"X\x02\0\0\0\xff\xff",
    ] {
        let error = error_of(&program(opcodes));
        assert!(
            matches!(error, ImportError::Pickle { .. }),
            "{opcodes:?}: {error}"
        );
    }
}

#[test]
fn excessive_lengths_allocate_nothing() {
    for opcodes in [
        b"X\xff\xff\xff\xff".as_slice(),
        b"T\xff\xff\xff\x7f",
        b"B\xff\xff\xff\xff",
        b"\x8b\xff\xff\xff\x7f",
        b"\x8b\xff\xff\xff\xff",
        b"\x8d\xff\xff\xff\xff\xff\xff\xff\x7f",
        b"\x8e\xff\xff\xff\xff\xff\xff\xff\xff",
        b"\x96\xff\xff\xff\xff\xff\xff\xff\xff",
        b"\x8a\xffab",
    ] {
        let message = message_of(&program(opcodes));
        assert!(message.contains("bytes announced"), "{message}");
    }
    // An integer with too many digits is skipped, not computed.
    let long = [b"\x8b\0\x40\0\0".as_slice(), &[0x7f; 0x4000]].concat();
    assert!(message_of(&program(&long)).contains("found a long integer"));
}

fn repeated(opcodes: &[u8], times: usize) -> Vec<u8> {
    program(&opcodes.repeat(times))
}

#[test]
fn pickle_bombs_are_limited() {
    const MANY: usize = 600_000;
    let remembered: Vec<u8> = (0..MANY as u32)
        .flat_map(|i| [b"r".as_slice(), &i.to_le_bytes()].concat())
        .collect();
    let wide = [b"](".as_slice(), &b"N".repeat(1000), b"l"].concat();
    let copies = [
        b"(".as_slice(),
        &b"N".repeat(10_000),
        b"tq\0",
        &b"cnumpy\ndtype\nh\0R0".repeat(200),
    ]
    .concat();
    for (bytes, what) in [
        (repeated(b"]", MANY), "values"),
        (repeated(b"(", MANY), "marks"),
        (
            program(&[b"N".as_slice(), &b"2".repeat(MANY)].concat()),
            "values on the stack",
        ),
        (
            program(&[b"N".as_slice(), &remembered].concat()),
            "entries of the memo",
        ),
        (
            program(&[b"Nq\0]".as_slice(), &b"h\0a".repeat(2 * MANY)].concat()),
            "elements of lists",
        ),
        (repeated(&wide, 1200), "values"),
        (program(&copies), "elements of lists"),
        (checkpoint(&vec![b'N'; (1 << 24) + 1]), "bytes"),
    ] {
        let error = error_of(&bytes);
        let ImportError::Limit { what: found, .. } = &error else {
            panic!("{what}: {error}");
        };
        assert_eq!(*found, what);
    }
}

#[test]
fn deep_and_endless_values_are_read_without_recursion() {
    // Tuples within tuples, a hundred thousand deep.
    let deep = [b")".as_slice(), &b"\x85".repeat(100_000)].concat();
    assert!(message_of(&program(&deep)).contains("found a tuple of 1"));
    // Lists of ten times the previous list: a graph of sixty nodes that represents 10^60 elements.
    let mut laughs = b"]q\0".to_vec();
    for i in 0..60_u8 {
        laughs.extend([b']', b'q', i + 1, b'(']);
        laughs.extend([b'h', i].repeat(10));
        laughs.push(b'e');
    }
    assert!(message_of(&program(&laughs)).contains("found a list of 10"));
    // A list that contains itself, and such a network.
    assert!(message_of(&program(b"]q\0h\0a")).contains("found a list of 1"));
    let cycle = [
        b"}X\x05\0\0\0modelctorch.nn.modules.container\nSequential\n)\x81q\0".as_slice(),
        b"}(X\x01\0\0\0fJ\xff\xff\xff\xffX\x08\0\0\0_modules}X\x05\0\0\0modelh\0sub",
        b"s",
    ];
    let message = message_of(&program(&cycle.concat()));
    assert!(
        message.contains("at most 4 sequences within one another"),
        "{message}"
    );
}
