//! The network as a graph of operations: every layer with its inputs, and the channels and stride of every intermediate map, so that
//! mismatches are reported here and not by the runtime.

use super::error::{ImportError, Result};
use super::fold::{Convolution, Window};
use super::head::{self, Head};
use super::kinds::{LayerKind, take_apart};
use super::modules::Module;
use super::pickle::Value;

/// Stride of the coarsest allowed map, px per cell.
const COARSEST: usize = 1024;
/// Maximum number of channels of a map; the largest YOLOv7 has some two thousand.
const MOST_CHANNELS: usize = 1 << 16;

/// Side of the image, px, for which the sizes of maps are counted: that of YOLOv7.
const SIDE: usize = 640;
/// Maximum number of values of one map of such an image; the largest of YOLOv7-tiny has some three million.
const MOST_VALUES: usize = 1 << 26;
/// Maximum number of values of all maps together; those of YOLOv7-tiny have some hundred million.
const MOST_VALUES_IN_ALL: usize = 1 << 30;

#[derive(Clone, Debug, PartialEq)]
pub(super) enum Operation {
    Conv(Convolution),
    /// x if positive, else this times x.
    LeakyRelu(f32),
    Relu,
    Silu,
    /// Channels of all inputs, one after another.
    Concat,
    MaxPool(Window),
    /// Repeats every pixel this many times in both directions.
    Upsample(usize),
}

/// A node; its output map has the number of its position among the nodes plus one, 0 is the image.
#[derive(Clone, Debug, PartialEq)]
pub(super) struct Node {
    pub(super) path: String,
    pub(super) operation: Operation,
    pub(super) inputs: Vec<usize>,
}

#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Map {
    pub(super) channels: usize,
    pub(super) stride: usize,
}

/// A network that ends in a head.
pub(super) struct Network {
    pub(super) nodes: Vec<Node>,
    /// Sizes of the maps, with the image first.
    pub(super) maps: Vec<Map>,
    pub(super) head: Head,
    pub(super) layers: usize,
    pub(super) norms: usize,
}

impl Network {
    /// Reads the network under `model`, whose child `model` is the sequence of layers.
    pub(super) fn read(model: &Module<'_, '_>) -> Result<Self> {
        let layers = model.child("model")?.children()?;
        let apart = take_apart(&layers)?;
        let mut builder = Builder::default();
        let mut head = None;
        for (i, (layer, steps)) in layers.iter().zip(&apart).enumerate() {
            let mut inputs = builder.inputs(layer, i)?;
            for (kind, module) in steps {
                if let LayerKind::Head(implicit) = kind {
                    if head.is_some() || i + 1 != layers.len() || steps.len() != 1 {
                        return Err(module.fault("one head, as the last layer", "another place"));
                    }
                    head = Some(head::read(module, *implicit, &inputs, &mut builder)?);
                } else {
                    inputs = vec![builder.layer(*kind, module, &inputs)?];
                }
            }
            // The head has no output for other layers.
            let output = if head.is_some() {
                Vec::new()
            } else {
                vec![builder.single(layer, &inputs)?]
            };
            builder.outputs.extend(output);
        }
        let head = head.ok_or_else(|| model.fault("a head (Detect or IDetect)", "none"))?;
        Ok(Self {
            nodes: builder.nodes,
            maps: builder.maps,
            head,
            layers: layers.len(),
            norms: builder.norms,
        })
    }
}

pub(super) struct Builder {
    nodes: Vec<Node>,
    maps: Vec<Map>,
    /// Number of the output map of each layer.
    outputs: Vec<usize>,
    norms: usize,
    /// Values of all maps of an image of [`SIDE`].
    values: usize,
}

impl Default for Builder {
    fn default() -> Self {
        Self {
            nodes: Vec::new(),
            maps: vec![Map {
                channels: 3,
                stride: 1,
            }],
            outputs: Vec::new(),
            norms: 0,
            values: 0,
        }
    }
}

impl Builder {
    pub(super) fn map(&self, number: usize) -> Map {
        self.maps[number]
    }

    /// Input maps of the layer with this number: its attribute `f`, which counts from the front, or back from itself.
    fn inputs(&self, layer: &Module<'_, '_>, number: usize) -> Result<Vec<usize>> {
        let (from, _) = layer.integers("f")?;
        let found = from.iter().map(|&f| {
            if f == -1 && number == 0 {
                return Some(0);
            }
            let at = if f < 0 { number as i64 + f } else { f };
            let at = usize::try_from(at).ok().filter(|&at| at < number)?;
            self.outputs.get(at).copied()
        });
        let found: Option<Vec<usize>> = found.collect();
        found.filter(|f| !f.is_empty()).ok_or_else(|| {
            layer.fault(
                format!("inputs from layers before number {number}"),
                format!("{from:?}"),
            )
        })
    }

    fn single(&self, module: &Module<'_, '_>, inputs: &[usize]) -> Result<usize> {
        match inputs {
            [input] => Ok(*input),
            _ => Err(module.fault("one input", inputs.len().to_string())),
        }
    }

    /// Adds a layer's operations and returns the number of its output.
    fn layer(
        &mut self,
        kind: LayerKind,
        module: &Module<'_, '_>,
        inputs: &[usize],
    ) -> Result<usize> {
        if kind == LayerKind::Concat {
            return self.concat(module, inputs);
        }
        let input = self.single(module, inputs)?;
        match kind {
            LayerKind::Conv => self.conv(module, input),
            LayerKind::Pool => self.pool(&module.child("m")?, input),
            LayerKind::MaxPool => self.pool(module, input),
            LayerKind::Upsample => self.upsample(module, input),
            _ => Ok(input),
        }
    }

