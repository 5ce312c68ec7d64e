//! Pictures of trajectories, errors and times, as SVG and PNG.
//!
//! Answers: what an evaluation looks like. Each figure is a list of shapes that two small writers draw; text is text in
//! SVG, and strokes of a built-in font in PNG, so that no system fonts are needed.

mod axes;
mod canvas;
mod colour;
mod comparison;
mod font;
mod legend;
mod png;
mod svg;
mod timing;
mod trajectory;

pub use canvas::Figure;
pub use comparison::{Compared, comparison_figure};
pub use png::PlotError;
pub use timing::{Series, timing_figure};
pub use trajectory::{drift_figure, poses_figure, trajectory_figure};
