//! The known kinds of layers.

use super::error::{ImportError, Result};
use super::modules::Module;
use std::collections::BTreeSet;

pub(super) const KNOWN: &str =
    "Conv, Concat, MP, SP, MaxPool2d, Upsample, Identity, Sequential, Detect and IDetect";

/// Maximum nesting of sequences.
const DEEPEST: usize = 4;
/// Maximum number of layers, including those in sequences.
pub(super) const MOST_LAYERS: usize = 1024;

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum LayerKind {
    Conv,
    Concat,
    /// Its child `m` is a pooling.
    Pool,
    MaxPool,
    Upsample,
    Identity,
    Sequence,
    /// The last layer: maps of boxes. `true` if it has implicit parameters.
    Head(bool),
}

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

/// A layer with its parts, in order.
pub(super) type Steps<'p, 'a> = Vec<(LayerKind, Module<'p, 'a>)>;

/// The parts of each layer, with sequences expanded.
///
/// # Errors
/// All unknown kinds at once; too many layers, sequences that are too deep or contain themselves.
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
