//! Examines a few frames when a data set is opened, to report problems of every frame at once.

use crate::camera::CameraModel;
use crate::dataset::Entry;
use crate::decode::Picture;
use crate::error::{DatasetError, Result};
use stillpoint_imaging::DepthImage;

/// Number of examined frames, spread evenly over the data set.
const PROBES: usize = 5;
/// Range of plausible median depths of indoor scenes, m.
const PLAUSIBLE: std::ops::RangeInclusive<f64> = 0.1..=50.0;
/// Common values per metre of depth images: millimetres, TUM, fr2, tenths of millimetres, centimetres, 1/256 m.
const FACTORS: [f64; 6] = [1000.0, 5000.0, 5208.0, 10_000.0, 100.0, 256.0];
/// Common values per metre of float images: millimetres, centimetres, metres.
const FLOAT_FACTORS: [f64; 3] = [1000.0, 100.0, 1.0];
/// Typical median depth of an indoor scene, m.
const TYPICAL: f64 = 2.0;

/// Sets the image size of a camera that lacks it, and checks size, format and scale of a few frames. Warnings go to `warnings`.
///
/// # Errors
/// The first error of the frames if none of them can be used; [`DatasetError::DepthEmpty`].
pub(crate) fn probe(
    entries: &[Entry],
    model: &mut CameraModel,
    warnings: &mut Vec<String>,
) -> Result<()> {
    let count = entries.len().min(PROBES);
    let chosen: Vec<&Entry> = (0..count)
        .map(|k| &entries[k * (entries.len() - 1) / (count - 1).max(1)])
        .collect();
    if model.camera.width == 0 {
        let sizes = chosen
            .iter()
            .filter_map(|e| Picture::of_colour(&e.colour).and_then(|p| p.size()).ok());
        (model.camera.width, model.camera.height) = most_frequent(sizes.collect());
    }
    let (mut first_error, mut depths, mut empty) = (None, Vec::new(), Vec::new());
    for entry in chosen {
        match probe_one(entry, model) {
            Ok(values) if values.is_empty() => empty.push(entry),
            Ok(values) => depths.extend(values),
            Err(e) => first_error = first_error.or(Some(e)),
        }
    }
    if depths.is_empty() {
        // Reports the error of the unusable images, or else that all depths were zero.
        if let Some(e) = first_error {
            return Err(e);
        }
        return match empty.first() {
            Some(entry) => Err(DatasetError::DepthEmpty {
                path: entry.depth.clone(),
                images: empty.len(),
            }),
            None => Ok(()),
        };
    }
    let doubt = ScaleDoubt::new(&mut depths, model.depth_scale, &FACTORS);
    warnings.extend(doubt.map(|d| d.said("set depth_scale in a camera file")));
    Ok(())
}

/// The most frequent size, the first of equals, since a single image may be damaged.
fn most_frequent(sizes: Vec<(u32, u32)>) -> (u32, u32) {
    let count = |size: &(u32, u32)| sizes.iter().filter(|s| *s == size).count();
    let best = sizes.iter().rev().max_by_key(|s| count(s));
    best.copied().unwrap_or_default()
}

/// Depths of every eighth pixel in both directions, m, without missing ones.
fn probe_one(entry: &Entry, model: &CameraModel) -> Result<Vec<f64>> {
    let colour = Picture::of_colour(&entry.colour)?;
    check_size(&entry.colour, "colour", model, colour.size()?)?;
    let depth = Picture::of_depth(&entry.depth)?;
    check_size(&entry.depth, "depth", model, depth.size()?)?;
    let depth = depth.depth(model.depth_scale)?;
    let mut values = Vec::new();
    ScaleDoubt::sample(&depth, &mut values);
    Ok(values)
}

