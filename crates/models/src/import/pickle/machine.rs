//! The stack machine of pickles, without all operations that could run foreign code.

use super::arena::{Arena, Id, TooMany, Value};
use super::reader::Reader;
use super::{LONGEST, MOST_VALUES};
use crate::import::error::{ImportError, Result, shown};
use std::collections::BTreeMap;

/// Reads a pickle to its end.
///
/// # Errors
/// Unknown opcodes or classes, an inconsistent stack, lengths beyond the pickle, and exceeded limits.
pub(in crate::import) fn read(bytes: &[u8]) -> Result<(Arena<'_>, Id)> {
    if bytes.len() > LONGEST {
        return Err(ImportError::Limit {
            place: "data.pkl".to_owned(),
            what: "bytes",
            limit: LONGEST,
        });
    }
    let mut machine = Machine {
        reader: Reader::new(bytes),
        at: 0,
        arena: Arena::default(),
        stack: Vec::new(),
        marks: Vec::new(),
        memo: BTreeMap::new(),
    };
    loop {
        machine.at = machine.reader.at();
        let opcode = machine.reader.byte()?;
        if opcode == b'.' {
            let root = machine.pop()?;
            return Ok((machine.arena, root));
        }
        machine.step(opcode)?;
    }
}

pub(super) struct Machine<'a> {
    pub(super) reader: Reader<'a>,
    pub(super) at: usize,
    pub(super) arena: Arena<'a>,
    stack: Vec<Id>,
    /// Heights of the stack at the marks.
    marks: Vec<usize>,
    memo: BTreeMap<u32, Id>,
}

impl<'a> Machine<'a> {
    /// Executes one opcode. Names are those of `pickletools`.
    fn step(&mut self, opcode: u8) -> Result<()> {
        match opcode {
            0x80 => self.protocol(),                            // PROTO
            0x95 => self.reader.length::<8>().map(|_| ()),      // FRAME: only a hint for buffering
            b'(' => self.mark(),                                // MARK
            b'0' => self.drop_one(),                            // POP
            b'1' => self.popped_mark().map(|_| ()),             // POP_MARK
            b'2' => self.top().and_then(|id| self.push_id(id)), // DUP
            b'N' | 0x88 | 0x89 | b'J' | b'K' | b'M' | 0x8a | 0x8b | b'G' => self.number(opcode),
            b'X' | 0x8c | 0x8d | b'U' | b'T' => self.text(opcode),
            b'B' | b'C' | 0x8e | 0x96 => self.bytes(opcode),
            b']' => self.push(Value::List(Vec::new())), // EMPTY_LIST
            b')' => self.push(Value::Tuple(Vec::new())), // EMPTY_TUPLE
            b'}' => self.push(Value::Dict(Vec::new())), // EMPTY_DICT
            0x8f => self.push(Value::Set),              // EMPTY_SET
            b'l' => self.popped_mark().and_then(|v| self.push(Value::List(v))), // LIST
            b't' => self.popped_mark().and_then(|v| self.push(Value::Tuple(v))), // TUPLE
            0x85..=0x87 => self.tuple(usize::from(opcode - 0x84)), // TUPLE1, 2, 3
            b'd' => self.dict(),                        // DICT
            0x91 => self.popped_mark().and_then(|_| self.push(Value::Set)), // FROZENSET
            b'a' => self.pop().and_then(|id| self.append(vec![id])), // APPEND
            b'e' => self.popped_mark().and_then(|v| self.append(v)), // APPENDS
            0x90 => self.popped_mark().and_then(|_| self.added_to_set()), // ADDITEMS
            b's' => self.set_one(),                     // SETITEM
            b'u' => self.popped_mark().and_then(|v| self.set_items(&v)), // SETITEMS
            b'c' => self.global(),                      // GLOBAL
            0x93 => self.stack_global(),                // STACK_GLOBAL
            b'R' => self.reduce(),                      // REDUCE
            b'b' => self.build(),                       // BUILD
            0x81 => self.new_object(0),                 // NEWOBJ
            0x92 => self.new_object(1),                 // NEWOBJ_EX
            b'P' => self.persistent_line(),             // PERSID
            b'Q' => self.pop().and_then(|id| self.push(Value::Outside(id))), // BINPERSID
            b'q' | b'r' | 0x94 => self.remember(opcode),
            b'h' | b'j' => self.recall(opcode),
            _ => Err(self.fault(
                "an opcode that torch.save writes",
                format!("0x{opcode:02x}"),
            )),
        }
    }

