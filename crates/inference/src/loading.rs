//! Loads a model's bytes into a network with known outputs: it is run once on a blank image, so that one that contradicts its card is
//! refused here and not at the first frame.

use super::card::{Head, ModelCard, fits};
use super::error::ModelError;
use super::heads::{
    Candidate, Mismatch, Reading, boxes_lie_in_their_cells, boxes_not_in_pixels, misplaced,
};
use super::known::{adapted, are_raw_maps, recognise};
use super::network::Network;
use super::runtime::{Runtime, Tensor};
use super::size::Size;
use super::{InputSize, OnnxOptions};

/// Input size of a model that leaves it free, if its card has none: the training size of most detectors.
const USUAL: Size = Size {
    width: 640,
    height: 640,
};

pub(super) struct Loaded {
    pub(super) network: Network,
    pub(super) card: ModelCard,
    /// The model's own size, or the card's.
    pub(super) own: Size,
    pub(super) size: Size,
}

/// Error: the network failed, or its outputs are wrong.
pub(super) enum Failure {
    Runtime(String),
    Output(Mismatch),
}

impl std::fmt::Display for Failure {
    fn fmt(&self, f: &mut std::fmt::Formatter<'_>) -> std::fmt::Result {
        match self {
            Self::Runtime(reason) => f.write_str(reason),
            Self::Output(Mismatch { expected, found }) => {
                write!(f, "{found} instead of {expected}")
            }
        }
    }
}

pub(super) fn load(
    bytes: Vec<u8>,
    name: &str,
    card: Option<&ModelCard>,
    runtime: &Runtime,
    options: &OnnxOptions,
) -> Result<Loaded, ModelError> {
    if let Some([problem, ..]) = card.map(ModelCard::problems).as_deref() {
        return Err(refused(
            name,
            "card",
            "values that make sense",
            problem.clone(),
            REMEDY,
        ));
    }
    let mut network = Network::open(bytes, name, options.threads, runtime)?;
    let own = own_size(&network, name, card)?;
    let known = match card {
        Some(card) => card.clone(),
        None => identify(&mut network, name, own)?,
    };
    let size = first_size(name, &known, own, network.own.is_some(), options.input)?;
    let wrong_size = |reason: String| ModelError::Size {
        name: name.to_owned(),
        asked: size.to_string(),
        reason,
        other: format!("{own} px"),
    };
    if network.own.is_none_or(|own| own == size) {
        start(&mut network, name, size)?;
    } else {
        network.prepare(size).map_err(wrong_size)?;
    }
    let outputs = network.run_plain(&known.input, size);
    let outputs = match outputs {
        Ok(outputs) => outputs,
        Err(reason) if size != own => return Err(wrong_size(reason)),
        Err(reason) => return Err(not_running(name, size, reason)),
    };
    numbers(&outputs).map_err(|Mismatch { found, .. }| not_running(name, size, found))?;
    in_place(name, &known, size, &outputs)?;
    if size != own && known.head == Head::YoloGrid {
        in_cells(&known, size, &outputs).map_err(|e| wrong_size(e.to_string()))?;
    }
    let card = match (read(&known, size, &outputs, 1.0), card) {
        (Ok(_), None) => adapted(&known, size, &outputs),
        (Ok(_), Some(card)) => agreed(name, card, size, &outputs)?,
        (Err(mismatch), _) if size != own => {
            return Err(wrong_size(Failure::Output(mismatch).to_string()));
        }
        (Err(_), None) => return Err(unknown(name, &network, size, &outputs)),
        (Err(Mismatch { expected, found }), Some(_)) => {
            let advice = "name the head, the classes and the strides that the model has";
            let expected = format!("{} with {expected}", known.head);
            return Err(refused(name, "head", &expected, found, advice));
        }
    };
    Ok(Loaded {
        network,
        card,
        own,
        size,
    })
}

const REMEDY: &str = "correct the card beside the model";

