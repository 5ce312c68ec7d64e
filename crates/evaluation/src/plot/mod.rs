//! Pictures of trajectories, errors and times, as SVG and PNG.
//!
//! Answers: what an evaluation looks like. Each figure is a list of shapes that two small writers draw; text is text in
//! SVG, and strokes of a built-in font in PNG, so that no system fonts are needed.

mod axes;
mod canvas;
mod colour;
mod figures;
mod font;
mod png;
mod svg;

pub use canvas::Figure;
pub use figures::{Series, drift_figure, timing_figure, trajectory_figure};
pub use png::PlotError;