    fn protocol(&mut self) -> Result<()> {
        match self.reader.byte()? {
            2..=5 => Ok(()),
            other => Err(self.fault("protocol 2 to 5", format!("protocol {other}"))),
        }
    }

    /// NONE, NEWTRUE, NEWFALSE, BININT, BININT1, BININT2, LONG1, LONG4, BINFLOAT.
    fn number(&mut self, opcode: u8) -> Result<()> {
        let value = match opcode {
            b'N' => Value::None,
            b'J' => Value::Integer(i64::from(i32::from_le_bytes(self.reader.array()?))),
            b'K' => Value::Integer(i64::from(self.reader.byte()?)),
            b'M' => Value::Integer(i64::from(u16::from_le_bytes(self.reader.array()?))),
            0x8a => {
                let length = self.reader.length::<1>()?;
                self.reader
                    .long(length)?
                    .map_or(Value::Long, Value::Integer)
            }
            0x8b => {
                let length = self.reader.length::<4>()?;
                self.reader
                    .long(length)?
                    .map_or(Value::Long, Value::Integer)
            }
            b'G' => Value::Float(f64::from_be_bytes(self.reader.array()?)),
            _ => Value::Bool(opcode == 0x88),
        };
        self.push(value)
    }

    /// BINUNICODE, SHORT_BINUNICODE, BINUNICODE8; SHORT_BINSTRING and BINSTRING of Python 2.
    fn text(&mut self, opcode: u8) -> Result<()> {
        let length = match opcode {
            b'X' | b'T' => self.reader.length::<4>()?,
            0x8d => self.reader.length::<8>()?,
            _ => self.reader.length::<1>()?,
        };
        let text = self.reader.text(length)?;
        self.push(Value::Text(text))
    }

    /// BINBYTES, SHORT_BINBYTES, BINBYTES8, BYTEARRAY8: they contain nothing needed.
    fn bytes(&mut self, opcode: u8) -> Result<()> {
        let length = match opcode {
            b'B' => self.reader.length::<4>()?,
            b'C' => self.reader.length::<1>()?,
            _ => self.reader.length::<8>()?,
        };
        self.reader.take(length)?;
        self.push(Value::Bytes)
    }

    fn tuple(&mut self, length: usize) -> Result<()> {
        let mut elements = Vec::with_capacity(length);
        for _ in 0..length {
            elements.push(self.pop()?);
        }
        elements.reverse();
        self.push(Value::Tuple(elements))
    }

    fn dict(&mut self) -> Result<()> {
        let elements = self.popped_mark()?;
        self.push(Value::Dict(Vec::new()))?;
        self.set_items(&elements)
    }

    fn append(&mut self, mut elements: Vec<Id>) -> Result<()> {
        self.count(elements.len())?;
        let top = self.top()?;
        match self.arena.get_mut(top) {
            Value::List(list) => list.append(&mut elements),
            other => {
                let found = other.describe();
                return Err(self.fault("a list to append to", found));
            }
        }
        Ok(())
    }

    fn added_to_set(&mut self) -> Result<()> {
        let top = self.top()?;
        match self.arena.get(top) {
            Value::Set => Ok(()),
            other => Err(self.fault("a set to add to", other.describe())),
        }
    }

    fn set_one(&mut self) -> Result<()> {
        let value = self.pop()?;
        let key = self.pop()?;
        self.set_items(&[key, value])
    }

