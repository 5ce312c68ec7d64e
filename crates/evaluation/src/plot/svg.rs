//! Figures as SVG.

use super::canvas::{Anchor, Figure, Shape};
use super::colour::{Colour, INK, WHITE};
use super::font::TYPEFACE;
use base64::Engine;
use base64::engine::general_purpose::STANDARD;
use std::fmt::Write;

pub(super) fn write(figure: &Figure) -> String {
    let (w, h) = (figure.width, figure.height);
    let (paper, ink, font) = (hex(WHITE), hex(INK), STANDARD.encode(TYPEFACE));
    let mut svg = format!(
        "<svg xmlns=\"http://www.w3.org/2000/svg\" width=\"{w}\" height=\"{h}\" viewBox=\"0 0 {w} {h}\" font-family=\"Roboto, sans-serif\" fill=\"{ink}\">\n\
         <style>@font-face {{ font-family: Roboto; src: url(data:font/ttf;base64,{font}); }}</style>\n\
         <rect width=\"{w}\" height=\"{h}\" fill=\"{paper}\"/>\n"
    );
    for shape in &figure.shapes {
        svg += &element(shape);
        svg.push('\n');
    }
    svg + "</svg>\n"
}

fn hex(c: Colour) -> String {
    format!("#{:02x}{:02x}{:02x}", c.0, c.1, c.2)
}

fn escape(text: &str) -> String {
    text.chars()
        .filter(|c| !c.is_control())
        .map(|c| match c {
            '&' => "&amp;".to_owned(),
            '<' => "&lt;".to_owned(),
            '>' => "&gt;".to_owned(),
            c => c.to_string(),
        })
        .collect()
}

fn element(shape: &Shape) -> String {
    match shape {
        Shape::Line {
            points,
            colour,
            width,
            dashed,
        } => {
            let mut list = String::with_capacity(points.len() * 14);
            for [x, y] in points {
                // Writing to a String cannot fail.
                let _ = write!(list, "{x:.2},{y:.2} ");
            }
            let dash = if *dashed {
                " stroke-dasharray=\"5 4\""
            } else {
                ""
            };
            format!(
                "<polyline points=\"{}\" fill=\"none\" stroke=\"{}\" stroke-width=\"{width}\" stroke-linejoin=\"round\" stroke-linecap=\"round\"{dash}/>",
                list.trim_end(),
                hex(*colour)
            )
        }
        Shape::Rect {
            at: [x, y, w, h],
            fill,
        } => format!(
            "<rect x=\"{x:.2}\" y=\"{y:.2}\" width=\"{w:.2}\" height=\"{h:.2}\" fill=\"{}\"/>",
            hex(*fill)
        ),
        Shape::Circle {
            centre: [x, y],
            radius,
            fill,
        } => format!(
            "<circle cx=\"{x:.2}\" cy=\"{y:.2}\" r=\"{radius}\" fill=\"{}\"/>",
            hex(*fill)
        ),
        Shape::Text {
            at: [x, y],
            text,
            size,
            anchor,
            upwards,
        } => {
            let anchor = match anchor {
                Anchor::Start => "start",
                Anchor::Middle => "middle",
                Anchor::End => "end",
            };
            let turn = if *upwards {
                format!(" transform=\"rotate(-90 {x:.2} {y:.2})\"")
            } else {
                String::new()
            };
            format!(
                "<text x=\"{x:.2}\" y=\"{y:.2}\" font-size=\"{size}\" text-anchor=\"{anchor}\"{turn}>{}</text>",
                escape(text)
            )
        }
    }
}
