//! The model card: what a network's numbers mean. A few lines of TOML beside the model; the known models need none.
//!
//! ```toml
//! head = "yolo-anchors"        # yolox, yolo-anchors, yolo-grid, distribution or end-to-end
//! classes = "coco"             # or a list of COCO's names, "-" for one to leave out
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
//! What is left out has the value that is usual for the head.

mod check;
mod file;

pub(super) use check::{LARGEST, fits};

use crate::ClassId;
use file::CardFile;
use serde::{Deserialize, Serialize};
use std::fmt;

/// What the numbers that go into a network and come out of it mean.
#[derive(Clone, Debug, PartialEq, Serialize, Deserialize)]
#[serde(try_from = "CardFile")]
pub struct ModelCard {
    /// How the outputs are read.
    pub head: Head,
    /// What the classes' numbers mean.
    pub classes: Classes,
    /// What the network is given.
    pub input: CardInput,
    /// What it gives.
    pub output: CardOutput,
}

/// How a network's outputs are read.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "kebab-case")]
pub enum Head {
    /// YOLOX: one output of rows x, y, w, h, objectness, classes, one per cell: offsets in cells and logarithms of sizes.
    Yolox,
    /// YOLOv5 and YOLOv7: one map per stride as the last convolution leaves it; boxes are relative to cells and anchors.
    YoloAnchors,
    /// YOLOv5, YOLOv7 and YOLOX with decoding inside: rows x, y, w, h, objectness, classes, in px of the input.
    YoloGrid,
    /// PicoDet and NanoDet: scores per class, and for each side of a box how likely each distance from the centre is.
    Distribution,
    /// Suppression of overlaps inside: the boxes themselves.
    EndToEnd,
}

/// What a network is given.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CardInput {
    /// Width and height, px, for a model that leaves them free.
    #[serde(skip_serializing_if = "Option::is_none")]
    pub size: Option<[usize; 2]>,
    /// Order of the channels.
    pub colour: ColourOrder,
    /// Taken from each channel's values (0 to 255), in the order of the channels.
    pub mean: [f32; 3],
    /// What each channel is divided by afterwards. Over 0.
    pub std: [f32; 3],
    /// How an image is brought to the input's size.
    pub resize: Resize,
    /// Value of the pixels beside the image, 0 to 255.
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

/// How an image is brought to a network's input size.
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

/// What a network gives.
#[derive(Clone, Debug, PartialEq, Serialize)]
pub struct CardOutput {
    /// Cells of the output maps, px of the input, from fine to coarse. None for `end-to-end`.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub strides: Vec<usize>,
    /// For `yolo-anchors`: per stride the anchors' widths and heights in turn, px of the input.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub anchors: Vec<Vec<f32>>,
    /// Whether the scores have been through the sigmoid. For `yolo-anchors` all columns have been or none.
    pub sigmoid: bool,
    /// For `distribution`: where a cell's centre lies in it, in cells. 0.5 in the middle; NanoDet-Plus has 0.
    pub centre: f32,
    /// For `end-to-end`: what the columns of the one output are. A model with four outputs needs none.
    #[serde(skip_serializing_if = "Vec::is_empty")]
    pub columns: Vec<Column>,
}

/// Column of a box of an `end-to-end` model.
#[derive(Clone, Copy, Debug, PartialEq, Eq, Serialize, Deserialize)]
#[serde(rename_all = "lowercase")]
pub enum Column {
    /// Number of the image in the batch; other images than the first are left out.
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
    /// How sure the network is, 0 to 1.
    Score,
    /// Something else.
    #[serde(rename = "-")]
    Ignored,
}

/// What the classes' numbers mean.
#[derive(Clone, Debug, PartialEq, Eq)]
pub enum Classes {
    /// The 80 of COCO in their usual order.
    Coco,
    /// A class of COCO per number; `None` for one that is left out.
    Listed(Vec<Option<ClassId>>),
}

/// A model card cannot be used.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum CardError {
    /// It is no TOML, lacks its head, or has a key or a word that cards do not have.
    #[error("{name}: expected a model card in TOML, found: {reason}; mend the line or take it out")]
    Syntax {
        /// Name of the card.
        name: String,
        /// What is wrong, with its line.
        reason: String,
    },
    /// Values that make no sense.
    #[error("{name}: {}", problems.join("\n"))]
    Values {
        /// Name of the card.
        name: String,
        /// All of them, each with its key, what was expected and what was found.
        problems: Vec<String>,
    },
}