    fn set_items(&mut self, elements: &[Id]) -> Result<()> {
        if !elements.len().is_multiple_of(2) {
            return Err(self.fault("keys with values", "a key without one".to_owned()));
        }
        self.count(elements.len())?;
        let top = self.top()?;
        match self.arena.get_mut(top) {
            Value::Dict(dict) => {
                dict.extend(elements.chunks_exact(2).map(|pair| (pair[0], pair[1])));
                Ok(())
            }
            other => {
                let found = other.describe();
                Err(self.fault("a dictionary to set in", found))
            }
        }
    }

    /// BINPUT, LONG_BINPUT, MEMOIZE.
    fn remember(&mut self, opcode: u8) -> Result<()> {
        let key = match opcode {
            b'q' => u32::from(self.reader.byte()?),
            b'r' => u32::from_le_bytes(self.reader.array()?),
            _ => self.memo.len() as u32,
        };
        let top = self.top()?;
        self.memo.insert(key, top);
        if self.memo.len() > MOST_VALUES {
            return Err(self.limit(("entries of the memo", MOST_VALUES)));
        }
        Ok(())
    }

    /// BINGET, LONG_BINGET.
    fn recall(&mut self, opcode: u8) -> Result<()> {
        let key = match opcode {
            b'h' => u32::from(self.reader.byte()?),
            _ => u32::from_le_bytes(self.reader.array()?),
        };
        match self.memo.get(&key) {
            Some(&id) => self.push_id(id),
            None => Err(self.fault("a value that was remembered", format!("number {key}"))),
        }
    }

    fn mark(&mut self) -> Result<()> {
        self.marks.push(self.stack.len());
        if self.marks.len() > MOST_VALUES {
            return Err(self.limit(("marks", MOST_VALUES)));
        }
        Ok(())
    }

    /// POP removes a mark if that is on top.
    fn drop_one(&mut self) -> Result<()> {
        if self.marks.last() == Some(&self.stack.len()) {
            self.marks.pop();
            return Ok(());
        }
        self.pop().map(|_| ())
    }

    pub(super) fn popped_mark(&mut self) -> Result<Vec<Id>> {
        let mark = self.marks.pop();
        let mark = mark.ok_or_else(|| self.fault("a mark", "none".to_owned()))?;
        Ok(self.stack.split_off(mark))
    }

    pub(super) fn push(&mut self, value: Value<'a>) -> Result<()> {
        let id = self.add(value)?;
        self.push_id(id)
    }

    pub(super) fn push_id(&mut self, id: Id) -> Result<()> {
        if self.stack.len() >= MOST_VALUES {
            return Err(self.limit(("values on the stack", MOST_VALUES)));
        }
        self.stack.push(id);
        Ok(())
    }

    pub(super) fn pop(&mut self) -> Result<Id> {
        let id = self.top()?;
        self.stack.pop();
        Ok(id)
    }

    /// The top value, which is above the last mark.
    pub(super) fn top(&self) -> Result<Id> {
        let floor = self.marks.last().copied().unwrap_or(0);
        match self.stack.get(floor..).and_then(<[Id]>::last) {
            Some(&id) => Ok(id),
            None => Err(self.fault("a value on the stack", "none".to_owned())),
        }
    }

    pub(super) fn add(&mut self, value: Value<'a>) -> Result<Id> {
        self.arena.add(value).map_err(|t| self.limit(t))
    }

    pub(super) fn count(&mut self, elements: usize) -> Result<()> {
        self.arena.count(elements).map_err(|t| self.limit(t))
    }

    fn limit(&self, (what, limit): TooMany) -> ImportError {
        ImportError::Limit {
            place: format!("byte {} of data.pkl", self.at),
            what,
            limit,
        }
    }

    pub(super) fn fault(&self, expected: &'static str, found: String) -> ImportError {
        ImportError::Pickle {
            at: self.at,
            expected,
            found: shown(&found),
        }
    }
}
