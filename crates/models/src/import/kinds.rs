//! The kinds of layers that are known.

use super::error::{ImportError, Result};
use super::modules::Module;
use std::collections::BTreeSet;

/// The kinds, for messages.
pub(super) const KNOWN: &str =
    "Conv, Concat, MP, SP, MaxPool2d, Upsample, Identity, Sequential, Detect and IDetect";

/// Sequences of layers within one another.
const DEEPEST: usize = 4;
/// Layers of a network, with those in sequences.
pub(super) const MOST_LAYERS: usize = 1024;

/// What a layer does.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LayerKind {
    /// Convolution, batch norm, activation.
    Conv,
    /// Joins maps along the channels.
    Concat,
    /// Its child `m` is a pooling.
    Pool,
    /// Maximum of a window.
    MaxPool,
    /// Repeats pixels.
    Upsample,
    /// Nothing.
    Identity,
    /// Layers one after another.
    Sequence,
    /// The last layer: maps of boxes. `true` when it has implicit parameters.
    Head(bool),
}

/// The kind of a module.
pub(super) fn kind(module: &Module<'_, '_>) -> Option<LayerKind> {
    Some(match (module.class.module, module.class.name) {
        ("models.common", "Conv") => LayerKind::Conv,
        ("models.common", "Concat") => LayerKind::Concat,
        ("models.common", "MP" | "SP") => LayerKind::Pool,
        ("torch.nn.modules.pooling", "MaxPool2d") => LayerKind::MaxPool,
        ("torch.nn.modules.upsampling", "Upsample") => LayerKind::Upsample,
        ("torch.nn.modules.linear", "Identity") => LayerKind::Identity,
        ("torch.nn.modules.container", "Sequential") => LayerKind::Sequence,
        ("models.yolo", "Detect") => LayerKind::Head(false),
        ("models.yolo", "IDetect") => LayerKind::Head(true),
        _ => return None,
    })
}

/// A layer with those it consists of, in their order.
pub(super) type Steps<'p, 'a> = Vec<(LayerKind, Module<'p, 'a>)>;

/// What each layer consists of, sequences taken apart.
///
/// # Errors
/// Kinds that are not known, all at once; too many layers, sequences that are too deep or contain themselves.
pub(super) fn take_apart<'p, 'a>(layers: &[Module<'p, 'a>]) -> Result<Vec<Steps<'p, 'a>>> {
    let mut unknown = BTreeSet::new();
    let mut budget = MOST_LAYERS;
    let mut apart = Vec::with_capacity(layers.len());
    for layer in layers {
        let mut steps = Vec::new();
        walk(layer, 0, &mut budget, &mut steps, &mut unknown)?;
        apart.push(steps);
    }
    if unknown.is_empty() {
        return Ok(apart);
    }
    Err(ImportError::Layers {
        kinds: unknown.into_iter().collect(),
    })
}

fn walk<'p, 'a>(
    module: &Module<'p, 'a>,
    depth: usize,
    budget: &mut usize,
    steps: &mut Steps<'p, 'a>,
    unknown: &mut BTreeSet<String>,
) -> Result<()> {
    *budget = budget.checked_sub(1).ok_or_else(|| ImportError::Limit {
        place: module.path.clone(),
        what: "layers",
        limit: MOST_LAYERS,
    })?;
    match kind(module) {
        None => {
            unknown.insert(module.class.path());
        }
        Some(LayerKind::Sequence) if depth >= DEEPEST => {
            return Err(module.fault(
                format!("at most {DEEPEST} sequences within one another"),
                "more",
            ));
        }
        Some(LayerKind::Sequence) => {
            for child in module.children()? {
                walk(&child, depth + 1, budget, steps, unknown)?;
            }
        }
        Some(kind) => steps.push((kind, module.clone())),
    }
    Ok(())
}
