//! The cards that are built in, and which of them a model's inputs and outputs ask for.

use super::card::{CardInput, CardOutput, Column, Head, ModelCard};
use super::heads::{Reading, boxes_lie_in_their_cells};
use super::interface::{Dimension, Interface, Port};
use super::runtime::Tensor;
use super::size::Size;

/// The most numbers of an output that is looked at.
const MOST_NUMBERS: usize = 1 << 26;

impl ModelCard {
    /// The built-in card of a model with these inputs and outputs, for COCO's 80 classes: the first one whose head reads such
    /// outputs. `None` for unknown models, and for those whose file does not say enough, of which [`super::OnnxDetector`] knows
    /// more once it has run them.
    #[must_use]
    pub fn known(interface: &Interface) -> Option<Self> {
        let size = image_size(interface)?;
        let outputs: Option<Vec<Tensor>> = interface.outputs.iter().map(blank).collect();
        recognise(size, &outputs?)
    }
}

/// The first built-in card whose head reads these outputs of an input of this size.
pub(super) fn recognise(size: Size, outputs: &[Tensor]) -> Option<ModelCard> {
    let mut card = cards().into_iter().find(|card| {
        let reading = Reading {
            card,
            size,
            threshold: 1.0,
        };
        reading.decode(outputs).is_ok()
    })?;
    // NanoDet-Plus has the cells of PicoDet in one output, and their centres at the corners.
    if card.head == Head::Distribution && outputs.len() == 1 && card.output.strides.len() == 4 {
        card.output.centre = 0.0;
    }
    Some(card)
}

/// The card that suits what the numbers look like: rows that are decoded already, and scores that have been through the sigmoid
/// or have not. The outputs are of the card's head, of an image without anything in it.
pub(super) fn adapted(card: &ModelCard, size: Size, outputs: &[Tensor]) -> ModelCard {
    let reading = Reading {
        card,
        size,
        threshold: 1.0,
    };
    let mut new = card.clone();
    let decoded = || boxes_lie_in_their_cells(&reading, outputs);
    match card.head {
        Head::Yolox if decoded() => new.head = Head::YoloGrid,
        // One row per cell is YOLOX's.
        Head::YoloGrid if !decoded() => {
            new.head = Head::Yolox;
            if (Reading {
                card: &new,
                ..reading
            })
            .decode(outputs)
            .is_err()
            {
                new.head = Head::YoloGrid;
            }
        }
        _ => {}
    }
    // Rounding may go over by a little.
    if let Some((lowest, highest)) = reading.score_range(outputs) {
        new.output.sigmoid = lowest > -1e-3 && highest < 1.0 + 1e-3;
    }
    new
}

/// All built-in cards in the order in which they are tried.
fn cards() -> Vec<ModelCard> {
    let of = ModelCard::new;
    let with = |head, change: &dyn Fn(&mut CardInput, &mut CardOutput)| {
        let mut card = of(head);
        change(&mut card.input, &mut card.output);
        card
    };
    use Column::{Class, Score, X0, X1, Y0, Y1};
    vec![
        of(Head::Yolox),
        of(Head::YoloGrid),
        // The variants for large images have a fourth map.
        with(Head::YoloGrid, &|_, output| output.strides.push(64)),
        of(Head::YoloAnchors),
        // PicoDet; then NanoDet, which has three maps.
        of(Head::Distribution),
        with(Head::Distribution, &|_, output| {
            output.strides = vec![8, 16, 32]
        }),
        of(Head::EndToEnd),
        with(Head::EndToEnd, &|_, output| {
            output.columns = vec![X0, Y0, X1, Y1, Score, Class];
        }),
    ]
}

/// The size of the image input, if the model has no other input and says one.
fn image_size(interface: &Interface) -> Option<Size> {
    let [input] = &interface.inputs[..] else {
        return None;
    };
    image_of(input)?
}

/// Whether a port takes images, and of which size if it says one.
pub(super) fn image_of(input: &Port) -> Option<Option<Size>> {
    let [batch, channels, height, width] = &input.shape.as_ref()?[..] else {
        return None;
    };
    let is = |d: &Dimension, size| matches!(d, Dimension::Free(_)) || *d == Dimension::Fixed(size);
    if !is(batch, 1) || !is(channels, 3) {
        return None;
    }
    let (&Dimension::Fixed(width), &Dimension::Fixed(height)) = (width, height) else {
        return Some(None);
    };
    let size = Size {
        width: usize::try_from(width).ok()?,
        height: usize::try_from(height).ok()?,
    };
    let sane = |side| (1..=super::card::LARGEST).contains(&side);
    (sane(size.width) && sane(size.height)).then_some(Some(size))
}

