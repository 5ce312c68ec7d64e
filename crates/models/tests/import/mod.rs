//! Import of checkpoints: recorded ones give PyTorch's results; damaged and malicious ones end in an error with its place, without panic,
//! endless work or memory beyond the limits. Nothing in a file is ever run, and no name in it becomes a path.

mod agreement;
mod archives;
mod mutated;
mod networks;
mod pickles;
mod small;
mod support;
