//! The classes and functions that a checkpoint may name. All others are refused by name.

/// A class or function, by name only.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) struct Class<'a> {
    /// Module, e.g. `models.common`.
    pub(in crate::import) module: &'a str,
    /// Name in it, e.g. `Conv`.
    pub(in crate::import) name: &'a str,
    pub(in crate::import) kind: Kind,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) enum Kind {
    /// An ordered dictionary.
    Dict,
    Set,
    /// Element type of a tensor's memory.
    Storage(Scalar),
    /// Makes a tensor of memory, offset, shape and strides.
    Tensor,
    Parameter,
    /// A bound method: marks a layer that runs without its batch norm.
    Method,
    /// Recorded and ignored: devices, numpy's numbers.
    Inert,
    Layer,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) enum Scalar {
    /// IEEE 754 binary16.
    Half,
    /// The upper half of a binary32.
    BFloat16,
    Float,
    Double,
    Long,
    /// Other integers, of this many bytes.
    Other(usize),
}

impl Scalar {
    pub(in crate::import) fn width(self) -> usize {
        match self {
            Self::Half | Self::BFloat16 => 2,
            Self::Float => 4,
            Self::Double | Self::Long => 8,
            Self::Other(width) => width,
        }
    }
}

/// Maximum length of a layer's full name in messages, characters.
const LONGEST: usize = 120;

/// Data of torch and numpy that is ignored.
const INERT: [(&str, &[&str]); 6] = [
    ("torch", &["Size", "device", "dtype"]),
    (
        "torch",
        &["float16", "bfloat16", "float32", "float64", "int64"],
    ),
    ("numpy", &["dtype", "ndarray"]),
    ("numpy.core.multiarray", &["scalar", "_reconstruct"]),
    ("numpy._core.multiarray", &["scalar", "_reconstruct"]),
    ("_codecs", &["encode"]),
];

impl<'a> Class<'a> {
    /// The class of this name, if known.
    pub(in crate::import) fn known(module: &'a str, name: &'a str) -> Option<Self> {
        let kind = match (module, name) {
            ("collections", "OrderedDict") => Kind::Dict,
            ("__builtin__" | "builtins", "set" | "frozenset") => Kind::Set,
            ("__builtin__" | "builtins", "getattr") => Kind::Method,
            ("torch._utils", "_rebuild_tensor_v2") => Kind::Tensor,
            ("torch._utils", "_rebuild_parameter") => Kind::Parameter,
            ("torch", _) if storage(name).is_some() => Kind::Storage(storage(name)?),
            _ if is_layer(module, name) => Kind::Layer,
            _ => {
                let mut inert = INERT.iter().filter(|(m, _)| *m == module);
                inert
                    .any(|(_, names)| names.contains(&name))
                    .then_some(Kind::Inert)?
            }
        };
        Some(Self { module, name, kind })
    }

    pub(in crate::import) fn path(self) -> String {
        format!("{}.{}", self.module, self.name)
    }
}

fn storage(name: &str) -> Option<Scalar> {
    Some(match name {
        "HalfStorage" => Scalar::Half,
        "BFloat16Storage" => Scalar::BFloat16,
        "FloatStorage" => Scalar::Float,
        "DoubleStorage" => Scalar::Double,
        "LongStorage" => Scalar::Long,
        "IntStorage" => Scalar::Other(4),
        "ShortStorage" => Scalar::Other(2),
        "CharStorage" | "ByteStorage" | "BoolStorage" => Scalar::Other(1),
        _ => return None,
    })
}

/// Classes of layers begin with a capital, functions beside them do not. Kinds that cannot be imported pass as well, so that all of them
/// can be named at once later.
fn is_layer(module: &str, name: &str) -> bool {
    let place = module.starts_with("torch.nn.modules.")
        || matches!(
            module,
            "models.yolo" | "models.common" | "models.experimental"
        );
    place
        && module.len() + name.len() <= LONGEST
        && name.starts_with(|c: char| c.is_ascii_uppercase())
        && name.chars().all(|c| c.is_ascii_alphanumeric() || c == '_')
        && module
            .chars()
            .all(|c| c.is_ascii_alphanumeric() || "._".contains(c))
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn only_listed_classes_are_accepted() {
        for (module, name) in [
            ("os", "system"),
            ("posix", "system"),
            ("builtins", "eval"),
            ("__builtin__", "exec"),
            ("torch.nn.modules.utils", "_pair"),
            ("torch.nn.modules.conv", "Conv2d.forward"),
            ("models.common", "os.System"),
            ("torch", "load"),
            ("torch.hub", "load"),
            ("models", "Conv"),
            ("models.common", &"C".repeat(200)),
        ] {
            assert_eq!(Class::known(module, name), None, "{module}.{name}");
        }
        let conv = Class::known("torch.nn.modules.conv", "Conv2d").unwrap();
        assert_eq!(conv.kind, Kind::Layer);
        assert_eq!(conv.path(), "torch.nn.modules.conv.Conv2d");
    }
}
