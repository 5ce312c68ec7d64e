//! A figure: a list of shapes in pixels, origin at the top left, y down.

use super::colour::{Colour, ESTIMATE, FRAME};

/// Position of a text relative to its point.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub(super) enum Anchor {
    Start,
    Middle,
    End,
}

#[derive(Clone, Debug)]
pub(super) enum Shape {
    /// Open line through points, round joins.
    Line {
        points: Vec<[f64; 2]>,
        colour: Colour,
        width: f64,
        dashed: bool,
    },
    /// Filled rectangle: left, top, width, height.
    Rect { at: [f64; 4], fill: Colour },
    Circle {
        centre: [f64; 2],
        radius: f64,
        fill: Colour,
    },
    /// Text on its baseline; `upwards` rotates it by 90 degrees to the left about its point.
    Text {
        at: [f64; 2],
        text: String,
        size: f64,
        anchor: Anchor,
        upwards: bool,
    },
}

/// A picture, to be written as SVG or PNG.
#[derive(Clone, Debug)]
pub struct Figure {
    pub(super) width: f64,
    pub(super) height: f64,
    pub(super) shapes: Vec<Shape>,
}

impl Figure {
    /// A figure on white ground, with only the product's mark and name in its corner.
    pub(super) fn new(width: f64, height: f64) -> Self {
        let mut figure = Self {
            width,
            height,
            shapes: Vec::new(),
        };
        figure.mark([width - 109.0, height - 15.0]);
        figure.text(
            [width - 98.0, height - 10.5],
            "Stillpoint",
            13.0,
            Anchor::Start,
        );
        figure
    }

    /// The logo: three arcs around a fixed point.
    fn mark(&mut self, [x, y]: [f64; 2]) {
        /// Points of an arc, and its fraction of a third of the circle, both chosen by eye.
        const POINTS: usize = 12;
        const SHARE: f64 = 0.65;
        let third = std::f64::consts::TAU / 3.0;
        for arc in 0..3 {
            let at = |k: usize| {
                let turn = third * (f64::from(arc) + SHARE * k as f64 / POINTS as f64);
                [x + 6.5 * libm::cos(turn), y + 6.5 * libm::sin(turn)]
            };
            self.line((0..=POINTS).map(at).collect(), FRAME, 1.5);
        }
        self.circle([x, y], 2.5, ESTIMATE);
    }

    /// Width and height, px (PNG has twice as many).
    #[must_use]
    pub fn size(&self) -> (f64, f64) {
        (self.width, self.height)
    }

    /// The figure as an SVG document.
    #[must_use]
    pub fn to_svg(&self) -> String {
        super::svg::write(self)
    }

    /// The figure as a PNG file, at two image pixels per figure pixel.
    ///
    /// # Errors
    /// [`super::PlotError`] if the image cannot be made or encoded.
    pub fn to_png(&self) -> Result<Vec<u8>, super::PlotError> {
        super::png::write(self)
    }

    pub(super) fn line(&mut self, points: Vec<[f64; 2]>, colour: Colour, width: f64) {
        self.push_line(points, colour, width, false);
    }

    pub(super) fn dashed(&mut self, points: Vec<[f64; 2]>, colour: Colour, width: f64) {
        self.push_line(points, colour, width, true);
    }

    fn push_line(&mut self, points: Vec<[f64; 2]>, colour: Colour, width: f64, dashed: bool) {
        if points.len() > 1 {
            self.shapes.push(Shape::Line {
                points,
                colour,
                width,
                dashed,
            });
        }
    }

    pub(super) fn rect(&mut self, at: [f64; 4], fill: Colour) {
        self.shapes.push(Shape::Rect { at, fill });
    }

    pub(super) fn circle(&mut self, centre: [f64; 2], radius: f64, fill: Colour) {
        self.shapes.push(Shape::Circle {
            centre,
            radius,
            fill,
        });
    }

    pub(super) fn text(&mut self, at: [f64; 2], text: &str, size: f64, anchor: Anchor) {
        self.push_text(at, text, (size, anchor), false);
    }

    pub(super) fn text_upwards(&mut self, at: [f64; 2], text: &str, size: f64) {
        self.push_text(at, text, (size, Anchor::Middle), true);
    }

    fn push_text(
        &mut self,
        at: [f64; 2],
        text: &str,
        (size, anchor): (f64, Anchor),
        upwards: bool,
    ) {
        self.shapes.push(Shape::Text {
            at,
            text: text.to_owned(),
            size,
            anchor,
            upwards,
        });
    }
}