    fn conv(&mut self, module: &Module<'_, '_>, input: usize) -> Result<usize> {
        let mut convolution = Convolution::read(&module.child("conv")?)?;
        match module.optional("bn")? {
            Some(norm) if !module.is_folded() => {
                convolution.fold_norm(&norm)?;
                self.norms += 1;
            }
            _ => {}
        }
        let x = self.convolution(module, convolution, input)?;
        match module.optional("act")? {
            Some(activation) => self.activation(&activation, x),
            None => Ok(x),
        }
    }

    pub(super) fn convolution(
        &mut self,
        module: &Module<'_, '_>,
        convolution: Convolution,
        input: usize,
    ) -> Result<usize> {
        let map = self.maps[input];
        if map.channels != convolution.inputs {
            return Err(module.fault(
                format!("{} channels", convolution.inputs),
                map.channels.to_string(),
            ));
        }
        let after = Map {
            channels: convolution.outputs,
            stride: map.stride * convolution.window.stride[0],
        };
        self.add(module, Operation::Conv(convolution), vec![input], after)
    }

    fn activation(&mut self, module: &Module<'_, '_>, input: usize) -> Result<usize> {
        let operation = match (module.class.module, module.class.name) {
            ("torch.nn.modules.linear", "Identity") => return Ok(input),
            ("torch.nn.modules.activation", "LeakyReLU") => {
                Operation::LeakyRelu(module.number("negative_slope")? as f32)
            }
            ("torch.nn.modules.activation", "ReLU") => Operation::Relu,
            ("torch.nn.modules.activation", "SiLU") => Operation::Silu,
            _ => {
                return Err(module.fault(
                    "an activation LeakyReLU, SiLU, ReLU or Identity",
                    module.class.path(),
                ));
            }
        };
        self.add(module, operation, vec![input], self.maps[input])
    }

    fn concat(&mut self, module: &Module<'_, '_>, inputs: &[usize]) -> Result<usize> {
        if module.size("d")? != 1 {
            return Err(module.fault("channels (dimension 1) to join", "another dimension"));
        }
        let stride = self.maps[inputs[0]].stride;
        if let Some(&other) = inputs.iter().find(|&&i| self.maps[i].stride != stride) {
            return Err(module.fault(
                format!("maps of stride {stride} to join"),
                format!("one of stride {}", self.maps[other].stride),
            ));
        }
        let channels = inputs.iter().map(|&i| self.maps[i].channels).sum();
        self.add(
            module,
            Operation::Concat,
            inputs.to_vec(),
            Map { channels, stride },
        )
    }

    fn pool(&mut self, module: &Module<'_, '_>, input: usize) -> Result<usize> {
        if module.class.path() != "torch.nn.modules.pooling.MaxPool2d" {
            return Err(module.fault("a MaxPool2d", module.class.path()));
        }
        for name in ["ceil_mode", "return_indices"] {
            module.demand(name, "`False`", |v| *v == Value::Bool(false))?;
        }
        let window = Window::read(module)?;
        if window.dilation != [1, 1] {
            return Err(module.fault("a pooling without gaps", format!("{window:?}")));
        }
        let map = self.maps[input];
        let after = Map {
            stride: map.stride * window.stride[0],
            ..map
        };
        self.add(module, Operation::MaxPool(window), vec![input], after)
    }

    fn upsample(&mut self, module: &Module<'_, '_>, input: usize) -> Result<usize> {
        module.demand("mode", "`nearest`", |v| *v == Value::Text("nearest"))?;
        module.demand("size", "`None`", |v| *v == Value::None)?;
        let map = self.maps[input];
        match module.pair("scale_factor")? {
            [factor, other]
                if factor == other && factor > 0 && map.stride.is_multiple_of(factor) =>
            {
                let after = Map {
                    stride: map.stride / factor,
                    ..map
                };
                self.add(module, Operation::Upsample(factor), vec![input], after)
            }
            factors => Err(module.fault(
                format!("a factor that divides the stride {}", map.stride),
                format!("{factors:?}"),
            )),
        }
    }

    fn add(
        &mut self,
        module: &Module<'_, '_>,
        operation: Operation,
        inputs: Vec<usize>,
        map: Map,
    ) -> Result<usize> {
        // Maps can fill all memory without any weights: joining a map with itself is enough.
        let cells = (SIDE / map.stride.max(1)).max(1).pow(2);
        let values = map.channels.saturating_mul(cells);
        self.values = self.values.saturating_add(values);
        for (what, limit, found) in [
            ("channels", MOST_CHANNELS, map.channels),
            ("pixels of stride", COARSEST, map.stride),
            ("values in a map of a 640x640 image", MOST_VALUES, values),
            (
                "values in all maps of a 640x640 image",
                MOST_VALUES_IN_ALL,
                self.values,
            ),
        ] {
            if found > limit {
                return Err(ImportError::Limit {
                    place: module.path.clone(),
                    what,
                    limit,
                });
            }
        }
        self.nodes.push(Node {
            path: module.path.clone(),
            operation,
            inputs,
        });
        self.maps.push(map);
        Ok(self.maps.len() - 1)
    }
}
