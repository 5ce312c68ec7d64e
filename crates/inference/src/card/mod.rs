//! The model card: the meaning of a network's inputs and outputs. A few lines of TOML beside the model; known models need none.
//!
//! ```toml
//! head = "yolo-anchors"        # yolox, yolo-anchors, yolo-grid, distribution, end-to-end or detr
//! classes = "coco"             # or "coco-91", or a list of COCO's names, "-" for one to leave out
//!
//! [input]
//! size = [640, 640]            # width, height in px; needed only where the model leaves them free
//! colour = "rgb"               # or "bgr"
//! mean = [0, 0, 0]             # taken from values of 0 to 255, in the order of the channels
//! std = [255, 255, 255]        # what they are divided by then
//! resize = "centre"            # "top-left" and "centre" keep the aspect and pad, "stretch" does not
//! padding = 114                # 0 to 255
//!
//! [output]
//! strides = [8, 16, 32]        # px per cell of the maps, from fine to coarse
//! anchors = [[12, 16, 19, 36, 40, 28], [36, 75, 76, 55, 72, 146], [142, 110, 192, 243, 459, 401]]
//! sigmoid = false              # whether the scores have been through the sigmoid
//! ```
//!
//! Missing keys have the usual value of the head, except anchors, which a `yolo-anchors` card must state. Two more keys of `[output]` each
//! belong to one head:
//!
//! ```toml
//! centre = 0.5                 # distribution: where a cell's centre lies in it, in cells; NanoDet-Plus has 0
//! columns = ["batch", "x0", "y0", "x1", "y1", "class", "score"]  # end-to-end: of its table; "-" for others
//! ```

mod check;
mod coco91;
mod file;

pub(super) use check::{LARGEST, fits};

use file::CardFile;
use serde::{Deserialize, Serialize};
use std::fmt;
use stillpoint_detection::ClassId;

/// The meaning of a network's inputs and outputs.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CardFile")]
pub struct ModelCard {
    /// Decoding of the outputs.
    pub head: Head,
    /// Meaning of the class numbers.
    pub classes: Classes,
    /// The input.
    pub input: CardInput,
    /// The outputs.
    pub output: CardOutput,
}

/// Decoding of a network's outputs.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Head {
    /// YOLOX: one output of rows x, y, w, h, objectness, classes, one per cell: offsets in cells and logarithms of sizes.
    Yolox,
    /// YOLOv5 and YOLOv7: one map per stride as output by the last convolution; boxes are relative to cells and anchors.
    YoloAnchors,
    /// YOLOv5, YOLOv7 and YOLOX with built-in decoding: rows x, y, w, h, objectness, classes, in px of the input.
    YoloGrid,
    /// PicoDet and NanoDet: scores per class, and for each side of a box a distribution over its distance from the centre.
    Distribution,
    /// Built-in non-maximum suppression: outputs the final boxes.
    EndToEnd,
    /// RT-DETR, D-FINE, DEIM and RF-DETR: queries with a box and a score per class each, or the best of those.
    Detr,
}

/// A network's input.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CardInput {
    /// Width and height, px, for a model that leaves them free.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[usize; 2]>,
    /// Order of the channels.
    pub colour: ColourOrder,
    /// Subtracted from each channel's values (0 to 255), in the order of the channels.
    pub mean: [f32; 3],
    /// Divisor of each channel after the subtraction. Over 0.
    pub std: [f32; 3],
    /// How an image is fitted to the input's size.
    pub resize: Resize,
    /// Value of padding pixels, 0 to 255.
    pub padding: f32,
}

/// Order of a network's colour channels.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum ColourOrder {
    /// Blue, green, red.
    Bgr,
    /// Red, green, blue.
    Rgb,
}

/// How an image is fitted to a network's input size.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Resize {
    /// Scaled to fit, at the top left, padded to the right and below.
    TopLeft,
    /// Scaled to fit, in the middle, padded around.
    Centre,
    /// Stretched to the whole input.
    Stretch,
}

/// A network's outputs.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CardOutput {
    /// Cell sizes of the output maps, px of the input, from fine to coarse. None for `end-to-end` and `detr`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub strides: Vec<usize>,
    /// For `yolo-anchors`: widths and heights of the anchors in turn, per stride, px of the input.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub anchors: Vec<Vec<f32>>,
    /// Whether the scores have been through the sigmoid. For `yolo-anchors` this concerns all columns.
    pub sigmoid: bool,
    /// For `distribution`: position of a cell's centre, in cells. 0.5 in the middle; NanoDet-Plus has 0.
    pub centre: f32,
    /// For `end-to-end`: columns of the one output. A model with four outputs needs none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub columns: Vec<Column>,
}

/// Column of a box of an `end-to-end` model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Column {
    /// Number of the image in the batch; only the first image counts.
    Batch,
    /// Left side, px of the input.
    X0,
    /// Upper side, px of the input.
    Y0,
    /// Right side, px of the input.
    X1,
    /// Lower side, px of the input.
    Y1,
    /// Number of the class.
    Class,
    /// Score, 0 to 1.
    Score,
    /// Not used.
    #[serde(rename = "-")]
    Ignored,
}

/// Meaning of the class numbers.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Classes {
    /// The 80 of COCO in their usual order.
    Coco,
    /// COCO by annotation number, 0 to 90, of which eleven have no class.
    Coco91,
    /// A class of COCO per number; `None` for one to ignore.
    Listed(Vec<Option<ClassId>>),
}