fn own_size(network: &Network, name: &str, card: Option<&ModelCard>) -> Result<Size, ModelError> {
    let stated = card.and_then(|c| c.input.size);
    let stated = stated.map(|[width, height]| Size { width, height });
    match (network.own, stated) {
        (Some(own), Some(stated)) if own != stated => {
            let advice = "leave it out of the card, since the model says it";
            Err(refused(
                name,
                "input.size",
                &stated.to_string(),
                own.to_string(),
                advice,
            ))
        }
        (Some(own), _) => Ok(own),
        (None, stated) => Ok(stated.unwrap_or(USUAL)),
    }
}

/// The built-in card of a known model, recognised by its file or else by its outputs.
fn identify(network: &mut Network, name: &str, own: Size) -> Result<ModelCard, ModelError> {
    if let Some(card) = ModelCard::known(network.interface()) {
        return Ok(card);
    }
    start(network, name, own)?;
    let input = ModelCard::new(Head::YoloGrid).input;
    let outputs = network
        .run_plain(&input, own)
        .map_err(|reason| not_running(name, own, reason))?;
    recognise(network.interface(), own, &outputs)
        .ok_or_else(|| unknown(name, network, own, &outputs))
}

fn first_size(
    name: &str,
    card: &ModelCard,
    own: Size,
    in_graph: bool,
    input: InputSize,
) -> Result<Size, ModelError> {
    let alignment = card.alignment();
    let whole = |size: Size| fits(size.width, alignment) && fits(size.height, alignment);
    let size = match input {
        InputSize::Fixed { width, height } => Size { width, height },
        InputSize::Model | InputSize::Fit => own,
    };
    let baked = matches!(card.head, Head::EndToEnd | Head::Detr) && in_graph;
    if size == own && (baked || whole(own)) {
        return Ok(size);
    }
    let reason = if baked {
        format!("one that is made for {own} px and decodes its boxes itself")
    } else if whole(size) {
        return Ok(size);
    } else {
        format!("a head whose sides are multiples of {alignment} up to 4096 px")
    };
    Err(ModelError::Size {
        name: name.to_owned(),
        asked: size.to_string(),
        reason,
        other: if baked {
            own.to_string()
        } else {
            "such a size".to_owned()
        },
    })
}

fn start(network: &mut Network, name: &str, size: Size) -> Result<(), ModelError> {
    network.prepare(size).map_err(|reason| ModelError::Load {
        name: name.to_owned(),
        reason,
    })
}

/// The given card, if the outputs agree with it.
fn agreed(
    name: &str,
    card: &ModelCard,
    size: Size,
    outputs: &[Tensor],
) -> Result<ModelCard, ModelError> {
    let seen = adapted(card, size, outputs);
    if seen.head != card.head {
        let expected = format!("{} with what that head gives", card.head);
        let found = match seen.head {
            Head::YoloGrid => "boxes in px, as yolo-grid has them",
            _ => "offsets in cells, as yolox has them",
        };
        return Err(refused(name, "head", &expected, found.to_owned(), REMEDY));
    }
    if seen.output.sigmoid != card.output.sigmoid {
        let reading = Reading {
            card,
            size,
            threshold: 1.0,
        };
        let (lowest, highest) = reading.score_range(outputs).unwrap_or_default();
        let expected = if card.output.sigmoid {
            "true, for scores from 0 to 1"
        } else {
            "false, for scores that have not been through the sigmoid"
        };
        let found = format!("scores from {lowest:.3} to {highest:.3}");
        return Err(refused(name, "output.sigmoid", expected, found, REMEDY));
    }
    Ok(card.clone())
}

/// Runs the network on a blank image at another size than its own.
///
/// # Errors
/// [`Failure`] of a graph that does not allow the size.
pub(super) fn attempt(network: &mut Network, card: &ModelCard, size: Size) -> Result<(), Failure> {
    let outputs = network.run_plain(&card.input, size);
    let outputs = outputs.map_err(Failure::Runtime)?;
    // The coordinates of cells may be part of the graph.
    if card.head == Head::YoloGrid {
        in_cells(card, size, &outputs)?;
    }
    let boxes = read(card, size, &outputs, 1.0);
    boxes.map(|_| ()).map_err(Failure::Output)
}

