//! Validates the values of a card.

use super::{CardInput, CardOutput, Classes, Column, Head, ModelCard};

/// All invalid values, each with its key, the expectation and the finding.
pub(super) fn problems(card: &ModelCard) -> Vec<String> {
    let mut problems = Vec::new();
    let mut expect = |holds: bool, key: &str, expected: &str, found: String| {
        if !holds {
            problems.push(format!("{key}: expected {expected}, found {found}"));
        }
    };
    if let Classes::Listed(list) = &card.classes {
        expect(
            list.iter().any(Option::is_some),
            "classes",
            "the name of a class at least",
            "none".to_owned(),
        );
        expect(
            list.len() <= 1000,
            "classes",
            "at most 1000 names",
            list.len().to_string(),
        );
    }
    input(&card.input, card.alignment(), &mut expect);
    output(card.head, &card.output, &mut expect);
    problems
}

/// Arguments: whether the value is valid, its key, the expectation, the finding.
type Expect<'a> = dyn FnMut(bool, &str, &str, String) + 'a;

fn input(input: &CardInput, alignment: usize, expect: &mut Expect<'_>) {
    if let Some(size) = input.size {
        let expected = match alignment {
            1 => format!("a width and a height from 1 to {LARGEST} px"),
            _ => {
                format!("a width and a height that are multiples of {alignment} up to {LARGEST} px")
            }
        };
        expect(
            size.iter().all(|&s| fits(s, alignment)),
            "input.size",
            &expected,
            format!("{size:?}"),
        );
    }
    expect(
        input.mean.iter().all(|m| m.is_finite()),
        "input.mean",
        "three numbers",
        format!("{:?}", input.mean),
    );
    expect(
        input.std.iter().all(|&s| s.is_finite() && s >= 1e-6),
        "input.std",
        "three numbers over 0",
        format!("{:?}", input.std),
    );
    expect(
        (0.0..=255.0).contains(&input.padding),
        "input.padding",
        "a value from 0 to 255",
        input.padding.to_string(),
    );
}

fn output(head: Head, output: &CardOutput, expect: &mut Expect<'_>) {
    let strides = &output.strides;
    let found = format!("{strides:?}");
    if matches!(head, Head::EndToEnd | Head::Detr) {
        expect(
            strides.is_empty(),
            "output.strides",
            "none, since the model decodes its boxes itself",
            found,
        );
    } else {
        let rising = strides.windows(2).all(|w| w[0] < w[1]);
        let sane = strides.iter().all(|s| s.is_power_of_two() && *s <= 128);
        expect(
            rising && sane && (1..=6).contains(&strides.len()),
            "output.strides",
            "one to six rising powers of two up to 128",
            found,
        );
    }
    // The usual value is harmless: cards with all values contain it.
    let usual = CardOutput::usual(head);
    let (sane, expected) = match head {
        Head::Distribution => (
            (0.0..=1.0).contains(&output.centre),
            "a share of a cell from 0 to 1".to_owned(),
        ),
        _ => (
            output.centre == usual.centre,
            format!("none, since {head} has its centres where they are"),
        ),
    };
    expect(sane, "output.centre", &expected, output.centre.to_string());
    expect(
        head != Head::EndToEnd || output.sigmoid == usual.sigmoid,
        "output.sigmoid",
        "none, since the model's scores are taken as they are",
        output.sigmoid.to_string(),
    );
    anchors(head, output, expect);
    columns(head, &output.columns, expect);
}

fn anchors(head: Head, output: &CardOutput, expect: &mut Expect<'_>) {
    let anchors = &output.anchors;
    if head != Head::YoloAnchors {
        let found = format!("{} lists", anchors.len());
        let expected = format!("none, since {head} has no anchors");
        expect(anchors.is_empty(), "output.anchors", &expected, found);
        return;
    }
    let per_stride = anchors.first().map_or(0, Vec::len);
    let sane = anchors.len() == output.strides.len()
        && per_stride >= 2
        && per_stride.is_multiple_of(2)
        && anchors.iter().all(|a| a.len() == per_stride)
        && anchors.iter().flatten().all(|&a| a.is_finite() && a > 0.0);
    let expected = "the model's own, px: a list of widths and heights in turn for each stride, all of the same length";
    expect(sane, "output.anchors", expected, format!("{anchors:?}"));
}

fn columns(head: Head, columns: &[Column], expect: &mut Expect<'_>) {
    let found = format!("{} columns", columns.len());
    if head != Head::EndToEnd {
        let expected = format!("none, since {head} has an order of its own");
        expect(columns.is_empty(), "output.columns", &expected, found);
        return;
    }
    use Column::{Batch, Class, Score, X0, X1, Y0, Y1};
    let count = |column: Column| columns.iter().filter(|&&c| c == column).count();
    let once = [X0, Y0, X1, Y1, Class, Score]
        .into_iter()
        .all(|c| count(c) == 1);
    expect(
        once && count(Batch) <= 1 && columns.len() <= 16,
        "output.columns",
        "x0, y0, x1, y1, class and score once each, and at most one batch",
        found,
    );
}

pub(in super::super) const LARGEST: usize = 4096;

/// Whether a side of an input is a multiple of the alignment and within the limit.
pub(in super::super) fn fits(side: usize, alignment: usize) -> bool {
    (1..=LARGEST).contains(&side) && side.is_multiple_of(alignment)
}
