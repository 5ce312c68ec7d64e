//! A small network, written value by value: a pooling of 8 x 8 px and a head of one map, one anchor and one class. Every part can be made
//! wrong.

use super::support::{Entry, Lies, zip};

#[derive(Clone, Debug)]
pub(crate) enum V {
    None,
    Bool(bool),
    Int(i64),
    Text(String),
    List(Vec<V>),
    Tuple(Vec<V>),
    Dict(Vec<(V, V)>),
    Class(String, String),
    Call(Box<V>, Vec<V>),
    Object(Box<V>, Box<V>),
    Outside(Box<V>),
    /// A value stored in the memo under a number.
    Remembered(u8, Box<V>),
    Recalled(u8),
}

pub(crate) fn text(text: &str) -> V {
    V::Text(text.to_owned())
}

pub(crate) fn class(path: &str) -> V {
    let (module, name) = path.rsplit_once('.').unwrap();
    V::Class(module.to_owned(), name.to_owned())
}

pub(crate) fn dict<const N: usize>(entries: [(&str, V); N]) -> V {
    V::Dict(entries.map(|(key, value)| (text(key), value)).to_vec())
}

pub(crate) fn ints<const N: usize>(values: [i64; N]) -> V {
    V::Tuple(values.map(V::Int).to_vec())
}

pub(crate) fn pickle(value: &V) -> Vec<u8> {
    let mut bytes = vec![0x80, 2];
    write(value, &mut bytes);
    bytes.push(b'.');
    bytes
}

fn write(value: &V, out: &mut Vec<u8>) {
    match value {
        V::None => out.push(b'N'),
        V::Bool(b) => out.push(if *b { 0x88 } else { 0x89 }),
        V::Int(n) => {
            out.extend([0x8a, 8]);
            out.extend(n.to_le_bytes());
        }
        V::Text(text) => {
            out.push(b'X');
            out.extend((text.len() as u32).to_le_bytes());
            out.extend(text.as_bytes());
        }
        V::List(values) => {
            out.extend(b"](");
            values.iter().for_each(|v| write(v, out));
            out.push(b'e');
        }
        V::Tuple(values) => {
            out.push(b'(');
            values.iter().for_each(|v| write(v, out));
            out.push(b't');
        }
        V::Dict(entries) => {
            out.extend(b"}(");
            for (key, value) in entries {
                write(key, out);
                write(value, out);
            }
            out.push(b'u');
        }
        V::Class(module, name) => out.extend(format!("c{module}\n{name}\n").into_bytes()),
        V::Call(function, arguments) => {
            write(function, out);
            write(&V::Tuple(arguments.clone()), out);
            out.push(b'R');
        }
        V::Object(class, state) => {
            write(class, out);
            out.extend([b')', 0x81]);
            write(state, out);
            out.push(b'b');
        }
        V::Remembered(number, value) => {
            write(value, out);
            out.extend([b'q', *number]);
        }
        V::Recalled(number) => out.extend([b'h', *number]),
        V::Outside(id) => {
            write(id, out);
            out.push(b'Q');
        }
    }
}

/// Description of a tensor; entries of the archive hold 64 numbers of 4 bytes.
#[derive(Clone, Debug)]
pub(crate) struct TensorSpec {
    pub(crate) storage: &'static str,
    pub(crate) key: &'static str,
    pub(crate) numbers: i64,
    pub(crate) offset: i64,
    pub(crate) shape: Vec<i64>,
    pub(crate) strides: Vec<i64>,
}

impl TensorSpec {
    pub(crate) fn new(key: &'static str, shape: &[i64]) -> Self {
        let mut strides = vec![1; shape.len()];
        for i in (1..shape.len()).rev() {
            strides[i - 1] = strides[i] * shape[i];
        }
        Self {
            storage: "torch.FloatStorage",
            key,
            numbers: 64,
            offset: 0,
            shape: shape.to_vec(),
            strides,
        }
    }

    pub(crate) fn value(&self) -> V {
        let sizes = |s: &[i64]| V::Tuple(s.iter().map(|&n| V::Int(n)).collect());
        let memory = V::Tuple(vec![
            text("storage"),
            class(self.storage),
            text(self.key),
            text("cpu"),
            V::Int(self.numbers),
        ]);
        let arguments = vec![
            V::Outside(Box::new(memory)),
            V::Int(self.offset),
            sizes(&self.shape),
            sizes(&self.strides),
            V::Bool(false),
            V::Dict(vec![]),
        ];
        V::Call(
            Box::new(class("torch._utils._rebuild_tensor_v2")),
            arguments,
        )
    }
}

pub(crate) fn module(path: &str, own: Vec<(V, V)>, parts: [(&str, V); 3]) -> V {
    let mut state = own;
    state.extend(parts.map(|(key, value)| (text(key), value)));
    V::Object(Box::new(class(path)), Box::new(V::Dict(state)))
}

