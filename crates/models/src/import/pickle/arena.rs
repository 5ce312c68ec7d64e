//! The values of a pickle in an arena. They refer to each other by number, since the memo makes them a graph, possibly with cycles; nothing
//! here follows references, so nothing recurses.

use super::classes::Class;
use super::{MOST_ELEMENTS, MOST_VALUES};

/// Number of a value in its arena.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) struct Id(u32);

/// A value. Text and bytes are borrowed from the pickle.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::import) enum Value<'a> {
    None,
    Bool(bool),
    /// An integer of up to 64 bits.
    Integer(i64),
    /// A longer integer, whose value is not needed.
    Long,
    Float(f64),
    Text(&'a str),
    Bytes,
    List(Vec<Id>),
    Tuple(Vec<Id>),
    /// A set; its elements are not needed.
    Set,
    /// A dictionary; of entries with the same key the last counts.
    Dict(Vec<(Id, Id)>),
    Class(Class<'a>),
    /// A call that was not executed.
    Call {
        function: Class<'a>,
        arguments: Vec<Id>,
    },
    Object {
        class: Class<'a>,
        state: Option<Id>,
    },
    /// Data outside the pickle: the memory of a tensor.
    Outside(Id),
}

impl Value<'_> {
    pub(in crate::import) fn describe(&self) -> String {
        let text = match self {
            Self::None => "None",
            Self::Bool(_) => "a truth value",
            Self::Integer(n) => return n.to_string(),
            Self::Long => "a long integer",
            Self::Float(x) => return x.to_string(),
            Self::Text(_) => "text",
            Self::Bytes => "bytes",
            Self::List(v) => return format!("a list of {}", v.len()),
            Self::Tuple(v) => return format!("a tuple of {}", v.len()),
            Self::Set => "a set",
            Self::Dict(_) => "a dictionary",
            Self::Class(class) => return format!("the class {}", class.path()),
            Self::Call { function, .. } => return format!("the result of {}", function.path()),
            Self::Object { class, .. } => return format!("a {}", class.path()),
            Self::Outside(_) => "a tensor's memory",
        };
        text.to_owned()
    }
}

/// All values of a pickle, within limits.
#[derive(Default)]
pub(in crate::import) struct Arena<'a> {
    values: Vec<Value<'a>>,
    elements: usize,
}

/// Kind of the items, and the limit.
pub(super) type TooMany = (&'static str, usize);

impl<'a> Arena<'a> {
    pub(super) fn add(&mut self, value: Value<'a>) -> Result<Id, TooMany> {
        self.count(match &value {
            Value::List(elements) | Value::Tuple(elements) => elements.len(),
            Value::Call { arguments, .. } => arguments.len(),
            Value::Dict(entries) => 2 * entries.len(),
            _ => 0,
        })?;
        if self.values.len() >= MOST_VALUES {
            return Err(("values", MOST_VALUES));
        }
        self.values.push(value);
        Ok(Id((self.values.len() - 1) as u32))
    }

    /// Counts elements that are added to values later.
    pub(super) fn count(&mut self, elements: usize) -> Result<(), TooMany> {
        self.elements += elements;
        if self.elements > MOST_ELEMENTS {
            return Err(("elements of lists", MOST_ELEMENTS));
        }
        Ok(())
    }

    pub(super) fn get_mut(&mut self, id: Id) -> &mut Value<'a> {
        &mut self.values[id.0 as usize]
    }

    pub(in crate::import) fn get(&self, id: Id) -> &Value<'a> {
        &self.values[id.0 as usize]
    }

    pub(in crate::import) fn sequence(&self, id: Id) -> Option<&[Id]> {
        match self.get(id) {
            Value::List(elements) | Value::Tuple(elements) => Some(elements),
            _ => None,
        }
    }

    pub(in crate::import) fn entries(&self, id: Id) -> Option<&[(Id, Id)]> {
        match self.get(id) {
            Value::Dict(entries) => Some(entries),
            _ => None,
        }
    }

    pub(in crate::import) fn text(&self, id: Id) -> Option<&'a str> {
        match self.get(id) {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    pub(in crate::import) fn integer(&self, id: Id) -> Option<i64> {
        match self.get(id) {
            Value::Integer(n) => Some(*n),
            _ => None,
        }
    }

    pub(in crate::import) fn number(&self, id: Id) -> Option<f64> {
        match self.get(id) {
            Value::Integer(n) => Some(*n as f64),
            Value::Float(x) => Some(*x),
            _ => None,
        }
    }

    /// Value of a text key in a dictionary.
    pub(in crate::import) fn entry(&self, dict: Id, key: &str) -> Option<Id> {
        let entries = self.entries(dict)?;
        let mut latest = entries.iter().rev();
        latest
            .find(|(k, _)| self.text(*k) == Some(key))
            .map(|(_, value)| *value)
    }
}
