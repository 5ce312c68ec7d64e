//! Colours and typeface of the page, shared with the images.

use crate::Colour;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;
use stillpoint_evaluation::plot;

/// A colour's name, and its value on light and on dark background. Names state the meaning; blue, vermilion and green are distinguishable
/// with red-green colour blindness (Okabe and Ito, 2008), and are used in plots too.
type Ink = (&'static str, [Colour; 2]);

const fn both(light: u32, dark: u32) -> [Colour; 2] {
    [of(light), of(dark)]
}

const fn of(rgb: u32) -> Colour {
    Colour((rgb >> 16) as u8, (rgb >> 8) as u8, rgb as u8)
}

const fn plotted(plot::Colour(r, g, b): plot::Colour) -> Colour {
    Colour(r, g, b)
}

const PAPER: Ink = ("paper", both(0xff_ffff, 0x14_171b));
const PANEL: Ink = ("panel", both(0xf3_f5f8, 0x1d_2126));
const SCENE: Ink = ("scene", both(0xf3_f5f8, 0x0d_0f12));
/// Bars behind text.
const TINT: Ink = ("tint", both(0xcf_e4f2, 0x1f_3f57));
const TINT_DEEP: Ink = ("tint-deep", both(0xa9_d0e8, 0x2a_5678));
const LINE: Ink = ("line", both(0xc9_ced6, 0x3a_414b));
const INK: Ink = ("ink", [plotted(plot::INK), of(0xe8_eaed)]);
const MUTED: Ink = ("muted", both(0x52_5966, 0xa9_b0bb));
/// Estimates.
const ACCENT: Ink = ("accent", [plotted(plot::ESTIMATE), of(0x7c_c4f2)]);
/// Ground truth: wide, below the estimates.
const TRUTH: Ink = ("truth", [plotted(plot::REFERENCE), of(0xc6_ccd5)]);
const BAD: Ink = ("bad", both(0xa8_3f00, 0xff_9a5c));
const GOOD: Ink = ("good", both(0x00_6b4c, 0x57_d3ab));
const WARM: Ink = ("warm", both(0x7d_5200, 0xf2_bf5e));

const INKS: [Ink; 13] = [
    PAPER, PANEL, SCENE, TINT, TINT_DEEP, LINE, INK, MUTED, ACCENT, TRUTH, BAD, GOOD, WARM,
];

/// Verdicts on features, in the order of [`Said`](super::Said).
const SAID: [Colour; 6] = [
    Colour::STATIC,
    Colour::SEMANTIC,
    Colour::RIGID,
    Colour::EPIPOLAR,
    Colour::DEPTH,
    Colour::HISTORY,
];

/// The style sheet: typeface, colours, and `rules` that use them.
pub(super) fn style(rules: &str) -> String {
    let font = STANDARD.encode(plot::TYPEFACE);
    let mut css = format!(
        "@font-face {{ font-family: Roboto; src: url(data:font/ttf;base64,{font}); font-weight: 1 1000; }}\n:root {{ color-scheme: light dark;"
    );
    put(&mut css, 0);
    for (i, colour) in SAID.iter().enumerate() {
        let _ = write!(css, " --said-{i}: {};", hex(*colour));
    }
    for (i, colour) in Colour::OBJECTS.iter().enumerate() {
        let _ = write!(css, " --object-{i}: {};", hex(*colour));
    }
    css += " }\n@media screen and (prefers-color-scheme: dark) { :root:not([data-paper]) {";
    put(&mut css, 1);
    css + " } }\n" + rules
}

/// Writes the colours of the light (0) or dark (1) theme as properties.
fn put(css: &mut String, which: usize) {
    for (name, colours) in INKS {
        // Writing to a String cannot fail.
        let _ = write!(css, " --{name}: {};", hex(colours[which]));
    }
}

fn hex(Colour(r, g, b): Colour) -> String {
    format!("#{r:02x}{g:02x}{b:02x}")
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Relative luminance (WCAG 2.1).
    fn light(Colour(r, g, b): Colour) -> f64 {
        let linear = |v: u8| {
            let v = f64::from(v) / 255.0;
            if v <= 0.040_45 {
                v / 12.92
            } else {
                ((v + 0.055) / 1.055).powf(2.4)
            }
        };
        0.2126 * linear(r) + 0.7152 * linear(g) + 0.0722 * linear(b)
    }

    fn contrast(a: Colour, b: Colour) -> f64 {
        let (a, b) = (light(a), light(b));
        (a.max(b) + 0.05) / (a.min(b) + 0.05)
    }

    #[test]
    fn contrast_matches_wcag() {
        assert!((contrast(Colour::BLACK, Colour::WHITE) - 21.0).abs() < 1e-9);
        assert!((contrast(of(0x77_7777), Colour::WHITE) - 4.48).abs() < 0.01);
    }

    #[test]
    fn text_and_lines_meet_wcag_aa_contrast() {
        for which in 0..2 {
            let hold = |(front, a): Ink, (back, b): Ink, least: f64| {
                let found = contrast(a[which], b[which]);
                assert!(
                    found >= least,
                    "{front} on {back} ({which}): {found:.2}, expected {least}"
                );
            };
            for ink in [INK, MUTED, ACCENT, BAD, GOOD, WARM] {
                for ground in [PAPER, PANEL] {
                    hold(ink, ground, 4.5);
                }
            }
            for ground in [TINT, TINT_DEEP] {
                hold(INK, ground, 4.5);
            }
            // Lines, meaningful borders, and marks.
            for ink in [TRUTH, ACCENT, BAD, GOOD, WARM] {
                for ground in [PAPER, PANEL, SCENE] {
                    hold(ink, ground, 3.0);
                }
            }
            // An estimate is visible on top of the ground truth.
            hold(ACCENT, TRUTH, 1.15);
        }
    }

    #[test]
    fn page_defines_every_colour_used_by_its_code() {
        let css = style("");
        let code = super::super::SCRIPTS.join("\n") + super::super::STYLE + super::super::REPORT;
        let code = code + &super::super::LIVE.join("\n");
        let mut asked = 0;
        for (before, after) in [("css(\"--", "\""), ("rgb(\"--", "\""), ("var(--", ")")] {
            for part in code.split(before).skip(1) {
                let name = part.split(after).next().unwrap();
                assert!(css.contains(&format!(" --{name}: #")), "{name}");
                asked += 1;
            }
        }
        assert!(asked > 40, "{asked}");
    }
}
