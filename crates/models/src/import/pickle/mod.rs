//! Reads pickles without executing them: the opcodes of protocols 2 to 5, as torch.save writes them, fill an arena of plain values. A class
//! or function is only a name from a list; "calling" it records the arguments.
//!
//! Source of the format: CPython's `pickletools` documentation and PEP 307, 3154 and 574.

mod arena;
mod classes;
mod machine;
mod objects;
mod reader;

pub(super) use arena::{Arena, Id, Value};
pub(super) use classes::{Class, Kind, Scalar};
pub(super) use machine::read;

/// Maximum size of the pickle, bytes; that of YOLOv7-tiny has 90 thousand, with an optimizer's state some hundred thousand.
pub(super) const LONGEST: usize = 1 << 24;
/// Maximum number of values, entries of the memo, and depth of the stack; YOLOv7-tiny has 20 thousand values.
pub(super) const MOST_VALUES: usize = 1 << 19;
/// Maximum number of elements of all lists, tuples, sets and dictionaries together.
pub(super) const MOST_ELEMENTS: usize = 1 << 20;
