//! Classes, calls and objects of a pickle: names from a list and records; nothing runs.

use super::arena::{Id, Value};
use super::classes::{Class, Kind};
use super::machine::Machine;
use crate::import::error::{ImportError, Result, shown};

impl<'a> Machine<'a> {
    pub(super) fn global(&mut self) -> Result<()> {
        let module = self.reader.line()?;
        let name = self.reader.line()?;
        self.class(module, name)
    }

    pub(super) fn stack_global(&mut self) -> Result<()> {
        let name = self.pop()?;
        let module = self.pop()?;
        match (self.arena.text(module), self.arena.text(name)) {
            (Some(module), Some(name)) => self.class(module, name),
            _ => Err(self.fault("the name of a class", self.arena.get(name).describe())),
        }
    }

    fn class(&mut self, module: &'a str, name: &'a str) -> Result<()> {
        match Class::known(module, name) {
            Some(class) => self.push(Value::Class(class)),
            None => Err(self.refused(format!("{module}.{name}"))),
        }
    }

    /// Records a call. Dictionaries and sets are created; of methods only the one that means "folded" passes.
    pub(super) fn reduce(&mut self) -> Result<()> {
        let arguments = self.pop()?;
        let function = self.popped_class()?;
        let Value::Tuple(arguments) = self.arena.get(arguments) else {
            return Err(self.fault("a tuple of arguments", "something else".to_owned()));
        };
        // Sets are not kept: their arguments need not be copied.
        if function.kind == Kind::Set {
            return self.push(Value::Set);
        }
        let arguments = arguments.clone();
        match (function.kind, arguments.as_slice()) {
            (Kind::Dict, []) => self.push(Value::Dict(Vec::new())),
            (Kind::Dict, [pairs]) => self.dict_of_pairs(*pairs),
            (Kind::Method, [_, name]) if self.arena.text(*name) == Some("fuseforward") => self
                .push(Value::Call {
                    function,
                    arguments,
                }),
            (Kind::Method, [_, name, ..]) => {
                let name = self.arena.text(*name).unwrap_or("?");
                Err(self.refused(format!("{}(..., {name})", function.path())))
            }
            (Kind::Tensor | Kind::Parameter | Kind::Inert, _) => self.push(Value::Call {
                function,
                arguments,
            }),
            _ => Err(self.refused(format!("a call of {}", function.path()))),
        }
    }

    /// `OrderedDict([(key, value), ...])`, as Python 2 wrote it.
    fn dict_of_pairs(&mut self, pairs: Id) -> Result<()> {
        let mut entries = Vec::new();
        for &pair in self.arena.sequence(pairs).unwrap_or_default() {
            match self.arena.sequence(pair) {
                Some(&[key, value]) => entries.push((key, value)),
                _ => return Err(self.fault("pairs of key and value", "something else".to_owned())),
            }
        }
        self.push(Value::Dict(entries))
    }

    pub(super) fn new_object(&mut self, keywords: usize) -> Result<()> {
        for _ in 0..=keywords {
            self.pop()?;
        }
        let class = self.popped_class()?;
        match class.kind {
            Kind::Layer => self.push(Value::Object { class, state: None }),
            Kind::Dict => self.push(Value::Dict(Vec::new())),
            _ => Err(self.refused(format!("an object of {}", class.path()))),
        }
    }

    /// Attributes of layers are kept, those of other values are not needed.
    pub(super) fn build(&mut self) -> Result<()> {
        let given = self.pop()?;
        let top = self.top()?;
        let is_dict = matches!(self.arena.get(given), Value::Dict(_));
        match self.arena.get_mut(top) {
            Value::Object { state, .. } if is_dict && state.is_none() => {
                *state = Some(given);
                Ok(())
            }
            Value::Call { .. } | Value::Dict(_) => Ok(()),
            other => {
                let found = other.describe();
                Err(self.fault("a new object and a dictionary of its attributes", found))
            }
        }
    }

    pub(super) fn persistent_line(&mut self) -> Result<()> {
        let name = self.reader.line()?;
        let name = self.add(Value::Text(name))?;
        self.push(Value::Outside(name))
    }

    fn popped_class(&mut self) -> Result<Class<'a>> {
        let id = self.pop()?;
        match self.arena.get(id) {
            Value::Class(class) => Ok(*class),
            other => Err(self.fault("a class or function", other.describe())),
        }
    }

    fn refused(&self, class: String) -> ImportError {
        ImportError::Refused {
            at: self.at,
            class: shown(&class),
        }
    }
}
