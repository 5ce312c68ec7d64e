//! Limits on a model's demands, checked in its file before any runtime reads it. Runtimes trust their input: they multiply sizes with
//! overflow, walk graphs by recursion, and allocate whatever an operator requests.
//!
//! A graph that computes its sizes can still demand anything: the program that runs it must bound its time and memory, e.g. in a separate
//! process.

mod tensors;

use crate::wire::{WireError, fields, text};
use std::collections::{BTreeMap, BTreeSet};
use tensors::{attribute_integers, tensor};

/// Maximum number of nodes of all graphs of a file: several times those of large detectors.
const MOST_NODES: usize = 16_384;
/// Maximum length of a chain of nodes. Runtimes walk such chains by recursion: `rten` needs some 450 bytes of stack for each, and a thread
/// has two megabytes. Detectors have some hundred, those with transformers up to a thousand.
const LONGEST_CHAIN: usize = 2500;
/// Maximum depth of nested graphs, by the branches of `If` and the body of `Loop`.
const MOST_DEPTH: usize = 4;
/// Maximum number of iterations of all loops around a node.
const MOST_TURNS: i64 = 1000;
/// Maximum number of values of one operator's output, if the file declares it: 1 GB of them.
const MOST_NUMBERS: u128 = 1 << 28;

/// Fields of `ModelProto`, `GraphProto`, `NodeProto`, `AttributeProto` and `TensorProto`.
mod field {
    pub(super) const GRAPH: u64 = 7;
    pub(super) const TRAINING: u64 = 20;
    pub(super) const FUNCTION: u64 = 25;
    pub(super) const NODE: u64 = 1;
    pub(super) const WEIGHT: u64 = 5;
    pub(super) const SPARSE_WEIGHT: u64 = 15;
    pub(super) const NODE_INPUT: u64 = 1;
    pub(super) const NODE_OUTPUT: u64 = 2;
    pub(super) const OPERATOR: u64 = 4;
    pub(super) const ATTRIBUTE: u64 = 5;
    pub(super) const A_TENSOR: u64 = 5;
    pub(super) const A_GRAPH: u64 = 6;
    pub(super) const TENSORS: u64 = 10;
    pub(super) const GRAPHS: u64 = 11;
    pub(super) const SPARSE: u64 = 22;
    pub(super) const SPARSES: u64 = 23;
    pub(super) const DIMENSION: u64 = 1;
    pub(super) const INT64_DATA: u64 = 7;
    pub(super) const TENSOR_NAME: u64 = 8;
    pub(super) const RAW_DATA: u64 = 9;
}

/// Checks all graphs of a model.
///
/// # Errors
/// The excessive demand, in words.
pub(super) fn check(model: &[u8]) -> Result<(), String> {
    let mut walk = Walk { nodes: 0 };
    for field in fields(model) {
        let field = field.map_err(damaged)?;
        match (field.number, field.value.bytes()) {
            (field::GRAPH, Some(graph)) => {
                let turns = 1;
                walk.graph(
                    graph,
                    Scope {
                        turns,
                        ..Scope::default()
                    },
                )?;
            }
            // Functions may call each other, each twice the next: thirty make a thousand million nodes.
            (field::FUNCTION, Some(_)) => {
                return Err(
                    "functions of the model's own; export it with functions inlined".into(),
                );
            }
            (field::TRAINING, Some(_)) => {
                return Err("a graph for training; export the model for inference".into());
            }
            _ => {}
        }
    }
    Ok(())
}

fn damaged(e: WireError) -> String {
    e.to_string()
}

/// State of a graph, and its enclosing graph.
#[derive(Default)]
struct Scope<'a, 's> {
    depth: usize,
    turns: i64,
    constants: BTreeMap<&'a str, Vec<i64>>,
    /// Length of the chain to each value of a node.
    chains: BTreeMap<&'a str, usize>,
    /// Length of the chain to the node that contains this graph.
    begins: usize,
    outer: Option<&'s Scope<'a, 's>>,
}

struct Walk {
    nodes: usize,
}

