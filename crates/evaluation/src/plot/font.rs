//! A small stroke font, drawn for this project: printable ASCII and a few signs.
//!
//! A glyph is a width and its strokes, which blanks separate. A stroke is a list of points of two characters each, x then
//! y, in base 36; `~` makes the next point the control point of a quadratic curve to the one behind it. The
//! baseline is at y = 3, small letters reach 9, capitals `b` (11), descenders 0.

/// One step of a pen, in px relative to the start of the text's baseline, y down.
#[derive(Clone, Copy, Debug, PartialEq)]
pub(super) enum Step {
    Move([f64; 2]),
    Line([f64; 2]),
    Curve([f64; 2], [f64; 2]),
}

/// Height of capitals over the font size.
const CAPITAL: f64 = 0.72;
/// Width of one unit over its height: letters are narrower than their grid.
const NARROW: f64 = 0.78;
/// Space between glyphs, units.
const GAP: f64 = 2.6;
/// Width of a blank, units.
const BLANK: f64 = 2.4;

#[rustfmt::skip]
const GLYPHS: &[(char, u8, &str)] = &[
    ('0', 6, "07~0b3b~6b67~6333~0307"), ('1', 6, "193b33 1353"), ('2', 6, "09~0b3b~6b69~670363"),
    ('3', 6, "0a~1b3b~6b69~6737 37~6765~6333~1304"), ('4', 6, "43 4b0565 4b43"), ('5', 6, "5b0b07~1838~6866~6333~1304"),
    ('6', 6, "5a~4b3b~0b06~0333~6366~6838~0806"), ('7', 6, "0b6b23"),
    ('8', 6, "37~0709~0b3b~6b69~6737~0705~0333~6365~6737"), ('9', 6, "14~2333~6368~6b3b~0b09~0636~6668"),
    ('a', 6, "66~6939~0906~0333~6366 6963"), ('b', 6, "0b03 06~0939~6966~6333~0306"), ('c', 5, "58~4939~0906~0333~4354"),
    ('d', 6, "6b63 66~6939~0906~0333~6366"), ('e', 6, "0666~6939~0906~0333~5364"), ('f', 4, "4b~1b1813 0939"),
    ('g', 6, "66~6939~0906~0333~6366 6962~6030~2011"), ('h', 6, "0b03 06~0939~696663"), ('i', 0, "0903 0b0c"),
    ('j', 2, "2922~2000 2b2c"), ('k', 5, "0b03 5905 2753"), ('l', 0, "0b03"), ('m', 8, "0903 07~0929~494743 47~4969~898783"),
    ('n', 6, "0903 06~0939~696663"), ('o', 6, "06~0939~6966~6333~0306"), ('p', 6, "0900 06~0939~6966~6333~0306"),
    ('q', 6, "6960 66~6939~0906~0333~6366"), ('r', 4, "0903 06~0939~4948"), ('s', 5, "58~4929~0908~0626~5654~5333~1304"),
    ('t', 4, "1b15~1333~3343 0939"), ('u', 6, "0906~0333~6366 6963"), ('v', 6, "093369"), ('w', 8, "0923486389"),
    ('x', 5, "0953 5903"), ('y', 6, "0933 6920"), ('z', 5, "09590353"),
    ('A', 8, "034b83 2666"), ('B', 6, "0b03 0b3b~6b69~673707 37~6765~633303"), ('C', 7, "79~6b4b~0b07~0343~6375"),
    ('D', 7, "0b03 0b3b~7b77~733303"), ('E', 5, "5b0b0353 0747"), ('F', 5, "5b0b03 0747"), ('G', 7, "79~6b4b~0b07~0343~737747"),
    ('H', 6, "0b03 6b63 0767"), ('I', 0, "0b03"), ('J', 4, "4b46~4323~0305"), ('K', 6, "0b03 6b06 2863"), ('L', 5, "0b0353"),
    ('M', 8, "030b458b83"), ('N', 6, "030b636b"), ('O', 8, "07~0b4b~8b87~8343~0307"), ('P', 6, "0b03 0b3b~6b69~673707"),
    ('Q', 8, "07~0b4b~8b87~8343~0307 5583"), ('R', 6, "0b03 0b3b~6b69~673707 3763"), ('S', 6, "69~5b3b~0b09~0737~6765~6333~1305"),
    ('T', 6, "0b6b 3b33"), ('U', 6, "0b06~0333~63666b"), ('V', 6, "0b336b"), ('W', 8, "0b234a638b"), ('X', 6, "0b63 6b03"),
    ('Y', 6, "0b376b 3733"), ('Z', 6, "0b6b0363"),
    ('.', 0, "0304"), (',', 1, "1402"), (':', 0, "0304 0809"), (';', 1, "1402 1819"), ('-', 4, "0646"), ('+', 6, "0666 3933"),
    ('=', 6, "0565 0868"), ('(', 2, "2c~0a07~0422"), (')', 2, "0c~2a27~2402"), ('[', 2, "2c0c0222"), (']', 2, "0c2c2202"),
    ('/', 5, "025c"), ('%', 8, "7b13 0a~0b1b~2b2a~2919~090a 64~6575~8584~8373~6364"), ('_', 6, "0262"), ('\'', 0, "0b09"),
    ('"', 2, "0b09 2b29"), ('<', 5, "590653"), ('>', 5, "095603"), ('#', 6, "2b13 5b43 0868 0565"), ('*', 4, "2b27 0a48 4a08"),
    ('&', 7, "73190a~0b2b~4b4a~4805~0323~6377"), ('°', 2, "0a~0b1b~2b2a~2919~090a"), ('µ', 6, "0900 06~0333~6366 6963"),
    ('×', 5, "0458 5408"), ('–', 6, "0666"), ('|', 0, "0c01"), ('!', 0, "0b06 0304"), ('?', 5, "09~0b2b~5b59~572726 2324"),
    ('~', 6, "06~0828~4666"), ('^', 4, "092b49"), ('@', 8, "66~6848~2826~2444~6466 6664~8486~8b4b~0b07~0343~6374"), ('\\', 5, "0c52"),
    ('{', 3, "3c~1c18~1707~1716~1232"), ('}', 3, "0c~2c28~2737~2726~2202"), ('$', 6, "69~5a3a~0a09~0737~6765~6434~1405 3b33"),
    ('`', 2, "0b29"),
];

