//! A card as stored in a file: with missing values, and with classes by name.

use super::{CardInput, CardOutput, Classes, ColourOrder, Column, Head, ModelCard, Resize, check};
use serde::{Deserialize, Serialize, Serializer};
use stillpoint_detection::ClassId;

#[derive(Deserialize)]
#[serde(deny_unknown_fields)]
pub(super) struct CardFile {
    head: Head,
    #[serde(default)]
    classes: Option<Names>,
    #[serde(default)]
    input: InputFile,
    #[serde(default)]
    output: OutputFile,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct InputFile {
    size: Option<[usize; 2]>,
    colour: Option<ColourOrder>,
    mean: Option<[f32; 3]>,
    std: Option<[f32; 3]>,
    resize: Option<Resize>,
    padding: Option<f32>,
}

#[derive(Default, Deserialize)]
#[serde(default, deny_unknown_fields)]
struct OutputFile {
    strides: Option<Vec<usize>>,
    anchors: Option<Vec<Vec<f32>>>,
    sigmoid: Option<bool>,
    centre: Option<f32>,
    columns: Option<Vec<Column>>,
}

#[derive(Serialize, Deserialize)]
#[serde(
    untagged,
    expecting = "expected \"coco\", \"coco-91\" or a list of names"
)]
enum Names {
    Set(String),
    List(Vec<String>),
}

impl CardFile {
    /// The card, with usual values for missing ones.
    ///
    /// # Errors
    /// All invalid values.
    pub(super) fn resolve(self) -> Result<ModelCard, Vec<String>> {
        let (input, output) = (CardInput::usual(self.head), CardOutput::usual(self.head));
        let (classes, mut problems) = classes(self.classes);
        // Anchors differ between models of one head: guessed ones would give wrong boxes.
        let anchors = self.output.anchors.unwrap_or_default();
        let card = ModelCard {
            head: self.head,
            classes,
            input: CardInput {
                size: self.input.size,
                colour: self.input.colour.unwrap_or(input.colour),
                mean: self.input.mean.unwrap_or(input.mean),
                std: self.input.std.unwrap_or(input.std),
                resize: self.input.resize.unwrap_or(input.resize),
                padding: self.input.padding.unwrap_or(input.padding),
            },
            output: CardOutput {
                strides: self.output.strides.unwrap_or(output.strides),
                anchors,
                sigmoid: self.output.sigmoid.unwrap_or(output.sigmoid),
                centre: self.output.centre.unwrap_or(output.centre),
                columns: self.output.columns.unwrap_or(output.columns),
            },
        };
        problems.extend(check::problems(&card));
        if problems.is_empty() {
            Ok(card)
        } else {
            Err(problems)
        }
    }
}

impl TryFrom<CardFile> for ModelCard {
    type Error = String;

    fn try_from(file: CardFile) -> Result<Self, String> {
        file.resolve().map_err(|problems| problems.join("; "))
    }
}

/// Classes of these names, and the problems found.
fn classes(names: Option<Names>) -> (Classes, Vec<String>) {
    let list = match names {
        None => return (Classes::Coco, Vec::new()),
        Some(Names::Set(set)) if set.eq_ignore_ascii_case("coco") => {
            return (Classes::Coco, Vec::new());
        }
        Some(Names::Set(set)) if set.eq_ignore_ascii_case("coco-91") => {
            return (Classes::Coco91, Vec::new());
        }
        Some(Names::Set(set)) => {
            let problem = format!(
                "classes: expected \"coco\", \"coco-91\" or a list of names, found \"{set}\""
            );
            return (Classes::Coco, vec![problem]);
        }
        Some(Names::List(list)) => list,
    };
    let mut problems = Vec::new();
    let classes = list.iter().enumerate().map(|(number, name)| {
        let class = ClassId::from_name(name);
        if class.is_none() && name.trim() != "-" {
            let advice = ClassId::nearest(name).map_or_else(
                || "write \"-\" to leave the class out".to_owned(),
                |near| format!("did you mean \"{near}\"? \"-\" leaves the class out"),
            );
            problems.push(format!(
                "classes[{number}]: expected one of COCO's 80 names, found \"{name}\"; {advice}"
            ));
        }
        class
    });
    let classes = Classes::Listed(classes.collect());
    (classes, problems)
}

impl Serialize for Classes {
    fn serialize<S: Serializer>(&self, serializer: S) -> Result<S::Ok, S::Error> {
        match self {
            Self::Coco => Names::Set("coco".to_owned()),
            Self::Coco91 => Names::Set("coco-91".to_owned()),
            Self::Listed(list) => {
                let name = |class: &Option<ClassId>| class.map_or("-", ClassId::name).to_owned();
                Names::List(list.iter().map(name).collect())
            }
        }
        .serialize(serializer)
    }
}

/// A TOML error on one line, with its line number.
pub(super) fn reason(error: &toml::de::Error, text: &str) -> String {
    let said = error
        .message()
        .split_whitespace()
        .collect::<Vec<_>>()
        .join(" ");
    match error.span().and_then(|span| text.get(..span.start)) {
        Some(before) => format!("line {}: {said}", before.matches('\n').count() + 1),
        None => said,
    }
}
