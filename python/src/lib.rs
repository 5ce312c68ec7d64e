//! The extension module behind the Python package `stillpoint_slam`.
//!
//! Converts NumPy arrays to frames, and poses, maps and masks to arrays. The algorithms are in the library; the command line defines
//! configurations, detector names and map files. Exceptions name the invalid argument; long operations run without the interpreter's lock.

mod arguments;
mod arrays;
mod begin;
mod camera;
mod command;
mod config;
mod dense;
mod detections;
mod detector;
mod driver;
mod events;
mod frame;
mod guard;
mod images;
mod inertial;
mod live;
mod map;
mod mask;
mod objects;
mod odometry;
mod record;
mod result;
mod score;
mod sensors;
mod simulate;
mod slam;
mod source;
mod trajectory;

use pyo3::prelude::*;

/// The compiled part of `stillpoint_slam`.
#[pymodule]
fn _native(module: &Bound<'_, PyModule>) -> PyResult<()> {
    stillpoint_cli::front::keep_quiet();
    module.add("__version__", env!("CARGO_PKG_VERSION"))?;
    module.add_class::<camera::Camera>()?;
    module.add_class::<config::Config>()?;
    module.add_class::<dense::Dense>()?;
    module.add_class::<dense::Grid>()?;
    module.add_class::<dense::Mesh>()?;
    module.add_class::<detections::Detection>()?;
    module.add_class::<detector::Detector>()?;
    module.add_class::<events::Event>()?;
    module.add_class::<events::Events>()?;
    module.add_class::<frame::Frame>()?;
    module.add_class::<frame::Health>()?;
    module.add_class::<frame::Verdicts>()?;
    module.add_class::<map::Map>()?;
    module.add_class::<mask::DynamicMask>()?;
    module.add_class::<mask::Moving>()?;
    module.add_class::<objects::Object>()?;
    module.add_class::<record::Recorder>()?;
    module.add_class::<score::Score>()?;
    module.add_class::<simulate::Simulation>()?;
    module.add_class::<slam::Slam>()?;
    module.add_class::<source::Image>()?;
    module.add_class::<source::Images>()?;
    module.add_class::<source::Recording>()?;
    module.add_class::<trajectory::Trajectory>()?;
    module.add_function(wrap_pyfunction!(command::launch_by, module)?)?;
    module.add_function(wrap_pyfunction!(guard::prepare_for_end, module)?)?;
    module.add_function(wrap_pyfunction!(command::main, module)?)?;
    module.add_function(wrap_pyfunction!(command::input_digest, module)?)?;
    module.add_function(wrap_pyfunction!(score::evaluate, module)?)
}