impl ModelCard {
    /// With the values that are usual for a head, and COCO's classes. `yolo-anchors` has YOLOv7's anchors.
    #[must_use]
    pub fn new(head: Head) -> Self {
        Self {
            head,
            classes: Classes::Coco,
            input: CardInput::usual(head),
            output: CardOutput::usual(head),
        }
    }

    /// From a card's text; `name` is what errors call it.
    ///
    /// # Errors
    /// [`CardError`] with all values that make no sense.
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

    /// All values that make no sense, each with its key, what was expected and what was found.
    #[must_use]
    pub fn problems(&self) -> Vec<String> {
        check::problems(self)
    }

    /// As a file's text, with all values.
    #[must_use]
    pub fn to_toml(&self) -> String {
        // Nothing in a card is without a form in TOML.
        toml::to_string(self).unwrap_or_default()
    }

    /// Number of classes that the network tells apart.
    #[must_use]
    pub fn class_count(&self) -> usize {
        match &self.classes {
            Classes::Coco => ClassId::COUNT,
            Classes::Listed(list) => list.len(),
        }
    }

    /// The class of a number of the network's; `None` for one that is left out or that it does not have.
    #[must_use]
    pub fn class(&self, number: usize) -> Option<ClassId> {
        match &self.classes {
            Classes::Coco => (number < ClassId::COUNT).then_some(ClassId(number as u8)),
            Classes::Listed(list) => list.get(number).copied().flatten(),
        }
    }

    /// What both sides of the input are multiples of, px: the coarsest stride. Heads of distributions make their map of 64 px
    /// cells from that of 32, with its border filled up.
    pub(super) fn alignment(&self) -> usize {
        let coarsest = self.output.strides.iter().copied().max().unwrap_or(32);
        match self.head {
            Head::Distribution => coarsest.min(32),
            _ => coarsest,
        }
    }
}

impl CardInput {
    /// What is usual for a head.
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
    /// What is usual for a head.
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
        }
    }
}

impl Head {
    /// All of them.
    pub const ALL: [Self; 5] = [
        Self::Yolox,
        Self::YoloAnchors,
        Self::YoloGrid,
        Self::Distribution,
        Self::EndToEnd,
    ];

    /// As cards name it.
    #[must_use]
    pub fn name(self) -> &'static str {
        match self {
            Self::Yolox => "yolox",
            Self::YoloAnchors => "yolo-anchors",
            Self::YoloGrid => "yolo-grid",
            Self::Distribution => "distribution",
            Self::EndToEnd => "end-to-end",
        }
    }
}

