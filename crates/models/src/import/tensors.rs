//! Tensors: views of numbers in the archive. Shape, strides and offset are checked before any reading.

use super::error::{ImportError, Result, shown};
use super::pickle::{Arena, Class, Id, Kind, Scalar, Value};
use super::zip::Archive;
use std::cell::Cell;

/// Maximum number of dimensions of a tensor.
const MOST_DIMENSIONS: usize = 8;

/// A tensor's numbers in row-major order.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Tensor {
    pub(super) shape: Vec<usize>,
    /// All finite, and their number matches the shape.
    pub(super) values: Vec<f32>,
    pub(super) scalar: Scalar,
}

pub(super) struct Tensors<'p, 'a> {
    arena: &'p Arena<'a>,
    archive: &'p Archive<'a>,
    folder: &'a str,
    /// Numbers that may still be read. A file has no more numbers than bytes; only repeated views of the same memory exceed that.
    left: Cell<usize>,
    total: usize,
}

/// A tensor as described by the pickle.
struct View<'a> {
    scalar: Scalar,
    memory: &'a [u8],
    offset: usize,
    shape: Vec<usize>,
    strides: Vec<usize>,
}

impl<'p, 'a> Tensors<'p, 'a> {
    /// For an archive whose entries begin with `folder` and a slash.
    pub(super) fn new(
        arena: &'p Arena<'a>,
        archive: &'p Archive<'a>,
        folder: &'a str,
        bytes: usize,
    ) -> Self {
        Self {
            arena,
            archive,
            folder,
            left: Cell::new(bytes),
            total: bytes,
        }
    }

    /// Reads a tensor or parameter; `path` names it in errors.
    pub(super) fn read(&self, id: Id, path: &str) -> Result<Tensor> {
        let view = self.view(id, path)?;
        let count: usize = view.shape.iter().product();
        let Some(left) = self.left.get().checked_sub(count) else {
            return Err(ImportError::Limit {
                place: path.to_owned(),
                what: "numbers in all tensors together, one per byte of the file",
                limit: self.total,
            });
        };
        self.left.set(left);
        let values = view.values();
        match values.iter().find(|v| !v.is_finite()) {
            Some(value) => Err(fault(path, "finite numbers", value.to_string())),
            None => Ok(Tensor {
                shape: view.shape,
                values,
                scalar: view.scalar,
            }),
        }
    }

    fn view(&self, id: Id, path: &str) -> Result<View<'a>> {
        let mut id = id;
        if let Value::Call {
            function,
            arguments,
        } = self.arena.get(id)
            && function.kind == Kind::Parameter
        {
            id = *arguments
                .first()
                .ok_or_else(|| fault(path, "a parameter", "nothing"))?;
        }
        let [memory, offset, shape, strides] = self.parts(id, path)?;
        let (scalar, memory) = self.memory(memory, path)?;
        let offset = self.sizes_of(&[offset], path)?[0];
        let [shape, strides] = [shape, strides].map(|id| {
            let sizes = self.arena.sequence(id);
            let sizes = sizes.ok_or_else(|| fault(path, "sizes", "no tuple"))?;
            self.sizes_of(sizes, path)
        });
        let view = View {
            scalar,
            memory,
            offset,
            shape: shape?,
            strides: strides?,
        };
        view.check(path)?;
        Ok(view)
    }

    /// Memory, offset, shape and strides of `_rebuild_tensor_v2`.
    fn parts(&self, id: Id, path: &str) -> Result<[Id; 4]> {
        let found = self.arena.get(id);
        match found {
            Value::Call {
                function: Class {
                    kind: Kind::Tensor, ..
                },
                arguments,
            } if arguments.len() >= 4 => {
                Ok([arguments[0], arguments[1], arguments[2], arguments[3]])
            }
            _ => Err(fault(path, "a tensor", found.describe())),
        }
    }

    /// Reads `("storage", type, key, place, numbers)` and the archive's entry of that key.
    fn memory(&self, id: Id, path: &str) -> Result<(Scalar, &'a [u8])> {
        let outside = match self.arena.get(id) {
            Value::Outside(id) => self.arena.sequence(*id),
            _ => None,
        };
        let Some(&[tag, class, key, _, count]) = outside else {
            return Err(fault(
                path,
                "a tensor's memory",
                self.arena.get(id).describe(),
            ));
        };
        let (Some("storage"), Value::Class(class), Some(key), Some(count)) = (
            self.arena.text(tag),
            self.arena.get(class),
            self.arena.text(key),
            self.arena.integer(count),
        ) else {
            return Err(fault(
                path,
                "a tensor's memory as torch.save names it",
                "other values",
            ));
        };
        let Kind::Storage(scalar) = class.kind else {
            return Err(fault(path, "a type of numbers", class.path()));
        };
        let name = format!("{}/data/{key}", self.folder);
        let memory = self.archive.get(&name).ok_or_else(|| {
            fault(
                path,
                "its memory in the archive",
                format!("no `{}`", shown(&name)),
            )
        })?;
        let expected = usize::try_from(count)
            .ok()
            .and_then(|n| n.checked_mul(scalar.width()));
        if expected != Some(memory.len()) {
            return Err(fault(
                path,
                format!("{count} numbers of {} bytes", scalar.width()),
                format!("{} bytes in `{}`", memory.len(), shown(&name)),
            ));
        }
        Ok((scalar, memory))
    }

    fn sizes_of(&self, ids: &[Id], path: &str) -> Result<Vec<usize>> {
        if ids.len() > MOST_DIMENSIONS {
            return Err(fault(
                path,
                format!("at most {MOST_DIMENSIONS} dimensions"),
                ids.len().to_string(),
            ));
        }
        let sizes = ids.iter().map(|&id| {
            let size = self.arena.integer(id).and_then(|n| usize::try_from(n).ok());
            size.ok_or_else(|| {
                fault(
                    path,
                    "sizes and strides from 0 up",
                    self.arena.get(id).describe(),
                )
            })
        });
        sizes.collect()
    }
}

