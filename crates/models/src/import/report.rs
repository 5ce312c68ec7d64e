//! Facts about a checkpoint.

use std::fmt;

/// Facts about a checkpoint.
#[derive(Clone, Debug, PartialEq, Eq)]
#[non_exhaustive]
pub struct Report {
    /// Number of layers, the head included.
    pub layers: usize,
    /// Number of weights and biases of the ONNX file, after folding.
    pub parameters: usize,
    /// Number of folded batch norms; 0 for a checkpoint that was folded before.
    pub norms: usize,
    /// Kind of the head.
    pub head: HeadKind,
    /// Pixels per cell of the head's maps.
    pub strides: Vec<usize>,
    /// Names of all classes.
    pub classes: Vec<String>,
    /// Classes that COCO does not have: the card ignores them.
    pub left_out: Vec<String>,
    /// Stored precision of the weights.
    pub precision: Precision,
    /// The imported network: the averaged weights (`ema`) if present, else `model`.
    pub network: &'static str,
    /// Version of PyTorch's file format, as stated in the file.
    pub format: Option<String>,
}

/// Kind of a head.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum HeadKind {
    /// Plain convolutions.
    Detect,
    /// Convolutions with folded implicit parameters.
    ImplicitDetect,
}

/// Stored precision of weights. In the ONNX file they have 32 bits.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub enum Precision {
    /// 16 bits, IEEE 754.
    Half,
    /// 16 bits, the upper half of 32.
    BFloat16,
    /// 32 bits.
    Single,
    /// 64 bits.
    Double,
}

impl fmt::Display for Report {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        let precision = match self.precision {
            Precision::Half => "half precision",
            Precision::BFloat16 => "bfloat16",
            Precision::Single => "single precision",
            Precision::Double => "double precision",
        };
        let head = match self.head {
            HeadKind::Detect => "Detect",
            HeadKind::ImplicitDetect => "IDetect (implicit parameters folded in)",
        };
        write!(
            f,
            "{} layers, {} parameters in {precision}, {} batch norms folded, head {head}, strides {:?}, {} classes",
            self.layers,
            self.parameters,
            self.norms,
            self.strides,
            self.classes.len()
        )?;
        if !self.left_out.is_empty() {
            write!(f, ", left out as not in COCO: {}", self.left_out.join(", "))?;
        }
        Ok(())
    }
}