impl fmt::Display for Head {
    fn fmt(&self, f: &mut fmt::Formatter<'_>) -> fmt::Result {
        f.write_str(self.name())
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    fn problems(text: &str) -> Vec<String> {
        match ModelCard::parse("m.toml", text) {
            Err(CardError::Values { name, problems }) => {
                assert_eq!(name, "m.toml");
                problems
            }
            other => panic!("{text}: {other:?}"),
        }
    }

    #[test]
    fn what_is_left_out_is_usual_for_the_head() {
        for head in Head::ALL {
            let text = format!("head = \"{head}\"");
            let mut expected = ModelCard::new(head);
            let text = match head {
                Head::YoloAnchors => {
                    expected.output.anchors = vec![vec![1.0, 2.0]; 3];
                    format!("{text}\n[output]\nanchors = [[1, 2], [1, 2], [1.0, 2]]")
                }
                _ => text,
            };
            assert_eq!(ModelCard::parse("m", &text), Ok(expected));
        }
    }

    #[test]
    fn what_is_written_is_read() {
        let mut cards: Vec<ModelCard> = Head::ALL.map(ModelCard::new).to_vec();
        let mut named = ModelCard::new(Head::YoloGrid);
        named.classes = Classes::Listed(vec![Some(ClassId::PERSON), None, Some(ClassId(60))]);
        named.input.size = Some([640, 384]);
        named.input.mean = [0.1, 103.53, -1e-7];
        cards.push(named);
        for card in cards {
            let text = card.to_toml();
            assert_eq!(ModelCard::parse("m", &text).as_ref(), Ok(&card), "{text}");
            assert!(!text.contains("0000000"), "{text}");
        }
    }

    /// The example of the documentation is YOLOv7-tiny's card.
    #[test]
    fn the_example_is_a_card() {
        let example: String = include_str!("mod.rs")
            .lines()
            .skip_while(|line| *line != "//! ```toml")
            .skip(1)
            .take_while(|line| *line != "//! ```")
            .map(|line| line.trim_start_matches("//!").to_owned() + "\n")
            .collect();
        let mut expected = ModelCard::new(Head::YoloAnchors);
        expected.input.size = Some([640, 640]);
        assert_eq!(ModelCard::parse("m", &example), Ok(expected));
    }

    #[test]
    fn all_problems_are_told_with_their_keys() {
        let found = problems(
            "head = \"yolox\"
             classes = [\"persn\", \"spaceship\", \"-\"]
             [input]
             size = [416, 400]
             std = [1, 0, 1]
             mean = [nan, 0, 0]
             padding = 256
             [output]
             strides = [8, 8, 24]
             anchors = [[1, 2]]
             columns = [\"x0\"]
             centre = 2",
        );
        let text = found.join("\n");
        for part in [
            "classes[0]: expected one of COCO's 80 names, found \"persn\"; did you mean \"person\"?",
            "classes[1]: expected one of COCO's 80 names, found \"spaceship\"; write \"-\"",
            "classes: expected the name of a class at least",
            "input.size: expected a width and a height that are multiples of 24",
            "input.std: ",
            "input.mean: ",
            "input.padding: expected a value from 0 to 255, found 256",
            "output.strides: ",
            "output.anchors: expected none",
            "output.columns: expected none",
            "output.centre: ",
        ] {
            assert!(text.contains(part), "{part} is not in:\n{text}");
        }
        assert_eq!(found.len(), 11, "{text}");
        assert!(
            problems("head = \"yolo-anchors\"")[0]
                .starts_with("output.anchors: expected the model's own")
        );
        let columns = "head = \"end-to-end\"\n[output]\ncolumns = [\"x0\", \"y0\", \"x1\", \"y1\", \"class\"]";
        assert!(problems(columns)[0].starts_with("output.columns: "));
        assert!(problems("head = \"yolox\"\nclasses = \"voc\"")[0].contains("found \"voc\""));
        let strides = "head = \"yolox\"\n[output]\nstrides = []";
        assert!(problems(strides)[0].starts_with("output.strides: "));
    }

    #[test]
    fn words_and_keys_that_are_unknown_are_refused_with_their_line() {
        for (text, part) in [
            ("", "missing field `head`"),
            ("head = \"yolo\"", "line 1: unknown variant `yolo`"),
            (
                "head = \"yolox\"\n[input]\ncolor = \"rgb\"",
                "line 3: unknown field `color`",
            ),
            ("head = \"yolox\"\n[input]\nsize = [1]", "line 3: "),
            (
                "head = \"yolox\"\nclasses = 80",
                "line 2: expected \"coco\" or a list of names",
            ),
            ("head = ", "line 1: "),
        ] {
            let error = ModelCard::parse("m.toml", text).unwrap_err().to_string();
            assert!(
                error.starts_with("m.toml: expected a model card"),
                "{error}"
            );
            assert!(error.contains(part), "{part} is not in: {error}");
            assert!(!error.contains('\n'), "{error}");
        }
    }

    #[test]
    fn numbers_are_classes_by_the_card() {
        let coco = ModelCard::new(Head::Yolox);
        assert_eq!(
            (coco.class(0), coco.class(80)),
            (Some(ClassId::PERSON), None)
        );
        let card =
            ModelCard::parse("m", "head = \"yolox\"\nclasses = [\"-\", \"Dining_Table\"]").unwrap();
        assert_eq!(card.class_count(), 2);
        let classes = [0, 1, 2].map(|n| card.class(n));
        assert_eq!(classes, [None, Some(ClassId(60)), None]);
    }
}
