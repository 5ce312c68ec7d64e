//! Inputs and outputs of a model, read from its file without a runtime.

use crate::wire::{WireError, fields, text};
use std::collections::BTreeSet;
use std::fmt;

/// Inputs and outputs of a model.
#[derive(Clone, Debug, Default, PartialEq, Eq)]
pub struct Interface {
    /// Its inputs, without weights.
    pub inputs: Vec<Port>,
    /// Its outputs.
    pub outputs: Vec<Port>,
}

/// One input or output.
#[derive(Clone, Debug, PartialEq, Eq)]
pub struct Port {
    /// Name in the graph.
    pub name: String,
    /// Sizes of its dimensions; `None` if the file has none.
    pub shape: Option<Vec<Dimension>>,
}

/// Size of a dimension.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Dimension {
    /// A number.
    Fixed(u64),
    /// Any size; its name in the graph, which may be empty.
    Free(String),
}

impl Interface {
    /// Reads an ONNX file: its graph's fields 11 and 12, less the inputs that are among its weights (field 5).
    ///
    /// # Errors
    /// Damaged fields; over 1024 inputs or outputs, or over 16 dimensions of one.
    pub fn read(model: &[u8]) -> Result<Self, WireError> {
        let mut interface = Self::default();
        let mut weights = BTreeSet::new();
        let (mut inputs, mut outputs) = (Vec::new(), Vec::new());
        for field in fields(model) {
            let field = field?;
            let (7, Some(graph)) = (field.number, field.value.bytes()) else {
                continue;
            };
            for field in fields(graph) {
                let field = field?;
                let Some(bytes) = field.value.bytes() else {
                    continue;
                };
                match field.number {
                    5 => weights.extend(text(bytes, 8)?),
                    11 => inputs.push(bytes),
                    12 => outputs.push(bytes),
                    _ => {}
                }
            }
        }
        for bytes in inputs {
            // Old exporters list all weights among the inputs.
            if !weights.contains(text(bytes, 1)?.unwrap_or_default()) {
                Port::add(&mut interface.inputs, bytes, "inputs")?;
            }
        }
        for bytes in outputs {
            Port::add(&mut interface.outputs, bytes, "outputs")?;
        }
        Ok(interface)
    }
}

impl Interface {
    /// As lines of a message: the first ones, since other models may have hundreds.
    pub(super) fn listing(&self) -> String {
        const SHOWN: usize = 12;
        let inputs = self.inputs.iter().map(|port| ("input ", port));
        let outputs = self.outputs.iter().map(|port| ("output", port));
        // Outputs are more informative, and many inputs must not hide them.
        let for_inputs = SHOWN - self.outputs.len().min(SHOWN / 2);
        let mut lines: Vec<String> = inputs
            .take(for_inputs)
            .chain(outputs.take(SHOWN - self.inputs.len().min(for_inputs)))
            .map(|(sort, port)| format!("  {sort}  {port}"))
            .collect();
        let more = self.inputs.len() + self.outputs.len() - lines.len();
        if more > 0 {
            lines.push(format!("  and {more} more"));
        }
        if lines.is_empty() {
            lines.push("  neither inputs nor outputs".to_owned());
        }
        lines.join("\n")
    }

    /// With the actual shapes of the outputs.
    pub(super) fn with_outputs(&self, shapes: impl Iterator<Item = Vec<usize>>) -> Self {
        let mut known = self.clone();
        for (port, shape) in known.outputs.iter_mut().zip(shapes) {
            port.shape = Some(shape.iter().map(|&s| Dimension::Fixed(s as u64)).collect());
        }
        known
    }
}

const MOST_PORTS: usize = 1024;
const MOST_DIMENSIONS: usize = 16;
/// Maximum number of printed characters of a name.
const PRINTED: usize = 80;

impl Port {
    fn add(ports: &mut Vec<Self>, message: &[u8], what: &'static str) -> Result<(), WireError> {
        let most = MOST_PORTS;
        if ports.len() == most {
            return Err(WireError::Many { what, most });
        }
        ports.push(Self::read(message)?);
        Ok(())
    }

    /// `ValueInfoProto`: name 1, type 2 { tensor 1 { shape 2 { dimensions 1 { value 1 or name 2 } } } }.
    fn read(message: &[u8]) -> Result<Self, WireError> {
        let shape = match inner(message, &[2, 1, 2])? {
            None => None,
            Some(shape) => {
                let mut sizes = Vec::new();
                for dimension in fields(shape) {
                    let dimension = dimension?;
                    if let (1, Some(bytes)) = (dimension.number, dimension.value.bytes()) {
                        if sizes.len() == MOST_DIMENSIONS {
                            return Err(WireError::Many {
                                what: "dimensions",
                                most: MOST_DIMENSIONS,
                            });
                        }
                        sizes.push(Dimension::read(bytes)?);
                    }
                }
                Some(sizes)
            }
        };
        Ok(Self {
            name: text(message, 1)?.unwrap_or_default().to_owned(),
            shape,
        })
    }
}

impl Dimension {
    fn read(message: &[u8]) -> Result<Self, WireError> {
        let mut found = Self::Free(String::new());
        for field in fields(message) {
            let field = field?;
            match (field.number, field.value.integer(), field.value.text()) {
                // Some exporters write a negative number for a free size.
                (1, Some(size), _) if i64::try_from(size).is_err() => {
                    found = Self::Free(String::new());
                }
                (1, Some(size), _) => found = Self::Fixed(size),
                (2, _, Some(name)) => found = Self::Free(name.to_owned()),
                _ => {}
            }
        }
        Ok(found)
    }
}

