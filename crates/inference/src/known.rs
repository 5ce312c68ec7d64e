//! The built-in cards, and their recognition from a model's inputs and outputs.

use super::card::{CardInput, CardOutput, Classes, Column, Head, IMAGENET, ModelCard};
use super::heads::{Reading, boxes_lie_in_their_cells};
use super::interface::{Dimension, Interface, Port};
use super::runtime::Tensor;
use super::size::Size;

/// Maximum number of outputs of a head: two for each of six strides.
const MOST_OUTPUTS: usize = 12;
/// Maximum number of values of all outputs together, 256 MB of them: over ten times those of large detectors.
const MOST_NUMBERS: usize = 1 << 26;

impl ModelCard {
    /// The built-in card of a model with these inputs and outputs, for COCO's 80 classes: the first one whose head reads such outputs.
    /// `None` for unknown models, and for those whose file lacks shapes, which [`super::OnnxDetector`] recognises after running them.
    #[must_use]
    pub fn known(interface: &Interface) -> Option<Self> {
        let size = image_size(interface)?;
        if interface.outputs.len() > MOST_OUTPUTS || declared_numbers(interface).is_none() {
            return None;
        }
        let outputs: Option<Vec<Tensor>> = interface.outputs.iter().map(blank).collect();
        recognise(interface, size, &outputs?)
    }
}

/// The first built-in card whose head reads these outputs of an input of this size.
pub(super) fn recognise(
    interface: &Interface,
    size: Size,
    outputs: &[Tensor],
) -> Option<ModelCard> {
    let mut card = cards().into_iter().find(|card| {
        let reading = Reading {
            card,
            size,
            threshold: 1.0,
        };
        let classifier = card.head == Head::EndToEnd && is_row_per_image(interface, outputs);
        !classifier && reading.decode(outputs).is_ok()
    })?;
    // NanoDet-Plus has the cells of PicoDet in one output, and their centres at the corners.
    if card.head == Head::Distribution && outputs.len() == 1 && card.output.strides.len() == 4 {
        card.output.centre = 0.0;
    }
    Some(card)
}

/// Whether the one output is a classifier's row per image and not a table of boxes: with one row that is not declared free, or with one per
/// image.
fn is_row_per_image(interface: &Interface, outputs: &[Tensor]) -> bool {
    let [table] = outputs else {
        return false;
    };
    let [rows, _] = table.shape[..] else {
        return false;
    };
    let first = |ports: &[Port]| Some(ports.first()?.shape.as_ref()?.first()?.clone());
    match first(&interface.outputs) {
        Some(Dimension::Free(name)) => {
            !name.is_empty() && first(&interface.inputs) == Some(Dimension::Free(name))
        }
        _ => rows == 1,
    }
}

/// Whether outputs are raw maps, for any number of classes: their shapes do not determine the anchors.
pub(super) fn are_raw_maps(size: Size, outputs: &[Tensor]) -> bool {
    let columns = match outputs.first().map(|t| &t.shape[..]) {
        Some(&[1, depth, _, _]) if depth.is_multiple_of(3) => depth / 3,
        Some(&[1, 3, _, _, columns]) => columns,
        _ => return false,
    };
    let Some(classes @ 1..=1000) = columns.checked_sub(5) else {
        return false;
    };
    let mut card = ModelCard::new(Head::YoloAnchors);
    card.classes = Classes::Listed(vec![None; classes]);
    let reading = Reading {
        card: &card,
        size,
        threshold: 1.0,
    };
    reading.decode(outputs).is_ok()
}

/// Minimum number of values of the outputs, by their shapes in the file; `None` if over the limit.
pub(super) fn declared_numbers(interface: &Interface) -> Option<usize> {
    let numbers = |port: &Port| {
        let sizes = port.shape.iter().flatten();
        sizes
            .filter_map(|d| match d {
                Dimension::Fixed(size) => Some(*size),
                Dimension::Free(_) => None,
            })
            .try_fold(1_usize, |n, size| {
                n.checked_mul(usize::try_from(size).ok()?)
            })
    };
    interface
        .outputs
        .iter()
        .try_fold(0_usize, |sum, port| sum.checked_add(numbers(port)?))
        .filter(|&sum| sum <= MOST_NUMBERS)
}

/// The card adapted to the values: whether rows are decoded already, and whether scores have been through the sigmoid. The outputs are of
/// the card's head, for a blank image.
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
    // Rounding may exceed the range slightly.
    if let Some((lowest, highest)) = reading.score_range(outputs) {
        new.output.sigmoid = lowest > -1e-3 && highest < 1.0 + 1e-3;
    }
    new
}

