//! Figures as PNG, drawn by `tiny-skia`.

use super::canvas::{Anchor, Figure, Shape};
use super::colour::{Colour, INK};
use super::font::{self, Step};
use tiny_skia::{
    Color, FillRule, LineCap, LineJoin, Paint, Path, PathBuilder, Pixmap, Rect, Stroke, StrokeDash,
    Transform,
};

/// Error: a picture could not be made.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
pub enum PlotError {
    /// The size of the figure is not a valid image size.
    #[error("expected a figure of 1 to 16000 px, found {0}")]
    Size(String),
    /// The encoder failed.
    #[error("expected to encode the plot as PNG, found: {0}")]
    Encode(String),
}

/// Image pixels per figure pixel.
const SCALE: f64 = 2.0;

pub(super) fn write(figure: &Figure) -> Result<Vec<u8>, PlotError> {
    let (w, h) = (figure.width * SCALE, figure.height * SCALE);
    let size = || PlotError::Size(format!("{w} x {h}"));
    if !(1.0..=16_000.0).contains(&w) || !(1.0..=16_000.0).contains(&h) {
        return Err(size());
    }
    let mut image = Pixmap::new(w as u32, h as u32).ok_or_else(size)?;
    image.fill(Color::WHITE);
    for shape in &figure.shapes {
        draw(&mut image, shape);
    }
    image
        .encode_png()
        .map_err(|e| PlotError::Encode(e.to_string()))
}

fn paint(c: Colour) -> Paint<'static> {
    let mut paint = Paint::default();
    paint.set_color_rgba8(c.0, c.1, c.2, 255);
    paint.anti_alias = true;
    paint
}

fn stroke(width: f64) -> Stroke {
    Stroke {
        width: width as f32,
        line_cap: LineCap::Round,
        line_join: LineJoin::Round,
        ..Stroke::default()
    }
}

/// Draws one shape; empty or non-finite ones are skipped.
fn draw(image: &mut Pixmap, shape: &Shape) {
    let scale = Transform::from_scale(SCALE as f32, SCALE as f32);
    match shape {
        Shape::Line {
            points,
            colour,
            width,
            dashed,
        } => {
            let Some(path) = polyline(points) else { return };
            let mut stroke = stroke(*width);
            if *dashed {
                stroke.dash = StrokeDash::new(vec![5.0, 4.0], 0.0);
            }
            image.stroke_path(&path, &paint(*colour), &stroke, scale, None);
        }
        Shape::Rect {
            at: [x, y, w, h],
            fill,
        } => {
            if let Some(r) = Rect::from_xywh(*x as f32, *y as f32, *w as f32, *h as f32) {
                image.fill_rect(r, &paint(*fill), scale, None);
            }
        }
        Shape::Circle {
            centre: [x, y],
            radius,
            fill,
        } => {
            if let Some(path) = PathBuilder::from_circle(*x as f32, *y as f32, *radius as f32) {
                image.fill_path(&path, &paint(*fill), FillRule::Winding, scale, None);
            }
        }
        Shape::Text {
            at: [x, y],
            text,
            size,
            anchor,
            upwards,
        } => {
            let back = match anchor {
                Anchor::Start => 0.0,
                Anchor::Middle => 0.5,
                Anchor::End => 1.0,
            } * font::width(text, *size);
            let Some(path) = text_path(text, *size) else {
                return;
            };
            let turn = if *upwards { -90.0 } else { 0.0 };
            let transform = Transform::from_translate(-back as f32, 0.0)
                .post_concat(Transform::from_rotate(turn))
                .post_translate(*x as f32, *y as f32)
                .post_concat(scale);
            image.fill_path(&path, &paint(INK), FillRule::Winding, transform, None);
        }
    }
}

fn polyline(points: &[[f64; 2]]) -> Option<Path> {
    let mut path = PathBuilder::new();
    let (first, rest) = points.split_first()?;
    path.move_to(first[0] as f32, first[1] as f32);
    for p in rest {
        path.line_to(p[0] as f32, p[1] as f32);
    }
    path.finish()
}

fn text_path(text: &str, size: f64) -> Option<Path> {
    let mut path = PathBuilder::new();
    let at = |p: [f64; 2]| (p[0] as f32, p[1] as f32);
    font::outlines(text, size, &mut |step| match step {
        Step::Move(p) => path.move_to(at(p).0, at(p).1),
        Step::Line(p) => path.line_to(at(p).0, at(p).1),
        Step::Quad(c, p) => path.quad_to(at(c).0, at(c).1, at(p).0, at(p).1),
        Step::Cubic(c, d, p) => {
            path.cubic_to(at(c).0, at(c).1, at(d).0, at(d).1, at(p).0, at(p).1);
        }
    });
    path.finish()
}