/// The message at the end of a path of field numbers.
pub(super) fn inner<'a>(
    mut message: &'a [u8],
    path: &[u64],
) -> Result<Option<&'a [u8]>, WireError> {
    for &number in path {
        let mut next = None;
        for field in fields(message) {
            let field = field?;
            if let (true, Some(bytes)) = (field.number == number, field.value.bytes()) {
                next = Some(bytes);
            }
        }
        match next {
            Some(bytes) => message = bytes,
            None => return Ok(None),
        }
    }
    Ok(Some(message))
}

impl fmt::Display for Interface {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let list = |ports: &[Port]| match ports {
            [] => "none".to_owned(),
            _ => {
                let parts: Vec<String> = ports.iter().map(Port::to_string).collect();
                parts.join(", ")
            }
        };
        write!(
            f,
            "inputs: {}; outputs: {}",
            list(&self.inputs),
            list(&self.outputs)
        )
    }
}

impl fmt::Display for Port {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let name = match self.name.as_str() {
            "" => "(without a name)",
            name => &printed(name),
        };
        match &self.shape {
            None => write!(f, "{name} of unknown shape"),
            Some(shape) => {
                let sizes: Vec<String> = shape.iter().map(Dimension::to_string).collect();
                write!(f, "{name} [{}]", sizes.join(", "))
            }
        }
    }
}

impl fmt::Display for Dimension {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        match self {
            Self::Fixed(size) => write!(f, "{size}"),
            Self::Free(name) if name.is_empty() => f.write_str("?"),
            Self::Free(name) => f.write_str(&printed(name)),
        }
    }
}

/// A name from a file as part of a line: shortened, and without control characters.
fn printed(name: &str) -> String {
    let mut text: String = name.escape_debug().take(PRINTED).collect();
    if name.escape_debug().nth(PRINTED).is_some() {
        text.push_str("...");
    }
    text
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::wire::Message;

    fn ports(count: usize) -> Vec<Port> {
        let port = |i| Port {
            name: format!("p{i}"),
            shape: Some(vec![Dimension::Fixed(1), Dimension::Free("n".to_owned())]),
        };
        (0..count).map(port).collect()
    }

    /// A model with these outputs, each of a name and sizes.
    fn model(outputs: usize, name: &str, sizes: &[u64]) -> Vec<u8> {
        let shape = sizes.iter().fold(Message::new(), |m, &s| {
            m.message(1, &Message::new().integer(1, s))
        });
        let kind = Message::new().message(1, &Message::new().message(2, &shape));
        let port = Message::new().field(1, name).message(2, &kind);
        let graph = (0..outputs).fold(Message::new(), |g, _| g.message(12, &port));
        Message::new().message(7, &graph).into_bytes()
    }

    #[test]
    fn number_and_size_of_ports_are_bounded() {
        let most = Interface::read(&model(MOST_PORTS, "y", &[1; MOST_DIMENSIONS])).unwrap();
        assert_eq!(most.outputs.len(), MOST_PORTS);
        for (malicious, what) in [
            (model(MOST_PORTS + 1, "y", &[1]), "over 1024 outputs"),
            (
                model(1, "y", &[1; MOST_DIMENSIONS + 1]),
                "over 16 dimensions",
            ),
        ] {
            assert_eq!(Interface::read(&malicious).unwrap_err().to_string(), what);
        }
        let negative = Interface::read(&model(1, "y", &[u64::MAX, i64::MAX as u64])).unwrap();
        let sizes = [
            Dimension::Free(String::new()),
            Dimension::Fixed(i64::MAX as u64),
        ];
        assert_eq!(negative.outputs[0].shape.as_deref(), Some(&sizes[..]));
        let name = format!("a\n\u{1b}[2J{}", "b".repeat(1000));
        let shown = Interface::read(&model(1, &name, &[1])).unwrap().listing();
        assert!(shown.starts_with("  output  a\\n\\u{1b}[2Jbbb"), "{shown}");
        assert!(
            shown.ends_with("bbb... [1]") && shown.len() < 120,
            "{shown}"
        );
    }

    #[test]
    fn listing_shows_inputs_and_outputs_and_counts_the_rest() {
        for (inputs, outputs, shown, tail) in [
            (1, 2, 3, None),
            (300, 9, 12, Some("  and 297 more")),
            (1, 40, 12, Some("  and 29 more")),
            (300, 1, 12, Some("  and 289 more")),
        ] {
            let interface = Interface {
                inputs: ports(inputs),
                outputs: ports(outputs),
            };
            let listing = interface.listing();
            let lines: Vec<&str> = listing.lines().collect();
            assert_eq!(lines[0], "  input   p0 [1, n]");
            assert_eq!(
                lines.len(),
                shown + usize::from(tail.is_some()),
                "{listing}"
            );
            assert!(listing.contains("  output  p0 [1, n]"), "{listing}");
            assert!(tail.is_none_or(|tail| listing.ends_with(tail)), "{listing}");
        }
        let none = Interface::default().listing();
        assert_eq!(none, "  neither inputs nor outputs");
    }
}