/// Error: a model card cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CardError {
    /// Invalid TOML, no head, or an unknown key or word.
    #[error(
        "{name}: expected a model card in TOML, found: {reason}; correct the line or take it out"
    )]
    Syntax {
        /// Name of the card.
        name: String,
        /// The problem, with its line.
        reason: String,
    },
    /// Invalid values.
    #[error("{name}: {}", problems.join("\n"))]
    Values {
        /// Name of the card.
        name: String,
        /// All of them, each with its key, the expectation and the finding.
        problems: Vec<String>,
    },
}

impl ModelCard {
    /// With the usual values of a head, and COCO's classes. `yolo-anchors` has YOLOv7's anchors.
    #[must_use]
    pub fn new(head: Head) -> Self {
        Self {
            head,
            classes: Classes::Coco,
            input: CardInput::usual(head),
            output: CardOutput::usual(head),
        }
    }

    /// Parses a card; errors refer to it by `name`.
    ///
    /// # Errors
    /// [`CardError`] with all invalid values.
    pub fn parse(name: &str, text: &str) -> Result<Self, CardError> {
        let file: CardFile = toml::from_str(text).map_err(|e| CardError::Syntax {
            name: name.to_owned(),
            reason: file::reason(&e, text),
        })?;
        file.resolve().map_err(|problems| CardError::Values {
            name: name.to_owned(),
            problems,
        })
    }

    /// All invalid values, each with its key, the expectation and the finding.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        check::problems(self)
    }

    /// As a file's text, with all values.
    #[must_use]
    pub fn to_toml(&self) -> String {
        // Every card can be written as TOML.
        toml::to_string(self).unwrap_or_default()
    }

    /// Number of classes of the network.
    #[must_use]
    pub fn class_count(&self) -> usize {
        match &self.classes {
            Classes::Coco => ClassId::COUNT,
            Classes::Coco91 => coco91::COUNT,
            Classes::Listed(list) => list.len(),
        }
    }

    /// Class of a network's class number; `None` for ignored or unknown numbers.
    #[must_use]
    pub fn class(&self, number: usize) -> Option<ClassId> {
        match &self.classes {
            Classes::Coco => (number < ClassId::COUNT).then_some(ClassId(number as u8)),
            Classes::Coco91 => coco91::class(number),
            Classes::Listed(list) => list.get(number).copied().flatten(),
        }
    }

    /// Both sides of the input are multiples of this, px: the coarsest stride. Distribution heads derive their map of 64 px cells from that
    /// of 32, with a padded border.
    pub(super) fn alignment(&self) -> usize {
        let coarsest = self.output.strides.iter().copied().max().unwrap_or(32);
        match self.head {
            Head::Distribution => coarsest.min(32),
            // The graph itself defines the patch size of a transformer.
            Head::Detr => 1,
            _ => coarsest,
        }
    }
}

/// Mean and standard deviation of ImageNet's images, red, green and blue, 0 to 255, as used to train many networks.
pub(super) const IMAGENET: ([f32; 3], [f32; 3]) =
    ([123.675, 116.28, 103.53], [58.395, 57.12, 57.375]);

impl CardInput {
    /// Usual values of a head.
    #[must_use]
    pub fn usual(head: Head) -> Self {
        let yolo = Self {
            size: None,
            colour: ColourOrder::Rgb,
            mean: [0.0; 3],
            std: [255.0; 3],
            resize: Resize::Centre,
            padding: 114.0,
        };
        match head {
            Head::YoloAnchors | Head::YoloGrid | Head::EndToEnd => yolo,
            Head::Detr => Self {
                resize: Resize::Stretch,
                ..yolo
            },
            Head::Yolox => Self {
                colour: ColourOrder::Bgr,
                std: [1.0; 3],
                resize: Resize::TopLeft,
                ..yolo
            },
            // ImageNet's.
            Head::Distribution => Self {
                colour: ColourOrder::Bgr,
                mean: [103.53, 116.28, 123.675],
                std: [57.375, 57.12, 58.395],
                resize: Resize::Stretch,
                ..yolo
            },
        }
    }
}

impl CardOutput {
    /// Usual values of a head.
    #[must_use]
    pub fn usual(head: Head) -> Self {
        use Column::{Batch, Class, Score, X0, X1, Y0, Y1};
        let plain = Self {
            strides: vec![8, 16, 32],
            anchors: Vec::new(),
            sigmoid: true,
            centre: 0.5,
            columns: Vec::new(),
        };
        match head {
            Head::Yolox | Head::YoloGrid => plain,
            Head::YoloAnchors => Self {
                anchors: vec![
                    vec![12.0, 16.0, 19.0, 36.0, 40.0, 28.0],
                    vec![36.0, 75.0, 76.0, 55.0, 72.0, 146.0],
                    vec![142.0, 110.0, 192.0, 243.0, 459.0, 401.0],
                ],
                sigmoid: false,
                ..plain
            },
            Head::Distribution => Self {
                strides: vec![8, 16, 32, 64],
                ..plain
            },
            Head::EndToEnd => Self {
                strides: Vec::new(),
                columns: vec![Batch, X0, Y0, X1, Y1, Class, Score],
                ..plain
            },
            Head::Detr => Self {
                strides: Vec::new(),
                sigmoid: false,
                ..plain
            },
        }
    }
}

impl Head {
    /// All of them.
    pub const ALL: [Self; 6] = [
        Self::Yolox,
        Self::YoloAnchors,
        Self::YoloGrid,
        Self::Distribution,
        Self::EndToEnd,
        Self::Detr,
    ];

    /// Name in cards.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Yolox => "yolox",
            Self::YoloAnchors => "yolo-anchors",
            Self::YoloGrid => "yolo-grid",
            Self::Distribution => "distribution",
            Self::EndToEnd => "end-to-end",
            Self::Detr => "detr",
        }
    }
}

impl fmt::Display for Head {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests;
