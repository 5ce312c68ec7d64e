//! Checks that bytes are a complete ONNX file. The runtime's reader accepts truncated files, and never ends on lengths that point
//! backwards, so the outer fields are checked first; within those it respects their bounds.

use crate::wire::{Value, fields};

/// Field of `ModelProto` with the format's version (`ir_version`).
const VERSION: u64 = 1;
/// Field of `ModelProto` with the network (`graph`).
const GRAPH: u64 = 7;

/// Checks the outermost fields (Protocol Buffers wire format, ONNX's `ModelProto`).
///
/// # Errors
/// The problem, for a message.
pub(super) fn check(bytes: &[u8]) -> Result<(), String> {
    let (mut version, mut graph) = (false, false);
    for field in fields(bytes) {
        let field = field.map_err(|e| e.to_string())?;
        version |= matches!((field.number, field.value), (VERSION, Value::Varint(_)));
        graph |= matches!((field.number, field.value), (GRAPH, Value::Bytes(_)));
    }
    if version && graph {
        Ok(())
    } else {
        Err("a file without a network".to_owned())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Version 7, a producer's name, a graph of three bytes.
    const MODEL: [u8; 11] = [0x08, 7, 0x12, 2, b'm', b'e', 0x3a, 3, 1, 2, 3];

    #[test]
    fn truncated_onnx_files_are_refused() {
        assert_eq!(check(&MODEL), Ok(()));
        for length in [1, 3, 4, 5, 7, 8, 9, 10] {
            let error = check(&MODEL[..length]).unwrap_err();
            assert!(error.contains("does not end within"), "{length}: {error}");
        }
        for length in [0, 2, 6] {
            assert_eq!(
                check(&MODEL[..length]),
                Err("a file without a network".to_owned())
            );
        }
    }

    #[test]
    fn other_files_are_refused() {
        assert!(check(&[0xff; 1000]).unwrap_err().contains("does not end"));
        assert!(check(b"not a model").is_err());
    }
}