/// Runs the network on an input and decodes the boxes whose score reaches the threshold.
pub(super) fn look(
    network: &mut Network,
    card: &ModelCard,
    planes: &[f32],
    size: Size,
    threshold: f32,
) -> Result<Vec<Candidate>, Failure> {
    let outputs = {
        let _span = tracing::info_span!("network").entered();
        network.run(planes, size).map_err(Failure::Runtime)?
    };
    let _span = tracing::info_span!("decode").entered();
    read(card, size, &outputs, threshold).map_err(Failure::Output)
}

fn in_cells(card: &ModelCard, size: Size, outputs: &[Tensor]) -> Result<(), Failure> {
    let reading = Reading {
        card,
        size,
        threshold: 1.0,
    };
    if boxes_lie_in_their_cells(&reading, outputs) {
        return Ok(());
    }
    Err(Failure::Output(Mismatch {
        expected: format!("boxes near the cells of an input of {size} px"),
        found: "boxes in other places".to_owned(),
    }))
}

/// Refuses outputs with NaN: their scores reach no threshold, so the detector would silently find nothing.
fn numbers(outputs: &[Tensor]) -> Result<(), Mismatch> {
    let of = |t: &Tensor| t.data.iter().filter(|v| v.is_nan()).count();
    let found = outputs.iter().map(of).enumerate().find(|(_, n)| *n > 0);
    found.map_or(Ok(()), |(i, n)| {
        Err(Mismatch {
            expected: "numbers".to_owned(),
            found: format!(
                "NaN {n} times among the {} values of output {i}",
                outputs[i].data.len()
            ),
        })
    })
}

fn read(
    card: &ModelCard,
    size: Size,
    outputs: &[Tensor],
    threshold: f32,
) -> Result<Vec<Candidate>, Mismatch> {
    numbers(outputs)?;
    let reading = Reading {
        card,
        size,
        threshold,
    };
    reading.decode(outputs)
}

fn unknown(name: &str, network: &Network, size: Size, outputs: &[Tensor]) -> ModelError {
    let shapes = outputs.iter().map(|t| t.shape.clone());
    let interface = network.interface().with_outputs(shapes);
    ModelError::interface(name, &interface, are_raw_maps(size, outputs))
}

/// Refuses boxes in another unit (px or fractions of the input) than their head expects: nothing would be detected.
fn in_place(
    name: &str,
    card: &ModelCard,
    size: Size,
    outputs: &[Tensor],
) -> Result<(), ModelError> {
    let reading = Reading {
        card,
        size,
        threshold: 1.0,
    };
    if card.head == Head::Detr {
        return match misplaced(&reading, outputs) {
            None => Ok(()),
            Some((boxes, found)) => {
                let expected = format!("{} with {boxes}", card.head);
                let advice = "export the model with boxes in that unit";
                Err(refused(name, "head", &expected, found, advice))
            }
        };
    }
    let Some([x, y]) = boxes_not_in_pixels(&reading, outputs) else {
        return Ok(());
    };
    Err(refused(
        name,
        "head",
        &format!("{} with boxes in px of the input", Head::YoloGrid),
        format!("centres up to {x:.2}, {y:.2} for {size} px, as boxes in shares of the input have"),
        "export the model with boxes in px",
    ))
}

fn not_running(name: &str, size: Size, reason: String) -> ModelError {
    ModelError::Run {
        name: name.to_owned(),
        size: size.to_string(),
        reason,
    }
}

fn refused(
    name: &str,
    key: &'static str,
    expected: &str,
    found: String,
    advice: &'static str,
) -> ModelError {
    ModelError::Card {
        name: name.to_owned(),
        key,
        expected: expected.to_owned(),
        found,
        advice,
    }
}
