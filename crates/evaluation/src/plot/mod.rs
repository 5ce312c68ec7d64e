//! Plots of trajectories, errors and times, as SVG and PNG.
//!
//! Each figure is a list of shapes that two small writers draw; text uses the project's own typeface, which is embedded in SVG, so no
//! system fonts are needed.

mod axes;
mod canvas;
mod colour;
mod comparison;
mod font;
mod legend;
mod panels;
mod png;
mod svg;
mod timing;
mod trajectory;

pub use canvas::Figure;
pub use colour::{Colour, ESTIMATE, INK, REFERENCE};
pub use comparison::{Compared, comparison_figure};
pub use font::TYPEFACE;
pub use png::PlotError;
pub use timing::{Series, timing_figure};
pub use trajectory::{drift_figure, poses_figure, trajectory_figure};