fn parts(parameters: V, buffers: V, modules: V) -> [(&'static str, V); 3] {
    [
        ("_parameters", parameters),
        ("_buffers", buffers),
        ("_modules", modules),
    ]
}

fn own<const N: usize>(entries: [(&str, V); N]) -> Vec<(V, V)> {
    entries.map(|(key, value)| (text(key), value)).to_vec()
}

pub(crate) fn nothing() -> V {
    V::Dict(vec![])
}

#[derive(Clone, Debug)]
pub(crate) struct Small {
    pub(crate) weight: TensorSpec,
    pub(crate) anchors: TensorSpec,
    pub(crate) stride: TensorSpec,
    pub(crate) first: V,
    pub(crate) from: V,
    pub(crate) names: V,
    pub(crate) kernel: V,
}

impl Default for Small {
    fn default() -> Self {
        Self {
            weight: TensorSpec::new("w", &[6, 3, 1, 1]),
            anchors: TensorSpec::new("w", &[1, 1, 2]),
            stride: TensorSpec::new("s", &[1]),
            first: pool(8),
            from: V::List(vec![V::Int(0)]),
            names: V::List(vec![text("person")]),
            kernel: ints([1, 1]),
        }
    }
}

pub(crate) fn pool(size: i64) -> V {
    let own = own([
        ("f", V::Int(-1)),
        ("kernel_size", V::Int(size)),
        ("stride", V::Int(size)),
        ("padding", V::Int(0)),
        ("dilation", V::Int(1)),
        ("ceil_mode", V::Bool(false)),
    ]);
    let path = "torch.nn.modules.pooling.MaxPool2d";
    module(path, own, parts(nothing(), nothing(), nothing()))
}

fn conv(outputs: i64, kernel: V, padding: i64, weight: &TensorSpec) -> V {
    let own = own([
        ("in_channels", V::Int(3)),
        ("out_channels", V::Int(outputs)),
        ("groups", V::Int(1)),
        ("kernel_size", kernel),
        ("stride", ints([1, 1])),
        ("padding", V::Int(padding)),
        ("dilation", ints([1, 1])),
        ("padding_mode", text("zeros")),
    ]);
    let weights = dict([("weight", weight.value()), ("bias", V::None)]);
    let path = "torch.nn.modules.conv.Conv2d";
    module(path, own, parts(weights, nothing(), nothing()))
}

/// A layer that repeats one 9 x 9 convolution.
pub(crate) fn repeated_conv(times: usize) -> V {
    let weight = TensorSpec {
        numbers: 1024,
        ..TensorSpec::new("v", &[3, 3, 9, 9])
    };
    let conv = conv(3, ints([9, 9]), 4, &weight);
    let children = dict([("conv", conv)]);
    let first = module(
        "models.common.Conv",
        vec![],
        parts(nothing(), nothing(), children),
    );
    let mut layers = vec![(text("0"), V::Remembered(0, Box::new(first)))];
    layers.extend((1..times).map(|i| (text(&i.to_string()), V::Recalled(0))));
    let own = own([("f", V::Int(-1))]);
    let path = "torch.nn.modules.container.Sequential";
    module(path, own, parts(nothing(), nothing(), V::Dict(layers)))
}

impl Small {
    pub(crate) fn network(&self) -> V {
        let conv = conv(6, self.kernel.clone(), 0, &self.weight);
        let list = module(
            "torch.nn.modules.container.ModuleList",
            vec![],
            parts(nothing(), nothing(), dict([("0", conv)])),
        );
        let head = own([
            ("f", self.from.clone()),
            ("nc", V::Int(1)),
            ("na", V::Int(1)),
            ("stride", self.stride.value()),
        ]);
        let anchors = dict([("anchors", self.anchors.value())]);
        let head = module(
            "models.yolo.Detect",
            head,
            parts(nothing(), anchors, dict([("m", list)])),
        );
        let layers = module(
            "torch.nn.modules.container.Sequential",
            vec![],
            parts(
                nothing(),
                nothing(),
                dict([("0", self.first.clone()), ("1", head)]),
            ),
        );
        let names = own([("names", self.names.clone())]);
        module(
            "models.yolo.Model",
            names,
            parts(nothing(), nothing(), dict([("model", layers)])),
        )
    }

    pub(crate) fn bytes(&self) -> Vec<u8> {
        archive(&pickle(&dict([
            ("ema", V::None),
            ("model", self.network()),
        ])))
    }
}

/// An archive with that pickle and memory: 64 times 0.5 as `w`, `d`, `b` and `h` (32, 64 and 16 bits, bfloat16 and half), 64 times 8 as
/// `s`, 64 times 1 as `one`, 64 times NaN as `n`, and 1024 times 0.5 as `v`.
pub(crate) fn archive(pickle: &[u8]) -> Vec<u8> {
    let memory = |value: f32| value.to_le_bytes().repeat(64);
    zip(
        &[
            Entry::new("archive/data.pkl", pickle),
            Entry::new("archive/data/w", memory(0.5)),
            Entry::new("archive/data/s", memory(8.0)),
            Entry::new("archive/data/one", memory(1.0)),
            Entry::new("archive/data/n", memory(f32::NAN)),
            Entry::new("archive/data/d", 0.5_f64.to_le_bytes().repeat(64)),
            Entry::new("archive/data/b", 0x3f00_u16.to_le_bytes().repeat(64)),
            Entry::new("archive/data/h", 0x3800_u16.to_le_bytes().repeat(64)),
            Entry::new("archive/data/v", memory(0.5).repeat(16)),
            Entry::new("archive/version", *b"3\n"),
        ],
        Lies::default(),
    )
}