/// All built-in cards in the order in which they are tried. None is for raw maps: YOLOv5's and YOLOv7's have the same shapes and different
/// anchors.
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
        // PicoDet; then NanoDet, which has three maps.
        of(Head::Distribution),
        with(Head::Distribution, &|_, output| {
            output.strides = vec![8, 16, 32]
        }),
        of(Head::EndToEnd),
        with(Head::EndToEnd, &|_, output| {
            output.columns = vec![X0, Y0, X1, Y1, Score, Class];
        }),
        // RT-DETR, D-FINE and DEIM; then RF-DETR, which has COCO's own numbers.
        of(Head::Detr),
        ModelCard {
            classes: Classes::Coco91,
            ..with(Head::Detr, &|input, _| (input.mean, input.std) = IMAGENET)
        },
    ]
}

/// Name of the input of D-FINE and related networks for the width and height in px to which boxes are scaled.
const TARGET_SIZE: &str = "orig_target_sizes";

/// Size of the image input, if it is declared and all inputs are known.
fn image_size(interface: &Interface) -> Option<Size> {
    let (image, _) = image_input(interface)?;
    image_of(image)?
}

/// The image input, and the input for the size to which boxes are scaled, if any. `None` for other inputs.
pub(super) fn image_input(interface: &Interface) -> Option<(&Port, Option<&Port>)> {
    match &interface.inputs[..] {
        [image] => Some((image, None)),
        [image, target] | [target, image] if is_target_size(target) => Some((image, Some(target))),
        _ => None,
    }
}

/// Whether a port takes a width and a height for each image.
fn is_target_size(port: &Port) -> bool {
    let two = Dimension::Fixed(2);
    let rows = |d: &Dimension| matches!(d, Dimension::Free(_) | Dimension::Fixed(1));
    let fits = matches!(port.shape.as_deref(), Some([first, last]) if rows(first) && *last == two);
    port.name == TARGET_SIZE && fits
}

/// Whether a port takes images, and their size if declared.
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

/// An output of zeros; a free first size is a batch of one image, or a table without rows. Output sizes have been checked before.
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
    Some(Tensor {
        name: port.name.clone(),
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
            // Zero denotes a free size.
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
    fn models_are_recognised_by_inputs_and_outputs() {
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
                [0, 3, 416, 416],
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
            (square, vec![&[1, 300, 80], &[1, 300, 4]], (Head::Detr, 0)),
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
    fn unknown_models_are_not_recognised() {
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
            // Classifiers of six and seven classes.
            (&[1, 3, 224, 224], &[&[1, 6]]),
            (&[1, 3, 224, 224], &[&[1, 7]]),
        ] {
            assert_eq!(known(input, outputs), None, "{input:?} {outputs:?}");
        }
        let mut batches = interface(&[0, 3, 224, 224], &[&[0, 6]]);
        assert!(ModelCard::known(&batches).is_some());
        for port in batches.inputs.iter_mut().chain(&mut batches.outputs) {
            port.shape.as_mut().unwrap()[0] = Dimension::Free("batch".to_owned());
        }
        assert_eq!(ModelCard::known(&batches), None);
    }

    /// The shapes do not determine the anchors.
    #[test]
    fn raw_maps_are_reported_but_not_recognised() {
        let size = Size {
            width: 416,
            height: 320,
        };
        let maps: [&[&[u64]]; 3] = [
            &[&[1, 255, 40, 52], &[1, 255, 20, 26], &[1, 255, 10, 13]],
            &[&[1, 21, 10, 13], &[1, 21, 20, 26], &[1, 21, 40, 52]],
            &[
                &[1, 3, 40, 52, 85],
                &[1, 3, 20, 26, 85],
                &[1, 3, 10, 13, 85],
            ],
        ];
        let blank = |outputs: &[&[u64]]| -> Vec<Tensor> {
            let interface = interface(&[1, 3, 320, 416], outputs);
            interface.outputs.iter().filter_map(super::blank).collect()
        };
        for outputs in maps {
            assert_eq!(known(&[1, 3, 320, 416], outputs), None, "{outputs:?}");
            assert!(are_raw_maps(size, &blank(outputs)), "{outputs:?}");
        }
        for outputs in [
            &[][..],
            &[&[1, 255, 40, 52][..]],
            &[&[1, 256, 40, 52], &[1, 256, 20, 26], &[1, 256, 10, 13]],
            &[&[1, 15, 40, 52], &[1, 15, 20, 26], &[1, 15, 10, 13]],
        ] {
            assert!(!are_raw_maps(size, &blank(outputs)), "{outputs:?}");
        }
    }

    /// Each would take a quarter of a gigabyte.
    #[test]
    fn huge_total_outputs_are_not_allocated() {
        let outputs = vec![&[1_u64, 8192, 8192][..]; 12];
        let huge = interface(&[1, 3, 416, 416], &outputs);
        assert_eq!(declared_numbers(&huge), None);
        assert_eq!(ModelCard::known(&huge), None);
        let one = interface(&[1, 3, 416, 416], &outputs[..1]);
        assert_eq!(declared_numbers(&one), Some(1 << 26));
        let many = vec![&[1_u64, 3549, 85][..]; 13];
        assert_eq!(known(&[1, 3, 416, 416], &many), None);
    }
}
