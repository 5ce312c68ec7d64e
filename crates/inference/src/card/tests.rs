//! Valid and invalid cards.

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
fn omitted_settings_default_to_the_head() {
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
fn cards_round_trip() {
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
fn documentation_example_is_a_valid_card() {
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
fn all_problems_are_reported_with_their_keys() {
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
    let columns =
        "head = \"end-to-end\"\n[output]\ncolumns = [\"x0\", \"y0\", \"x1\", \"y1\", \"class\"]";
    assert!(problems(columns)[0].starts_with("output.columns: "));
    // Values that the head does not use.
    let sigmoid = "head = \"end-to-end\"\n[output]\nsigmoid = false";
    assert!(problems(sigmoid)[0].starts_with("output.sigmoid: expected none"));
    let centre = "head = \"yolo-grid\"\n[output]\ncentre = 0";
    assert!(problems(centre)[0].starts_with("output.centre: expected none"));
    let centre = "head = \"distribution\"\n[output]\ncentre = 2";
    assert!(problems(centre)[0].starts_with("output.centre: expected a share"));
    assert!(problems("head = \"yolox\"\nclasses = \"voc\"")[0].contains("found \"voc\""));
    let strides = "head = \"yolox\"\n[output]\nstrides = []";
    assert!(problems(strides)[0].starts_with("output.strides: "));
}

#[test]
fn unknown_words_and_keys_are_refused_with_their_line() {
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
            "line 2: expected \"coco\", \"coco-91\" or a list of names",
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
fn card_maps_numbers_to_classes() {
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

proptest::proptest! {
    /// Any text gives a valid card, or an error with its name, and with the line where it is not TOML.
    #[test]
    fn damaged_cards_are_valid_or_give_located_errors(
        head in 0..Head::ALL.len(), at in proptest::prelude::any::<proptest::sample::Index>(), cut in 0..12_usize,
        with in proptest::prop_oneof!["[-0-9.ea-z_=\"\\[\\], \n]{0,8}", "\\PC{0,4}"]
    ) {
        let mut text = ModelCard::new(Head::ALL[head]).to_toml();
        let at = at.index(text.len());
        text.replace_range(at..(at + cut).min(text.len()), &with);
        match ModelCard::parse("m.toml", &text) {
            Ok(card) => proptest::prop_assert!(card.problems().is_empty()),
            Err(e) => {
                let message = e.to_string();
                proptest::prop_assert!(message.starts_with("m.toml: "), "{message}");
                if let CardError::Syntax { reason, .. } = e {
                    proptest::prop_assert!(reason.starts_with("line ") || reason.contains("missing field"), "{message}");
                }
            }
        }
    }
}
