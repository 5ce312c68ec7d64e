//! The modules of a network: objects of the pickle with their attributes, parameters and children, like PyTorch's `nn.Module`.

use super::error::{ImportError, Result};
use super::pickle::{Arena, Class, Id, Value};
use super::tensors::{Tensor, Tensors};

/// Maximum number of attributes of a module; the largest have some forty.
const MOST_ATTRIBUTES: usize = 512;
/// Maximum number of children of a module; the largest known networks have some two hundred layers.
const MOST_CHILDREN: usize = 1024;

#[derive(Clone, Copy)]
pub(super) struct Source<'p, 'a> {
    pub(super) arena: &'p Arena<'a>,
    pub(super) tensors: &'p Tensors<'p, 'a>,
}

#[derive(Clone)]
pub(super) struct Module<'p, 'a> {
    source: Source<'p, 'a>,
    state: Id,
    pub(super) class: Class<'a>,
    /// Its path in the network, e.g. `model.77.m.0`.
    pub(super) path: String,
}

impl<'p, 'a> Module<'p, 'a> {
    pub(super) fn new(source: Source<'p, 'a>, id: Id, path: String) -> Result<Self> {
        let found = source.arena.get(id);
        match found {
            Value::Object {
                class,
                state: Some(state),
            } => {
                let module = Self {
                    source,
                    state: *state,
                    class: *class,
                    path,
                };
                match source.arena.entries(*state) {
                    Some(entries) if entries.len() > MOST_ATTRIBUTES => Err(ImportError::Limit {
                        place: module.path,
                        what: "attributes",
                        limit: MOST_ATTRIBUTES,
                    }),
                    _ => Ok(module),
                }
            }
            _ => Err(fault(&path, "a module", found.describe())),
        }
    }

    pub(super) fn attribute(&self, name: &str) -> Option<Id> {
        self.source.arena.entry(self.state, name)
    }

    /// Children in order, each with its path.
    pub(super) fn children(&self) -> Result<Vec<Self>> {
        let entries = self.part("_modules")?;
        if entries.len() > MOST_CHILDREN {
            return Err(ImportError::Limit {
                place: self.path.clone(),
                what: "children",
                limit: MOST_CHILDREN,
            });
        }
        let children = entries.iter().map(|&(name, id)| {
            let name = self.source.arena.text(name).unwrap_or("?");
            Self::new(self.source, id, self.path_of(name))
        });
        children.collect()
    }

    /// The child of this name, if present and not `None`.
    pub(super) fn optional(&self, name: &str) -> Result<Option<Self>> {
        match self.found_in("_modules", name)? {
            Some(id) => Self::new(self.source, id, self.path_of(name)).map(Some),
            None => Ok(None),
        }
    }

    pub(super) fn child(&self, name: &str) -> Result<Self> {
        let found = self.optional(name)?;
        found.ok_or_else(|| self.fault(format!("a module `{name}`"), "none"))
    }

    /// The parameter or buffer of this name, if present and not `None`.
    pub(super) fn optional_tensor(&self, name: &str) -> Result<Option<Tensor>> {
        let found = match self.found_in("_parameters", name)? {
            Some(id) => Some(id),
            None => self.found_in("_buffers", name)?,
        };
        found
            .map(|id| self.source.tensors.read(id, &self.path_of(name)))
            .transpose()
    }

    /// The parameter or buffer of this name and shape.
    pub(super) fn tensor(&self, name: &str, shape: &[usize]) -> Result<Tensor> {
        let found = self.optional_tensor(name)?;
        let tensor = found.ok_or_else(|| self.fault(format!("a tensor `{name}`"), "none"))?;
        self.shaped(name, tensor, shape)
    }

    /// The tensor of this shape that is a plain attribute of this name.
    pub(super) fn plain_tensor(&self, name: &str, shape: &[usize]) -> Result<Tensor> {
        let id = self.attribute(name);
        let id = id.ok_or_else(|| self.fault(format!("a tensor `{name}`"), "none"))?;
        let tensor = self.source.tensors.read(id, &self.path_of(name))?;
        self.shaped(name, tensor, shape)
    }

    fn shaped(&self, name: &str, tensor: Tensor, shape: &[usize]) -> Result<Tensor> {
        if tensor.shape == shape {
            return Ok(tensor);
        }
        Err(ImportError::Tensor {
            path: self.path_of(name),
            expected: format!("shape {shape:?}"),
            found: format!("{:?}", tensor.shape),
        })
    }

