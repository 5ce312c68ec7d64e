//! Folds neighbouring layers into the weights of convolutions: batch norm, and the implicit parameters of the head. Sums use double
//! precision, so the only rounding is that to single precision.

use super::error::{ImportError, Result};
use super::modules::Module;
use super::pickle::{Scalar, Value};
use super::tensors::Tensor;

#[derive(Clone, Debug, PartialEq)]
pub(super) struct Convolution {
    /// Weights [outputs, inputs / groups, kernel height, kernel width].
    pub(super) weight: Vec<f32>,
    pub(super) bias: Vec<f32>,
    pub(super) outputs: usize,
    pub(super) inputs: usize,
    pub(super) groups: usize,
    pub(super) window: Window,
    pub(super) scalar: Scalar,
}

/// A sliding window; each pair is vertical, horizontal.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) struct Window {
    pub(super) kernel: [usize; 2],
    pub(super) stride: [usize; 2],
    pub(super) padding: [usize; 2],
    pub(super) dilation: [usize; 2],
}

impl Window {
    /// Reads the attributes shared by convolutions and poolings.
    pub(super) fn read(module: &Module<'_, '_>) -> Result<Self> {
        let window = Self {
            kernel: module.pair("kernel_size")?,
            stride: module.pair("stride")?,
            padding: module.pair("padding")?,
            dilation: module.pair("dilation")?,
        };
        // Then n pixels with n divisible by the step give exactly n / step, and neighbours in the grid stay neighbours.
        for axis in 0..2 {
            let [k, s, p, d] = [
                window.kernel[axis],
                window.stride[axis],
                window.padding[axis],
                window.dilation[axis],
            ];
            let reach = (k.max(1) - 1) * d + 1;
            let fits = k > 0 && d > 0 && reach > 2 * p && reach <= 2 * p + s;
            if !fits || window.stride[0] != window.stride[1] {
                return Err(module.fault(
                    "a window whose output is the input's size divided by its step",
                    format!("{window:?}"),
                ));
            }
        }
        Ok(window)
    }
}

impl Convolution {
    pub(super) fn read(module: &Module<'_, '_>) -> Result<Self> {
        if module.class.path() != "torch.nn.modules.conv.Conv2d" {
            return Err(module.fault("a Conv2d", module.class.path()));
        }
        module.demand("padding_mode", "`zeros`", |v| *v == Value::Text("zeros"))?;
        let window = Window::read(module)?;
        let [inputs, outputs, groups] =
            ["in_channels", "out_channels", "groups"].map(|n| module.size(n));
        let (inputs, outputs, groups) = (inputs?, outputs?, groups?);
        if groups == 0 || inputs * outputs == 0 || inputs % groups != 0 || outputs % groups != 0 {
            return Err(module.fault(
                "channels that can be divided into the groups",
                format!("{inputs} to {outputs} in {groups}"),
            ));
        }
        let [height, width] = window.kernel;
        let weight = module.tensor("weight", &[outputs, inputs / groups, height, width])?;
        let bias = module.optional_tensor("bias")?;
        let bias = bias.unwrap_or_else(|| Tensor {
            shape: vec![outputs],
            values: vec![0.0; outputs],
            scalar: weight.scalar,
        });
        if bias.shape != [outputs] {
            return Err(module.fault(format!("{outputs} biases"), format!("{:?}", bias.shape)));
        }
        Ok(Self {
            weight: weight.values,
            bias: bias.values,
            outputs,
            inputs,
            groups,
            window,
            scalar: weight.scalar,
        })
    }

    /// Folds in the subsequent batch norm: with gain g = weight / sqrt(var + eps), W' = g W and b' = g (b - mean) + bias (Ioffe and
    /// Szegedy, "Batch Normalization", 2015, algorithm 2).
    pub(super) fn fold_norm(&mut self, norm: &Module<'_, '_>) -> Result<()> {
        if norm.class.path() != "torch.nn.modules.batchnorm.BatchNorm2d" {
            return Err(norm.fault("a BatchNorm2d", norm.class.path()));
        }
        let eps = norm.number("eps")?;
        let shape = [self.outputs];
        let [mean, variance] = ["running_mean", "running_var"].map(|n| norm.tensor(n, &shape));
        let (mean, variance) = (mean?.values, variance?.values);
        let ones = || vec![1.0; self.outputs];
        let gain = affine(norm, "weight", &shape)?.unwrap_or_else(ones);
        let bias = affine(norm, "bias", &shape)?.unwrap_or_else(|| vec![0.0; self.outputs]);
        let per_output = self.weight.len() / self.outputs;
        for (o, weights) in self.weight.chunks_exact_mut(per_output).enumerate() {
            let spread = f64::from(variance[o]) + eps;
            if spread <= 0.0 {
                return Err(norm.fault("variances above zero", spread.to_string()));
            }
            let g = f64::from(gain[o]) / spread.sqrt();
            for w in weights {
                *w = (f64::from(*w) * g) as f32;
            }
            let shifted = f64::from(self.bias[o]) - f64::from(mean[o]);
            self.bias[o] = (shifted * g + f64::from(bias[o])) as f32;
        }
        self.check(norm)
    }

    /// Folds in the head's implicit parameters: m (W (x + a) + b) = (m W) x + m (W a + b), for a 1 x 1 kernel (Wang et al., "You Only Learn
    /// One Representation", 2021, section 3).
    pub(super) fn fold_implicit(
        &mut self,
        module: &Module<'_, '_>,
        add: &Tensor,
        multiply: &Tensor,
    ) -> Result<()> {
        if self.window.kernel != [1, 1] || self.groups != 1 {
            return Err(module.fault(
                "a kernel of one pixel in one group",
                format!("{:?}", self.window),
            ));
        }
        for (o, weights) in self.weight.chunks_exact_mut(self.inputs).enumerate() {
            let m = f64::from(multiply.values[o]);
            let terms = weights.iter().zip(&add.values);
            let sum: f64 = terms.map(|(w, a)| f64::from(*w) * f64::from(*a)).sum();
            self.bias[o] = ((sum + f64::from(self.bias[o])) * m) as f32;
            for w in weights {
                *w = (f64::from(*w) * m) as f32;
            }
        }
        self.check(module)
    }

    /// Finite factors can have a product beyond single precision.
    fn check(&self, module: &Module<'_, '_>) -> Result<()> {
        let mut all = self.weight.iter().chain(&self.bias);
        match all.find(|v| !v.is_finite()) {
            Some(value) => Err(ImportError::Tensor {
                path: module.path.clone(),
                expected: "weights within single precision once it is folded in".to_owned(),
                found: value.to_string(),
            }),
            None => Ok(()),
        }
    }
}

fn affine(norm: &Module<'_, '_>, name: &str, shape: &[usize]) -> Result<Option<Vec<f32>>> {
    let Some(tensor) = norm.optional_tensor(name)? else {
        return Ok(None);
    };
    if tensor.shape != shape {
        return Err(norm.fault(
            format!("`{name}` of shape {shape:?}"),
            format!("{:?}", tensor.shape),
        ));
    }
    Ok(Some(tensor.values))
}