impl Walk {
    fn graph<'a>(&mut self, graph: &'a [u8], mut scope: Scope<'a, '_>) -> Result<(), String> {
        if scope.depth > MOST_DEPTH {
            return Err(format!(
                "graphs within graphs over {MOST_DEPTH} deep, as no detector has them"
            ));
        }
        for field in fields(graph) {
            let field = field.map_err(damaged)?;
            match (field.number, field.value.bytes()) {
                (field::WEIGHT, Some(weight)) => {
                    let name = text(weight, field::TENSOR_NAME).map_err(damaged)?;
                    scope.learn(name, tensor(weight)?);
                }
                (field::SPARSE_WEIGHT, Some(_)) => return Err(sparse()),
                (field::NODE, Some(node)) => {
                    self.nodes += 1;
                    if self.nodes > MOST_NODES {
                        return Err(format!("over {MOST_NODES} nodes, as no detector has them"));
                    }
                    scope.learn_constant(node)?;
                }
                _ => {}
            }
        }
        let mut awaited = outputs(graph)?;
        for field in fields(graph) {
            let field = field.map_err(damaged)?;
            if let (field::NODE, Some(node)) = (field.number, field.value.bytes()) {
                let node = Node::read(node)?;
                // The format orders nodes after their inputs; otherwise the length of a chain is unknown.
                if node.inputs.iter().any(|name| awaited.contains(name)) {
                    return Err("nodes in front of those whose outputs they take".to_owned());
                }
                let chain = scope.chain_to(&node) + 1;
                if chain > LONGEST_CHAIN {
                    return Err(format!(
                        "over {LONGEST_CHAIN} nodes one behind the other, as no detector has them"
                    ));
                }
                self.node(&node, &scope, chain)?;
                for name in node.outputs {
                    awaited.remove(name);
                    scope.chains.insert(name, chain);
                }
            }
        }
        Ok(())
    }

    fn node<'a>(
        &mut self,
        node: &Node<'a>,
        scope: &Scope<'a, '_>,
        chain: usize,
    ) -> Result<(), String> {
        node.check_size(scope)?;
        let turns = scope.turns * node.turns(scope);
        if turns > MOST_TURNS {
            return Err(format!(
                "a loop whose turns are not stated or over {MOST_TURNS}, as no detector needs it"
            ));
        }
        for attribute in &node.attributes {
            for field in fields(attribute) {
                let field = field.map_err(damaged)?;
                match (field.number, field.value.bytes()) {
                    (field::A_TENSOR | field::TENSORS, Some(bytes)) => drop(tensor(bytes)?),
                    (field::A_GRAPH | field::GRAPHS, Some(graph)) => {
                        let inner = Scope {
                            depth: scope.depth + 1,
                            turns,
                            constants: BTreeMap::new(),
                            chains: BTreeMap::new(),
                            begins: chain,
                            outer: Some(scope),
                        };
                        self.graph(graph, inner)?;
                    }
                    (field::SPARSE | field::SPARSES, Some(_)) => return Err(sparse()),
                    _ => {}
                }
            }
        }
        Ok(())
    }
}

/// Names of all outputs of a graph's nodes.
fn outputs(graph: &[u8]) -> Result<BTreeSet<&str>, String> {
    let mut names = BTreeSet::new();
    for field in fields(graph) {
        let field = field.map_err(damaged)?;
        if let (field::NODE, Some(node)) = (field.number, field.value.bytes()) {
            names.extend(Node::read(node)?.outputs);
        }
    }
    Ok(names)
}

fn sparse() -> String {
    "sparse weights, as no detector has them".to_owned()
}

impl<'a> Scope<'a, '_> {
    /// Length of the longest chain to a node.
    fn chain_to(&self, node: &Node<'a>) -> usize {
        let of = |name: &&str| {
            let mut scope = Some(self);
            while let Some(Scope { chains, outer, .. }) = scope {
                if let Some(chain) = chains.get(name) {
                    return *chain;
                }
                scope = *outer;
            }
            0
        };
        let longest = node.inputs.iter().map(of).max();
        longest.unwrap_or(0).max(self.begins)
    }

    fn learn(&mut self, name: Option<&'a str>, values: Option<Vec<i64>>) {
        if let (Some(name), Some(values)) = (name, values) {
            self.constants.insert(name, values);
        }
    }

    fn learn_constant(&mut self, node: &'a [u8]) -> Result<(), String> {
        if text(node, field::OPERATOR).map_err(damaged)? != Some("Constant") {
            return Ok(());
        }
        let name = text(node, field::NODE_OUTPUT).map_err(damaged)?;
        for attribute in fields(node) {
            let attribute = attribute.map_err(damaged)?;
            let (field::ATTRIBUTE, Some(bytes)) = (attribute.number, attribute.value.bytes())
            else {
                continue;
            };
            for field in fields(bytes) {
                let field = field.map_err(damaged)?;
                if let (field::A_TENSOR, Some(bytes)) = (field.number, field.value.bytes()) {
                    self.learn(name, tensor(bytes)?);
                }
            }
            // `value_int` and `value_ints`.
            let values = attribute_integers(bytes)?;
            if !values.is_empty() {
                self.learn(name, Some(values));
            }
        }
        Ok(())
    }
}