impl View<'_> {
    /// Checks that every number is in the memory, and that there are no more of them than the memory has.
    fn check(&self, path: &str) -> Result<()> {
        if let Scalar::Other(_) = self.scalar {
            return Err(fault(
                path,
                "floating-point numbers or 64-bit integers",
                format!("{:?}", self.scalar),
            ));
        }
        let stored = self.memory.len() / self.scalar.width();
        let count = self
            .shape
            .iter()
            .try_fold(1_usize, |n, &size| n.checked_mul(size));
        let mut steps = self.shape.iter().zip(&self.strides);
        let last = steps.try_fold(self.offset, |at, (&size, &stride)| {
            at.checked_add(size.saturating_sub(1).checked_mul(stride)?)
        });
        let fits = self.shape.len() == self.strides.len()
            && count.is_some_and(|n| n <= stored)
            && (count == Some(0) || last.is_some_and(|last| last < stored));
        if fits {
            return Ok(());
        }
        Err(fault(
            path,
            format!("a shape within the {stored} numbers stored"),
            format!(
                "shape {:?}, strides {:?}, offset {}",
                self.shape, self.strides, self.offset
            ),
        ))
    }

    fn values(&self) -> Vec<f32> {
        match self.scalar {
            Scalar::Half => self.gather(|b| half(u16::from_le_bytes(b))),
            Scalar::BFloat16 => self.gather(|[b0, b1]| f32::from_le_bytes([0, 0, b0, b1])),
            Scalar::Float => self.gather(f32::from_le_bytes),
            Scalar::Double => self.gather(|b| f64::from_le_bytes(b) as f32),
            Scalar::Long => self.gather(|b| i64::from_le_bytes(b) as f32),
            // Refused by `check`.
            Scalar::Other(_) => Vec::new(),
        }
    }

    /// The numbers of `N` bytes, row by row of the last dimension.
    fn gather<const N: usize>(&self, read: impl Fn([u8; N]) -> f32) -> Vec<f32> {
        let (numbers, _) = self.memory.as_chunks::<N>();
        let count: usize = self.shape.iter().product();
        let (row, outer) = self.shape.split_last().unwrap_or((&1, &[]));
        let step = self.strides.last().copied().unwrap_or(1);
        let mut values = Vec::with_capacity(count);
        let mut index = vec![0; outer.len()];
        while values.len() < count {
            let place = index.iter().zip(&self.strides);
            let start = self.offset + place.map(|(i, s)| i * s).sum::<usize>();
            values.extend((0..*row).map(|i| read(numbers[start + i * step])));
            for (i, &size) in index.iter_mut().zip(outer).rev() {
                *i += 1;
                if *i < size {
                    break;
                }
                *i = 0;
            }
        }
        values
    }
}

/// IEEE 754 binary16 to binary32, exact.
fn half(bits: u16) -> f32 {
    let sign = u32::from(bits & 0x8000) << 16;
    let exponent = u32::from(bits >> 10 & 0x1f);
    let fraction = u32::from(bits & 0x3ff);
    match exponent {
        // Subnormal numbers are multiples of 2^-24.
        0 => f32::from_bits(sign | (fraction as f32 * (1.0 / 16_777_216.0)).to_bits()),
        0x1f => f32::from_bits(sign | 0x7f80_0000 | fraction << 13),
        _ => f32::from_bits(sign | (exponent + 112) << 23 | fraction << 13),
    }
}

fn fault(path: &str, expected: impl Into<String>, found: impl Into<String>) -> ImportError {
    ImportError::Tensor {
        path: path.to_owned(),
        expected: expected.into(),
        found: found.into(),
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn half_precision_is_read_exactly() {
        for (bits, value) in [
            (0x0000, 0.0),
            (0x3c00, 1.0),
            (0xc000, -2.0),
            (0x7bff, 65504.0),
            (0x0001, 5.960_464_5e-8),
            (0x8001, -5.960_464_5e-8),
            (0x0200, 3.051_757_8e-5),
            (0x0400, 6.103_515_6e-5),
            (0x3555, 0.333_251_95),
        ] {
            assert_eq!(half(bits), value, "{bits:04x}");
        }
        assert!(half(0x8000).is_sign_negative());
        assert_eq!(half(0x7c00), f32::INFINITY);
        assert!(half(0x7e00).is_nan());
    }
}