/// What stands for a sign that the font lacks: an empty box.
const MISSING: (u8, &str) = (6, "030b6b6303");

fn glyph(c: char) -> (u8, &'static str) {
    GLYPHS
        .iter()
        .find(|g| g.0 == c)
        .map_or(MISSING, |g| (g.1, g.2))
}

/// Px per unit, across and down.
fn unit(size: f64) -> (f64, f64) {
    let v = size * CAPITAL / 8.0;
    (v * NARROW, v)
}

/// Width of a text, px.
pub(super) fn width(text: &str, size: f64) -> f64 {
    let units: f64 = text.chars().map(advance).sum();
    (units - GAP).max(0.0) * unit(size).0
}

fn advance(c: char) -> f64 {
    if c == ' ' {
        BLANK + GAP
    } else {
        f64::from(glyph(c).0) + GAP
    }
}

/// The steps of the pen that write a text of one line.
pub(super) fn strokes(text: &str, size: f64, step: &mut impl FnMut(Step)) {
    let (ux, uy) = unit(size);
    let mut left = 0.0;
    for c in text.chars() {
        if c != ' ' {
            for stroke in glyph(c).1.split(' ') {
                one_stroke(
                    stroke,
                    |[x, y]| [(left + x) * ux, -(y - 3.0) * uy],
                    &mut *step,
                );
            }
        }
        left += advance(c);
    }
}

fn one_stroke(stroke: &str, place: impl Fn([f64; 2]) -> [f64; 2], step: &mut impl FnMut(Step)) {
    let value = |c: Option<char>| f64::from(c.and_then(|c| c.to_digit(36)).unwrap_or(0));
    let mut chars = stroke.chars().peekable();
    let mut first = true;
    while let Some(&c) = chars.peek() {
        let curve = c == '~';
        if curve {
            chars.next();
        }
        let mut point = || {
            let x = value(chars.next());
            place([x, value(chars.next())])
        };
        let p = point();
        step(match (first, curve) {
            (true, _) => Step::Move(p),
            (false, false) => Step::Line(p),
            (false, true) => Step::Curve(p, point()),
        });
        first = false;
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_glyph_is_well_formed_and_within_its_box() {
        for &(c, w, strokes) in GLYPHS {
            for s in strokes.split(' ') {
                let digits: Vec<u32> = s
                    .chars()
                    .filter(|c| *c != '~')
                    .map(|c| c.to_digit(36).unwrap())
                    .collect();
                assert_eq!(digits.len() % 2, 0, "{c}");
                for p in digits.chunks(2) {
                    assert!(p[0] <= u32::from(w) && p[1] <= 12, "{c}: {p:?}");
                }
                // A control point is always followed by its end point.
                let parts: Vec<&str> = s.split('~').collect();
                assert!(
                    parts[0].len() >= 2 && parts[1..].iter().all(|p| p.len() >= 4),
                    "{c}"
                );
            }
        }
    }

    #[test]
    fn all_of_ascii_is_there() {
        for c in '!'..='~' {
            assert!(GLYPHS.iter().any(|g| g.0 == c), "{c}");
        }
        assert!(width("aa", 10.0) > width("a", 10.0));
    }
}
