//! Tensors in a file: whether their values are present, and which of them may be shapes.

use super::{damaged, field};
use crate::wire::{fields, varints};

/// Maximum number of weights of one tensor, also if none are present: runtimes multiply the sizes of empty tensors, too.
const MOST_ELEMENTS: u128 = 1 << 31;
/// Maximum length of a constant that may be a shape.
const LONGEST_SHAPE: usize = 64;

/// The integers in an attribute, its fields 3 and 8.
pub(super) fn attribute_integers(attribute: &[u8]) -> Result<Vec<i64>, String> {
    let mut values = Vec::new();
    for field in fields(attribute) {
        let field = field.map_err(damaged)?;
        match (field.number, field.value.integer(), field.value.bytes()) {
            (3 | 8, Some(value), _) => values.push(value as i64),
            (8, _, Some(packed)) => {
                let packed = varints(packed).unwrap_or_default();
                values.extend(packed.into_iter().map(|v| v as i64));
            }
            _ => {}
        }
        values.truncate(LONGEST_SHAPE);
    }
    Ok(values)
}

/// Checks that a tensor holds the number of values that its sizes declare, and returns them if they may be a shape.
pub(super) fn tensor(tensor: &[u8]) -> Result<Option<Vec<i64>>, String> {
    let (mut sizes, mut data) = (Vec::new(), 0_u128);
    let (mut values, mut raw, mut is_int64) = (Vec::new(), None, false);
    for field in fields(tensor) {
        let field = field.map_err(damaged)?;
        match (field.number, field.value.integer(), field.value.bytes()) {
            (field::DIMENSION, Some(size), _) => sizes.push(size),
            (field::DIMENSION, _, Some(packed)) => {
                sizes.extend(varints(packed).ok_or("sizes of a tensor that are cut")?);
            }
            (2, Some(kind), _) => is_int64 = kind == 7,
            (field::INT64_DATA, Some(value), _) => values.push(value as i64),
            (field::INT64_DATA, _, Some(packed)) if packed.len() <= 10 * LONGEST_SHAPE => {
                let packed = varints(packed).unwrap_or_default();
                values.extend(packed.into_iter().map(|v| v as i64));
            }
            (field::RAW_DATA, _, Some(bytes)) => raw = Some(bytes),
            _ => {}
        }
        // For any element type, a byte holds at most two values.
        data += 2 * field.raw.len() as u128;
    }
    let factor = |n: u64| u128::from(n.max(1));
    let all = sizes
        .iter()
        .map(|&n| factor(n))
        .fold(1, u128::saturating_mul);
    let held = sizes.contains(&0) || all <= data;
    if sizes.len() > LONGEST_SHAPE || all > MOST_ELEMENTS || !held {
        let shown: Vec<String> = sizes.iter().take(8).map(u64::to_string).collect();
        return Err(format!(
            "a tensor of [{}] numbers in {} bytes",
            shown.join(", "),
            tensor.len()
        ));
    }
    if let Some(raw) = raw.filter(|r| is_int64 && r.len() <= 8 * LONGEST_SHAPE) {
        let (numbers, _) = raw.as_chunks::<8>();
        values.extend(numbers.iter().map(|&n| i64::from_le_bytes(n)));
    }
    Ok((is_int64 && values.len() <= LONGEST_SHAPE).then_some(values))
}