    /// An attribute that is an integer, or an integral float, from 0 to 2^15: a size or count.
    pub(super) fn size(&self, name: &str) -> Result<usize> {
        let found = self
            .attribute(name)
            .and_then(|id| self.source.arena.number(id));
        found
            .and_then(size)
            .ok_or_else(|| self.unfit(name, "a size"))
    }

    /// An attribute that is a finite number.
    pub(super) fn number(&self, name: &str) -> Result<f64> {
        let found = self
            .attribute(name)
            .and_then(|id| self.source.arena.number(id));
        found
            .filter(|x| x.is_finite())
            .ok_or_else(|| self.unfit(name, "a number"))
    }

    /// An attribute that is a size or two of them (vertical, horizontal).
    pub(super) fn pair(&self, name: &str) -> Result<[usize; 2]> {
        let arena = self.source.arena;
        let one = |id| arena.number(id).and_then(size);
        let id = self.attribute(name);
        let both = id.and_then(|id| match arena.sequence(id) {
            Some(&[a, b]) => Some([one(a)?, one(b)?]),
            Some(_) => None,
            None => one(id).map(|n| [n, n]),
        });
        both.ok_or_else(|| self.unfit(name, "a size or two"))
    }

    /// Integers of an attribute that is one or a list of them, and whether it is a list.
    pub(super) fn integers(&self, name: &str) -> Result<(Vec<i64>, bool)> {
        let arena = self.source.arena;
        let id = self
            .attribute(name)
            .ok_or_else(|| self.unfit(name, "layers"))?;
        let list = arena.sequence(id);
        let ids = list.unwrap_or(std::slice::from_ref(&id));
        if ids.len() > MOST_CHILDREN {
            return Err(self.unfit(name, "layers"));
        }
        let all: Option<Vec<i64>> = ids.iter().map(|&id| arena.integer(id)).collect();
        let all = all.ok_or_else(|| self.unfit(name, "numbers of layers"))?;
        Ok((all, list.is_some()))
    }

    /// Fails if an attribute is present with an unsupported value.
    pub(super) fn demand(
        &self,
        name: &str,
        expected: &str,
        fits: impl Fn(&Value<'a>) -> bool,
    ) -> Result<()> {
        match self.attribute(name) {
            Some(id) if !fits(self.source.arena.get(id)) => Err(self.unfit(name, expected)),
            _ => Ok(()),
        }
    }

    /// Whether the module runs by a method that omits the layers folded into its convolutions.
    pub(super) fn is_folded(&self) -> bool {
        self.attribute("forward")
            .is_some_and(|id| matches!(self.source.arena.get(id), Value::Call { .. }))
    }

    pub(super) fn fault(
        &self,
        expected: impl Into<String>,
        found: impl Into<String>,
    ) -> ImportError {
        fault(&self.path, expected, found)
    }

    fn unfit(&self, name: &str, expected: &str) -> ImportError {
        let found = self
            .attribute(name)
            .map_or("none".to_owned(), |id| self.source.arena.get(id).describe());
        self.fault(format!("{expected} as `{name}`"), found)
    }

    fn part(&self, name: &str) -> Result<&'p [(Id, Id)]> {
        let id = self.attribute(name);
        id.and_then(|id| self.source.arena.entries(id))
            .ok_or_else(|| self.unfit(name, "a dictionary"))
    }

    fn found_in(&self, part: &str, name: &str) -> Result<Option<Id>> {
        if self.part(part)?.len() > MOST_CHILDREN {
            return Err(self.fault(
                format!("at most {MOST_CHILDREN} entries in `{part}`"),
                "more",
            ));
        }
        let arena = self.source.arena;
        let found = self
            .attribute(part)
            .and_then(|part| arena.entry(part, name));
        Ok(found.filter(|&id| *arena.get(id) != Value::None))
    }

    fn path_of(&self, name: &str) -> String {
        if self.path.is_empty() {
            return super::error::shown(name);
        }
        format!("{}.{}", self.path, super::error::shown(name))
    }
}

fn size(x: f64) -> Option<usize> {
    const LARGEST: f64 = 32_768.0;
    (x.fract() == 0.0 && (0.0..=LARGEST).contains(&x)).then_some(x as usize)
}

fn fault(path: &str, expected: impl Into<String>, found: impl Into<String>) -> ImportError {
    ImportError::Module {
        path: if path.is_empty() { "the network" } else { path }.to_owned(),
        expected: expected.into(),
        found: found.into(),
    }
}
