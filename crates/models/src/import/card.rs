//! The network's model card: that of YOLOv7 with the checkpoint's own anchors, strides and classes.

use super::error::{ImportError, Result, shown};
use super::head::Head;
use super::modules::{Module, Source};
use stillpoint_detection::ClassId;
use stillpoint_inference::{Classes, Head as CardHead, ModelCard};

/// Input size of the training, px; rounded up to a multiple of the coarsest stride.
const TRAINED_SIZE: usize = 640;
/// Maximum length of a class name, characters.
const LONGEST_NAME: usize = 200;

/// Names of the classes by number: the network's attribute `names`, a list or a dictionary by number.
pub(super) fn names(
    source: Source<'_, '_>,
    model: &Module<'_, '_>,
    head: &Head,
) -> Result<Vec<String>> {
    let arena = source.arena;
    let id = model.attribute("names");
    let id = id.ok_or_else(|| model.fault("the classes as `names`", "none"))?;
    let ids = match (arena.sequence(id), arena.entries(id)) {
        (Some(list), _) => list.to_vec(),
        (None, Some(entries)) => {
            let ordered = entries.iter().zip(0..);
            let in_order =
                ordered.map(|((key, name), i)| (arena.integer(*key) == Some(i)).then_some(*name));
            let all: Option<Vec<_>> = in_order.collect();
            all.ok_or_else(|| model.fault("`names` by number from 0 up", "other keys"))?
        }
        _ => return Err(model.fault("a list as `names`", arena.get(id).describe())),
    };
    if ids.len() != head.classes {
        return Err(model.fault(
            format!("{} names, as many as the head has classes", head.classes),
            ids.len().to_string(),
        ));
    }
    let names = ids.into_iter().map(|id| match arena.text(id) {
        Some(name) if name.len() <= LONGEST_NAME => Ok(shown(name)),
        _ => Err(model.fault("a short text as each name", arena.get(id).describe())),
    });
    names.collect()
}

/// The card for a head and its class names.
///
/// # Errors
/// Violations of the card's own rules, such as no known class.
pub(super) fn card(head: &Head, names: &[String]) -> Result<ModelCard> {
    let mut card = ModelCard::new(CardHead::YoloAnchors);
    let coarsest = head.outputs.last().map_or(1, |o| o.stride);
    let side = TRAINED_SIZE.next_multiple_of(coarsest);
    card.input.size = Some([side, side]);
    card.output.strides = head.outputs.iter().map(|o| o.stride).collect();
    let anchors = head.outputs.iter();
    card.output.anchors = anchors.map(|o| o.anchors.as_flattened().to_vec()).collect();
    card.classes = classes(names);
    match card.problems() {
        problems if problems.is_empty() => Ok(card),
        problems => Err(ImportError::Card { problems }),
    }
}

fn classes(names: &[String]) -> Classes {
    let listed: Vec<Option<ClassId>> = names.iter().map(|n| ClassId::from_name(n)).collect();
    let coco = (0..ClassId::COUNT).map(|i| Some(ClassId(i as u8)));
    if listed.iter().copied().eq(coco) {
        return Classes::Coco;
    }
    Classes::Listed(listed)
}