/// An output of zeros; a free first size is a batch of one image, or a table without rows.
fn blank(port: &Port) -> Option<Tensor> {
    let dimensions = port.shape.as_ref()?;
    let shape = dimensions.iter().enumerate().map(|(i, d)| match d {
        Dimension::Fixed(size) => usize::try_from(*size).ok(),
        Dimension::Free(_) if i == 0 => Some(usize::from(dimensions.len() > 2)),
        Dimension::Free(_) => None,
    });
    let shape: Vec<usize> = shape.collect::<Option<_>>()?;
    let numbers = shape
        .iter()
        .try_fold(1_usize, |n, &size| n.checked_mul(size))?;
    (numbers <= MOST_NUMBERS).then(|| Tensor {
        data: vec![0.0; numbers],
        shape,
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    fn interface(input: &[u64], outputs: &[&[u64]]) -> Interface {
        let port = |shape: &[u64]| Port {
            name: "x".to_owned(),
            // Zero stands for a size that is free.
            shape: Some(
                shape
                    .iter()
                    .map(|&s| match s {
                        0 => Dimension::Free(String::new()),
                        s => Dimension::Fixed(s),
                    })
                    .collect(),
            ),
        };
        Interface {
            inputs: vec![port(input)],
            outputs: outputs.iter().map(|o| port(o)).collect(),
        }
    }

    fn known(input: &[u64], outputs: &[&[u64]]) -> Option<(Head, usize)> {
        let card = ModelCard::known(&interface(input, outputs))?;
        assert!(card.problems().is_empty(), "{card:?}");
        Some((card.head, card.output.strides.len()))
    }

    #[test]
    fn models_are_recognised_by_what_they_take_and_give() {
        let square = [1, 3, 416, 416];
        for (input, outputs, expected) in [
            (square, vec![&[1_u64, 3549, 85][..]], (Head::Yolox, 3)),
            ([1, 3, 640, 640], vec![&[1, 25200, 85]], (Head::YoloGrid, 3)),
            (
                [1, 3, 1280, 1280],
                vec![&[1, 102_000, 85]],
                (Head::YoloGrid, 4),
            ),
            (
                [0, 3, 320, 416],
                vec![&[1, 255, 40, 52], &[1, 255, 20, 26], &[1, 255, 10, 13]],
                (Head::YoloAnchors, 3),
            ),
            (
                square,
                vec![
                    &[1, 3, 52, 52, 85],
                    &[1, 3, 26, 26, 85],
                    &[1, 3, 13, 13, 85],
                ],
                (Head::YoloAnchors, 3),
            ),
            (
                square,
                vec![
                    &[1, 2704, 80],
                    &[1, 676, 80],
                    &[1, 169, 80],
                    &[1, 49, 80],
                    &[1, 2704, 32],
                    &[1, 676, 32],
                    &[1, 169, 32],
                    &[1, 49, 32],
                ],
                (Head::Distribution, 4),
            ),
            (square, vec![&[1, 3598, 112]], (Head::Distribution, 4)),
            (
                [1, 3, 320, 320],
                vec![&[1, 2100, 112]],
                (Head::Distribution, 3),
            ),
            (square, vec![&[0, 7]], (Head::EndToEnd, 0)),
            (square, vec![&[1, 300, 6]], (Head::EndToEnd, 0)),
            (
                square,
                vec![&[1, 1], &[1, 100, 4], &[1, 100], &[1, 100]],
                (Head::EndToEnd, 0),
            ),
        ] {
            assert_eq!(
                known(&input, &outputs),
                Some(expected),
                "{input:?} {outputs:?}"
            );
        }
        let centre = |outputs: &[&[u64]]| {
            ModelCard::known(&interface(&square, outputs))
                .unwrap()
                .output
                .centre
        };
        assert_eq!(centre(&[&[1, 3598, 112]]), 0.0);
    }

    #[test]
    fn what_is_unknown_stays_so() {
        for (input, outputs) in [
            (&[1, 3, 224, 224][..], &[&[1, 1000][..]][..]),
            (&[1, 1, 416, 416], &[&[1, 3549, 85]]),
            (&[2, 3, 416, 416], &[&[1, 3549, 85]]),
            (&[1, 3, 0, 0], &[&[1, 3549, 85]]),
            (&[1, 3, 416, 416], &[&[1, 3549, 84]]),
            (&[1, 3, 416, 416], &[&[1, 0, 85]]),
            (&[1, 3, 416, 416], &[&[1, u64::MAX, u64::MAX]]),
            (&[1, 3, u64::MAX, u64::MAX], &[&[1, 3549, 85]]),
            (&[1, 3, 416, 416], &[]),
        ] {
            assert_eq!(known(input, outputs), None, "{input:?} {outputs:?}");
        }
    }
}
