//! The last layer: one convolution per map, with the anchors of its boxes.

use super::error::Result;
use super::fold::Convolution;
use super::modules::Module;
use super::network::Builder;
use super::pickle::Scalar;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Head {
    /// Its maps, from the finest to the coarsest.
    pub(super) outputs: Vec<Output>,
    pub(super) classes: usize,
    /// True for implicit parameters, which are folded in.
    pub(super) implicit: bool,
    pub(super) scalar: Scalar,
}

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Output {
    pub(super) map: usize,
    pub(super) stride: usize,
    /// Widths and heights of the anchors in pixels.
    pub(super) anchors: Vec<[f32; 2]>,
}

/// Reads the head with these input maps and adds its convolutions.
pub(super) fn read(
    module: &Module<'_, '_>,
    implicit: bool,
    inputs: &[usize],
    builder: &mut Builder,
) -> Result<Head> {
    let [classes, each] = ["nc", "na"].map(|n| module.size(n));
    let (classes, each) = (classes?, each?);
    let levels = inputs.len();
    let anchors = module.tensor("anchors", &[levels, each, 2])?;
    let strides = module.plain_tensor("stride", &[levels])?;
    let convolutions = module.child("m")?.children()?;
    if convolutions.len() != levels || each == 0 || classes == 0 {
        return Err(module.fault(
            format!("{levels} convolutions with anchors and classes"),
            format!(
                "{} with {each} anchors and {classes} classes",
                convolutions.len()
            ),
        ));
    }
    let mut outputs = Vec::with_capacity(levels);
    let mut scalar = anchors.scalar;
    for (level, child) in convolutions.iter().enumerate() {
        let mut convolution = Convolution::read(child)?;
        if convolution.outputs != each * (classes + 5) {
            return Err(child.fault(
                format!("{each} times {classes} + 5 outputs"),
                convolution.outputs.to_string(),
            ));
        }
        if implicit && !module.is_folded() {
            fold(module, level, &mut convolution)?;
        }
        scalar = convolution.scalar;
        let map = builder.convolution(child, convolution, inputs[level])?;
        let stride = builder.map(map).stride;
        let stored = strides.values[level];
        if stored != stride as f32 {
            return Err(module.fault(
                format!("stride {stride}, as the layers before have it"),
                stored.to_string(),
            ));
        }
        let cells = &anchors.values[2 * each * level..][..2 * each];
        outputs.push(Output {
            map,
            stride,
            anchors: pixels(module, cells, stored)?,
        });
    }
    outputs.sort_by_key(|o| o.stride);
    if outputs.windows(2).any(|o| o[0].stride == o[1].stride) {
        return Err(module.fault("a stride of its own for each map", "two of one stride"));
    }
    Ok(Head {
        outputs,
        classes,
        implicit,
        scalar,
    })
}

/// Converts anchors from cells, as in the checkpoint, to pixels.
fn pixels(module: &Module<'_, '_>, cells: &[f32], stride: f32) -> Result<Vec<[f32; 2]>> {
    let (pairs, _) = cells.as_chunks();
    let anchors: Vec<[f32; 2]> = pairs.iter().map(|p| p.map(|c| c * stride)).collect();
    if anchors.as_flattened().iter().any(|&a| a <= 0.0) {
        return Err(module.fault("anchors above zero", format!("{anchors:?}")));
    }
    Ok(anchors)
}

/// Folds in the head's addition before and multiplication after a convolution.
fn fold(module: &Module<'_, '_>, level: usize, convolution: &mut Convolution) -> Result<()> {
    let index = level.to_string();
    let part = |list: &str, name: &str, channels| {
        let child = module.child(list)?.child(&index)?;
        if child.class.module != "models.common" || child.class.name != name {
            return Err(child.fault(name, child.class.path()));
        }
        child.tensor("implicit", &[1, channels, 1, 1])
    };
    let add = part("ia", "ImplicitA", convolution.inputs)?;
    let multiply = part("im", "ImplicitM", convolution.outputs)?;
    convolution.fold_implicit(module, &add, &multiply)
}
