//! The lines under both halves of an image.

use super::compose::{Film, GAP, Plot, TEXT};
use crate::draw::draw_mark;
use crate::overlay::Mark;
use crate::text::Text;
use crate::{Colour, Picture, shapes};

#[derive(Clone)]
pub(super) struct Entry {
    sign: Sign,
    words: String,
}

#[derive(Clone, Copy)]
enum Sign {
    Mark(Mark),
    Region,
    Line(Colour, f32),
    Nothing,
}

/// The legend lines: on the left the marks, on the right the trajectories, as many per line as fit.
pub(super) fn legend(plot: &Plot<'_>) -> Vec<Vec<Entry>> {
    let text = Text::of(TEXT);
    let entry = |sign, words: &str| Entry {
        sign,
        words: words.to_owned(),
    };
    let mut left = vec![
        entry(Sign::Mark(Mark::Static), "used"),
        entry(Sign::Mark(Mark::Dynamic(Colour::SEMANTIC)), "rejected"),
        entry(Sign::Region, "moves"),
    ];
    if plot.speed > 1.5 {
        left.push(entry(
            Sign::Nothing,
            &format!("{:.0}\u{d7} speed", plot.speed),
        ));
    }
    let head = (!plot.measure.is_empty()).then(|| entry(Sign::Nothing, plot.measure));
    let tracks = plot.tracks.iter().rev();
    let right: Vec<Entry> = head
        .into_iter()
        .chain(tracks.map(|t| {
            let words = format!("{} {}", t.name, t.note);
            let words = text.cut(words.trim_end(), Film::VIEW - 3 * text.space(1.0));
            entry(Sign::Line(t.colour, t.width()), &words)
        }))
        .collect();
    let mut lines = vec![Vec::new()];
    let mut x = 0;
    for next in right {
        let wide = next.width(text);
        if x > 0 && x + wide > Film::VIEW {
            lines.push(Vec::new());
            x = 0;
        }
        x += wide;
        if let Some(line) = lines.last_mut() {
            line.push(next);
        }
    }
    // The left half's entries begin the first line.
    let first = &mut lines[0];
    left.push(entry(Sign::Nothing, ""));
    left.append(first);
    *first = left;
    for line in lines.iter_mut().skip(1) {
        line.insert(0, entry(Sign::Nothing, ""));
    }
    lines
}

impl Entry {
    /// Width of the sign, px.
    fn room(&self, text: Text) -> usize {
        match self.sign {
            Sign::Mark(_) | Sign::Region => text.space(1.15),
            Sign::Line(..) => text.space(1.9),
            Sign::Nothing => 0,
        }
    }

    fn width(&self, text: Text) -> usize {
        self.room(text) + text.width(&self.words) + text.space(0.8)
    }

    pub(super) fn is_break(&self) -> bool {
        self.words.is_empty()
    }
}

pub(super) fn draw_line(picture: &mut Picture, y: usize, text: Text, entries: &[Entry]) {
    let mut x = text.space(0.5);
    for entry in entries {
        if entry.is_break() {
            x = Film::VIEW + GAP + text.space(0.5);
            continue;
        }
        let room = entry.room(text);
        let (u, v) = (
            x as f32 + 0.4 * room as f32,
            y as f32 + 0.5 * (text.line() - 1) as f32,
        );
        match entry.sign {
            Sign::Mark(mark) => draw_mark(picture, (u, v), mark, 1.1),
            Sign::Region => {
                let half = 0.36 * TEXT;
                let corner = |sign: f32| ((u + sign * half) as i64, (v + sign * half) as i64);
                shapes::plate(picture, corner(-1.0), corner(1.0), Colour::REGION);
            }
            Sign::Line(colour, width) => {
                let half = 0.36 * room as f32;
                shapes::segment(picture, (u - half, v), (u + half, v), (width, 1.0), colour);
            }
            Sign::Nothing => {}
        }
        let at = ((x + room) as i64, y as i64);
        text.write(picture, at, &entry.words, Colour::WHITE);
        x += entry.width(text);
    }
}