struct Node<'a> {
    operator: &'a str,
    inputs: Vec<&'a str>,
    outputs: Vec<&'a str>,
    attributes: Vec<&'a [u8]>,
}

impl<'a> Node<'a> {
    fn read(node: &'a [u8]) -> Result<Self, String> {
        let mut read = Self {
            operator: "",
            inputs: Vec::new(),
            outputs: Vec::new(),
            attributes: Vec::new(),
        };
        for field in fields(node) {
            let field = field.map_err(damaged)?;
            match (field.number, field.value.bytes()) {
                (field::NODE_INPUT, _) => read.inputs.push(field.value.text().unwrap_or_default()),
                (field::NODE_OUTPUT, _) => read
                    .outputs
                    .extend(field.value.text().filter(|name| !name.is_empty())),
                (field::OPERATOR, _) => read.operator = field.value.text().unwrap_or_default(),
                (field::ATTRIBUTE, Some(bytes)) => read.attributes.push(bytes),
                _ => {}
            }
        }
        Ok(read)
    }

    /// The integers of an input, if the file contains them.
    fn constant<'s>(&self, input: usize, scope: &'s Scope<'a, '_>) -> Option<&'s [i64]> {
        let name = self.inputs.get(input)?;
        let mut scope = Some(scope);
        while let Some(Scope {
            constants, outer, ..
        }) = scope
        {
            if let Some(values) = constants.get(name) {
                return Some(values);
            }
            scope = *outer;
        }
        None
    }

    /// Number of iterations of its subgraphs: a loop's trip count, and more than the limit if that is unknown.
    fn turns(&self, scope: &Scope<'a, '_>) -> i64 {
        if self.operator != "Loop" {
            return 1;
        }
        match self.constant(0, scope) {
            Some(&[turns]) if (0..=MOST_TURNS).contains(&turns) => turns.max(1),
            _ => MOST_TURNS + 1,
        }
    }

    /// Checks the size of the operator's output, if the file declares it, against the limit.
    fn check_size(&self, scope: &Scope<'a, '_>) -> Result<(), String> {
        let product = |shape: &[i64]| {
            let sizes = shape.iter().map(|&n| u128::from(n.max(1).unsigned_abs()));
            sizes.fold(1, u128::saturating_mul)
        };
        let input = |i: usize| self.constant(i, scope);
        let numbers = match self.operator {
            "Expand" | "Tile" => input(1).map(product),
            "ConstantOfShape" => input(0).map(product),
            "TopK" => input(1).map(product),
            "OneHot" => input(1).map(product),
            "Resize" => input(3).map(product),
            // Before and after each axis.
            "Pad" => input(1)
                .map(|pads| product(&pads.iter().map(|p| p.saturating_add(1)).collect::<Vec<_>>())),
            "Range" => match (input(0), input(1), input(2)) {
                (Some(&[start]), Some(&[limit]), Some(&[step])) => {
                    let span = i128::from(limit) - i128::from(start);
                    let count = span.checked_div(i128::from(step)).unwrap_or(0);
                    Some(count.max(0).unsigned_abs())
                }
                _ => None,
            },
            operator if operator.starts_with("Random") => {
                return Err("random numbers, as no detector needs them".to_owned());
            }
            _ => None,
        };
        match numbers {
            Some(n) if n > MOST_NUMBERS => Err(format!(
                "an operator {} that makes {n} numbers or more, over {MOST_NUMBERS}",
                self.operator.escape_debug()
            )),
            _ => Ok(()),
        }
    }
}

#[cfg(test)]
mod tests;
