//! Whether bytes are a whole ONNX file. The runtime's reader takes a cut file for a whole one, and never ends on lengths that
//! point backwards, so the outer fields are checked before it sees them; within those it keeps to their bounds.

/// Field of `ModelProto` that holds the format's version (`ir_version`).
const VERSION: u64 = 1;
/// Field of `ModelProto` that holds the network (`graph`).
const GRAPH: u64 = 7;

/// Checks the outermost fields (Protocol Buffers wire format, ONNX's `ModelProto`).
///
/// # Errors
/// What is wrong, for a message.
pub(super) fn check(bytes: &[u8]) -> Result<(), String> {
    let (mut rest, mut version, mut graph) = (bytes, false, false);
    while !rest.is_empty() {
        let at = bytes.len() - rest.len();
        let cut = || {
            format!(
                "a file of {} bytes whose field at byte {at} does not end within it",
                bytes.len()
            )
        };
        let tag = varint(&mut rest).ok_or_else(cut)?;
        let length = match tag & 7 {
            0 => varint(&mut rest).map(|_| 0),
            1 => Some(8),
            2 => varint(&mut rest),
            5 => Some(4),
            _ => return Err(format!("no field of Protocol Buffers at byte {at}")),
        };
        let length = length.ok_or_else(cut)?;
        rest = usize::try_from(length)
            .ok()
            .and_then(|n| rest.get(n..))
            .ok_or_else(cut)?;
        version |= tag == VERSION << 3;
        graph |= tag == GRAPH << 3 | 2;
    }
    if version && graph {
        Ok(())
    } else {
        Err("a file without a network".to_owned())
    }
}

/// Takes a number of seven bits per byte off the front; `None` when it does not end within ten bytes.
fn varint(rest: &mut &[u8]) -> Option<u64> {
    let mut value = 0;
    for (i, &byte) in rest.iter().take(10).enumerate() {
        value |= u64::from(byte & 0x7f) << (7 * i);
        if byte < 0x80 {
            *rest = &rest[i + 1..];
            return Some(value);
        }
    }
    None
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Version 7, a producer's name, a graph of three bytes.
    const MODEL: [u8; 11] = [0x08, 7, 0x12, 2, b'm', b'e', 0x3a, 3, 1, 2, 3];

    #[test]
    fn whole_files_pass_and_cut_ones_do_not() {
        assert_eq!(check(&MODEL), Ok(()));
        for length in [1, 3, 4, 5, 7, 8, 9, 10] {
            let error = check(&MODEL[..length]).unwrap_err();
            assert!(
                error.contains("does not end within it"),
                "{length}: {error}"
            );
        }
        for length in [0, 2, 6] {
            assert_eq!(
                check(&MODEL[..length]),
                Err("a file without a network".to_owned())
            );
        }
    }

    #[test]
    fn lengths_that_point_backwards_are_refused() {
        let mut bytes = vec![0x08, 7, 0x3a];
        bytes.extend([0xff; 9]);
        bytes.push(1);
        assert!(
            check(&bytes).unwrap_err().contains("does not end"),
            "a length of 2^64 - 1"
        );
        assert!(check(&[0xff; 1000]).unwrap_err().contains("does not end"));
        assert!(check(b"not a model").is_err());
    }
}