/// Compares an image's size with the camera's.
pub(crate) fn check_size(
    path: &std::path::Path,
    what: &str,
    model: &CameraModel,
    (width, height): (u32, u32),
) -> Result<()> {
    let c = &model.camera;
    if (width, height) == (c.width, c.height) {
        return Ok(());
    }
    let same_view =
        u64::from(width) * u64::from(c.height) == u64::from(height) * u64::from(c.width);
    let advice = if what == "depth" && same_view {
        let folder = path.parent().unwrap_or(path).display();
        format!(
            "name the camera that took it, and register depth to the colour image; where depth shows the same view in other pixels, as phones measure it, bring copies of the images to this size by nearest neighbours, by ImageMagick for instance: mogrify -sample '{}x{}!' '{folder}'/*.png",
            c.width, c.height
        )
    } else {
        "name the camera that took it, and register depth to the colour image".to_owned()
    };
    Err(DatasetError::Image {
        path: path.to_owned(),
        expected: format!(
            "a {what} image of {} x {} px, the size of the camera {}",
            c.width, c.height, model.name
        ),
        found: format!("{width} x {height} px"),
        advice,
    })
}

/// Implausible depths, with a number of values per metre that would fix them.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct ScaleDoubt {
    /// Median depth, m.
    pub median: f64,
    /// Values per metre in use.
    pub scale: f64,
    /// The common number of values per metre that fits best.
    pub likely: f64,
}

impl ScaleDoubt {
    /// Adds depths of every eighth pixel in both directions, m, without missing ones.
    pub fn sample(depth: &DepthImage, values: &mut Vec<f64>) {
        let rows = (0..depth.height()).step_by(8);
        let places = rows.flat_map(|y| (0..depth.width()).step_by(8).map(move |x| (x, y)));
        let all = places.map(|(x, y)| f64::from(depth.at(x, y)));
        values.extend(all.filter(|z| *z > 0.0));
    }

    /// Checks the depths, m, of integer or float images read with `scale` values per metre; `None` if they are plausible.
    #[must_use]
    pub fn of_message(depths: &mut [f64], scale: f64, is_float: bool) -> Option<Self> {
        let factors: &[f64] = if is_float { &FLOAT_FACTORS } else { &FACTORS };
        Self::new(depths, scale, factors)
    }

    fn new(depths: &mut [f64], scale: f64, factors: &[f64]) -> Option<Self> {
        depths.sort_unstable_by(f64::total_cmp);
        let median = *depths.get(depths.len() / 2)?;
        if PLAUSIBLE.contains(&median) {
            return None;
        }
        let raw = median * scale;
        let off = |factor: f64| (raw / factor / TYPICAL).max(TYPICAL * factor / raw);
        let likely = factors
            .iter()
            .copied()
            .min_by(|a, b| off(*a).total_cmp(&off(*b)))
            .unwrap_or(scale);
        Some(Self {
            median,
            scale,
            likely,
        })
    }

    /// A message; `advice` says how to set the likely value.
    #[must_use]
    pub fn said(&self, advice: &str) -> String {
        let Self {
            median,
            scale,
            likely,
        } = self;
        format!(
            "depth scale: expected a median depth of {} to {} m, found {median:.3} m at {scale} values per metre; the likely factor is {likely} (median {:.2} m): {advice}",
            PLAUSIBLE.start(),
            PLAUSIBLE.end(),
            median * scale / likely
        )
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn likely_depth_factor_gives_indoor_depths() {
        // Depth of 2 m in millimetres, read at 5000000 and at 5 per metre.
        for scale in [5e6, 5.0] {
            let doubt = ScaleDoubt::new(&mut [2000.0 / scale], scale, &FACTORS).unwrap();
            let w = doubt.said("set it");
            assert!(
                w.contains("the likely factor is 1000 (median 2.00 m)"),
                "{w}"
            );
        }
        // Floats in centimetres and millimetres, and in metres with a wrong scale.
        for (median, scale, likely) in [
            (180.0, 1.0, 100.0),
            (960.0, 1.0, 1000.0),
            (0.0018, 1000.0, 1.0),
        ] {
            let doubt = ScaleDoubt::of_message(&mut [median], scale, true).unwrap();
            assert_eq!(doubt.likely, likely);
        }
        let few = ScaleDoubt::of_message(&mut [1.0, 2.0, 300.0], 1.0, true);
        assert_eq!(few, None);
    }
}
