//! The values of a pickle, side by side. They refer to one another by number, since the memo makes them a graph, with cycles if the file
//! wants; nothing here follows references, so nothing recurses.

use super::classes::Class;
use super::{MOST_ELEMENTS, MOST_VALUES};

/// Number of a value in its arena.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(in crate::import) struct Id(u32);

/// A value. Text and bytes stay where they are in the pickle.
#[derive(Clone, Debug, PartialEq)]
pub(in crate::import) enum Value<'a> {
    /// `None`.
    None,
    /// A truth value.
    Bool(bool),
    /// An integer of up to 64 bits.
    Integer(i64),
    /// A longer integer, whose value nothing needs.
    Long,
    /// A floating-point number.
    Float(f64),
    /// Text.
    Text(&'a str),
    /// Bytes.
    Bytes,
    /// A list.
    List(Vec<Id>),
    /// A tuple.
    Tuple(Vec<Id>),
    /// A set; its elements are not needed.
    Set,
    /// A dictionary; of entries with the same key the last counts.
    Dict(Vec<(Id, Id)>),
    /// A class or function itself.
    Class(Class<'a>),
    /// What a function would have made.
    Call {
        /// The function.
        function: Class<'a>,
        /// Its arguments.
        arguments: Vec<Id>,
    },
    /// A layer or network.
    Object {
        /// Its class.
        class: Class<'a>,
        /// Its attributes, a dictionary.
        state: Option<Id>,
    },
    /// What lies outside the pickle: the memory of a tensor.
    Outside(Id),
}

impl Value<'_> {
    /// What it is, for messages.
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

/// What there is too much of.
pub(super) type TooMany = (&'static str, usize);

impl<'a> Arena<'a> {
    /// Another value.
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

    /// Counts elements that go into values later.
    pub(super) fn count(&mut self, elements: usize) -> Result<(), TooMany> {
        self.elements += elements;
        if self.elements > MOST_ELEMENTS {
            return Err(("elements of lists", MOST_ELEMENTS));
        }
        Ok(())
    }

    /// A value, to be changed.
    pub(super) fn get_mut(&mut self, id: Id) -> &mut Value<'a> {
        &mut self.values[id.0 as usize]
    }

    /// A value.
    pub(in crate::import) fn get(&self, id: Id) -> &Value<'a> {
        &self.values[id.0 as usize]
    }

    /// Elements of a list or tuple.
    pub(in crate::import) fn sequence(&self, id: Id) -> Option<&[Id]> {
        match self.get(id) {
            Value::List(elements) | Value::Tuple(elements) => Some(elements),
            _ => None,
        }
    }

    /// Entries of a dictionary.
    pub(in crate::import) fn entries(&self, id: Id) -> Option<&[(Id, Id)]> {
        match self.get(id) {
            Value::Dict(entries) => Some(entries),
            _ => None,
        }
    }

    /// The text, if it is one.
    pub(in crate::import) fn text(&self, id: Id) -> Option<&'a str> {
        match self.get(id) {
            Value::Text(text) => Some(text),
            _ => None,
        }
    }

    /// The integer, if it is one.
    pub(in crate::import) fn integer(&self, id: Id) -> Option<i64> {
        match self.get(id) {
            Value::Integer(n) => Some(*n),
            _ => None,
        }
    }

    /// The number, if it is one.
    pub(in crate::import) fn number(&self, id: Id) -> Option<f64> {
        match self.get(id) {
            Value::Integer(n) => Some(*n as f64),
            Value::Float(x) => Some(*x),
            _ => None,
        }
    }

    /// What a dictionary has under a text.
    pub(in crate::import) fn entry(&self, dict: Id, key: &str) -> Option<Id> {
        let entries = self.entries(dict)?;
        let mut latest = entries.iter().rev();
        latest
            .find(|(k, _)| self.text(*k) == Some(key))
            .map(|(_, value)| *value)
    }
}
