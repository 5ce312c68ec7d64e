//! Common code for sample files of other sensors: one sample per line in time order, and a mounting pose.

use crate::error::{DatasetError, Result};
use crate::lists::{Line, data_lines, read_text};
use crate::units::{BETWEEN_SAMPLES, Unit};
use std::path::Path;
use std::sync::Arc;
use stillpoint_geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint_geometry::{FigureError, Se3, Vec3};
use stillpoint_imaging::Stamped;

/// The samples of a file in a folder; `None` without the file. Without a known mounting they are ignored, with the warning `unknown`, which
/// says what to add.
pub(crate) fn read<T: Stamped>(
    path: &Path,
    unknown: Option<&str>,
    warnings: &mut Vec<String>,
    sample: impl Fn(&Line<'_>, &Path, Unit) -> Result<T>,
) -> Result<Arc<[T]>> {
    if !path.is_file() {
        return Ok(Arc::default());
    }
    if let Some(advice) = unknown {
        warnings.push(format!("{} is not used: {advice}", path.display()));
        return Ok(Arc::default());
    }
    let text = read_text(path)?;
    warnings.extend(unit(&text).remark(path));
    parse(&text, path, sample)
}

/// The unit of the stamps in the first column; parse errors are reported later.
fn unit(text: &str) -> Unit {
    let stamp = |line: Line<'_>| line.columns().next()?.parse().ok();
    let stamps: Vec<f64> = data_lines(text).filter_map(stamp).collect();
    Unit::of(&stamps, BETWEEN_SAMPLES)
}

/// Parses the samples, which must be in time order.
pub(crate) fn parse<T: Stamped>(
    text: &str,
    path: &Path,
    sample: impl Fn(&Line<'_>, &Path, Unit) -> Result<T>,
) -> Result<Arc<[T]>> {
    let unit = unit(text);
    let mut samples: Vec<T> = Vec::new();
    for line in data_lines(text) {
        let next = sample(&line, path, unit)?;
        let found = next.stamp();
        if let Some(before) = samples.last().filter(|s| found <= s.stamp()) {
            return Err(DatasetError::StampOrder {
                path: path.to_owned(),
                line: line.number,
                previous: before.stamp(),
                found,
            });
        }
        samples.push(next);
    }
    Ok(samples.into())
}

/// Expectation and finding for a camera file's table.
pub(crate) type TableError = (String, String);

/// The mounting in a table: a quaternion `[x, y, z, w]` and a position, m.
pub(crate) fn mount(
    table: &str,
    [x, y, z, w]: [f64; 4],
    place: [f64; 3],
) -> std::result::Result<Se3, TableError> {
    let quaternion = Quaternion::new(w, x, y, z);
    let norm = quaternion.norm();
    // Also rejects NaN.
    if !(0.999..=1.001).contains(&norm) {
        let expected = format!("[{table}] rotation = [x, y, z, w], a quaternion of length 1");
        return Err((expected, format!("one of length {norm}")));
    }
    let rotation = UnitQuaternion::new_normalize(quaternion);
    Ok(Se3::new(rotation, Vec3::from(place)))
}

/// The head of a table with the mounting; `file` is the sample file.
pub(crate) fn mount_to_toml(mount: &Se3, time_offset: f64, file: &str) -> String {
    let (q, t) = (mount.rotation.coords, mount.translation);
    format!(
        "rotation = [{:?}, {:?}, {:?}, {:?}] # x y z w\ntranslation = [{:?}, {:?}, {:?}]\ntime_offset = {time_offset:?} # s, to be added to the stamps of {file}\n",
        q.x, q.y, q.z, q.w, t.x, t.y, t.z
    )
}

pub(crate) fn figure(table: &str, e: &FigureError) -> TableError {
    let expected = format!("[{table}] with {} {}", e.field, e.expected);
    (expected, e.found.to_string())
}
