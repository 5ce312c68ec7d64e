//! Checks that depth is in metres.
//!
//! Measures distances and the quantisation of depth. First-generation structured-light cameras (Kinect, Xtion, Carmine) measure disparities
//! in eighths of a pixel over a baseline of 75 mm with a focal length of about 580 px, so their depth steps are 2.87 mm at 1 m and grow
//! with the square of depth (Khoshelham and Elberink, Sensors 2012): that gives the scale to some percent, for any scene. For other cameras
//! only the distances can be judged; a factor of 5 moves them out of the range of any room.

use crate::finding::{Figure, Finding, Report, Symptom};
use crate::median::{median, quantile};
use stillpoint_imaging::DepthImage;

/// Depth step of structured light over squared depth, 1/m.
const STRUCTURED_LIGHT: f64 = 0.125 / (580.0 * 0.075);
/// Time between examined depth images, s, and stride over their pixels.
const EVERY: f64 = 0.25;
const STRIDE: usize = 2;
/// Width of the depth bins, as a fraction.
const BIN: f64 = 0.08;
/// Typical distance in an indoor camera's view, m.
const TYPICAL: f64 = 1.5;
/// Distances out of these are implausible, m: cameras measure up to about 10 m indoors, and except for special ones none measures a whole
/// view nearer than 0.45 m.
const FAR_MEDIAN: f64 = 7.0;
const FAR_MOST: f64 = 13.0;
const NEAR_MOST: f64 = 0.45;
/// Factors between the scales in use (1000, 5000, 4000 and 10000 values per metre; metres confused with millimetres or centimetres).
const FACTORS: [f64; 7] = [4.0, 5.0, 10.0, 2.5, 2.0, 100.0, 1000.0];
/// Valid scales, values per metre.
const SCALES: std::ops::RangeInclusive<f64> = 1e-3..=1e6;
/// Calibrations of cameras of one kind differ by less than this, as a fraction.
const MATCH: f64 = 0.15;

#[derive(Default)]
pub(crate) struct Depths {
    values: Vec<f32>,
    last: Option<f64>,
}

impl Depths {
    pub(crate) fn add(&mut self, stamp: f64, depth: &DepthImage) {
        if self.last.is_some_and(|last| (stamp - last).abs() < EVERY) {
            return;
        }
        self.last = Some(stamp);
        let rows = depth.data().chunks(depth.width().max(1)).step_by(STRIDE);
        let values = rows.flat_map(|row| row.iter().step_by(STRIDE));
        self.values.extend(values.filter(|z| **z > 0.0));
    }

    /// Step over squared depth, 1/m, if depth steps grow with its square.
    fn step(&mut self) -> Option<f64> {
        self.values.sort_unstable_by(f32::total_cmp);
        let middle = f64::from(*self.values.get(self.values.len() / 2)?);
        let last = f64::from(*self.values.get(self.values.len() * 99 / 100)?);
        let mut found: Vec<[f64; 2]> = Vec::new();
        let mut low = 0.8 * middle;
        while low < last {
            let high = low * (1.0 + BIN);
            if let Some(step) = step_between(&self.values, low, high) {
                found.push([0.5 * (low + high), step]);
            }
            low = high;
        }
        let ([first, .., last], true) = (&found[..], found.len() >= 4) else {
            return None;
        };
        let slope = libm::log(last[1] / first[1]) / libm::log(last[0] / first[0]);
        let mut steps: Vec<f64> = found.iter().map(|[z, s]| s / (z * z)).collect();
        let step = median(&mut steps)?;
        steps
            .iter_mut()
            .for_each(|s| *s = libm::log(*s / step).abs());
        let spread = median(&mut steps)?;
        // Steps of a fixed size (rounding to millimetres) have a slope of 0.
        (spread < 0.15 && (1.4..2.6).contains(&slope)).then_some(step)
    }
}

/// Usual distance between frequent sorted depths, from `low` to `high`.
fn step_between(values: &[f32], low: f64, high: f64) -> Option<f64> {
    let from = values.partition_point(|z| f64::from(*z) < low);
    let to = values.partition_point(|z| f64::from(*z) < high);
    let part = &values[from..to];
    if part.len() < 400 {
        return None;
    }
    let levels: Vec<(f32, usize)> = part
        .chunk_by(|a, b| a == b)
        .map(|c| (c[0], c.len()))
        .collect();
    let most = levels.iter().map(|l| l.1).max()?;
    // Drawn or interpolated values hardly repeat.
    let often: Vec<f32> = levels
        .iter()
        .filter(|l| 10 * l.1 >= most)
        .map(|l| l.0)
        .collect();
    let repeats = part.len() >= 8 * often.len();
    let mut steps: Vec<f64> = often.windows(2).map(|w| f64::from(w[1] - w[0])).collect();
    let enough = steps.len() >= 2 && repeats;
    median(&mut steps).filter(|_| enough)
}

/// Judges the scale; true if no error is visible. `depth_scale` is the assumed scale, values per metre.
pub(crate) fn judge(depths: &mut Depths, depth_scale: f64, report: &mut Report) -> bool {
    let step = depths.step();
    let mut values: Vec<f64> = depths.values.iter().map(|z| f64::from(*z)).collect();
    let quantiles = [0.05, 0.5, 0.95].map(|q| quantile(&mut values, q));
    let [Some(near), Some(middle), Some(most)] = quantiles else {
        report.pass_over("the depth scale: there is no depth");
        return true;
    };
    let mut figures = vec![
        Figure::new("nearest twentieth of depth", near, "m"),
        Figure::new("median depth", middle, "m"),
        Figure::new("farthest twentieth of depth", most, "m"),
    ];
    if let Some(step) = step {
        figures.push(Figure::new("step of depth at 1 m", 1000.0 * step, "mm"));
    }
    report.measured.extend(figures.iter().cloned());
    let Some(factor) = factor(step, middle, most, depth_scale) else {
        return true;
    };
    let (much, times) = if factor > 1.0 {
        ("large", factor)
    } else {
        ("small", 1.0 / factor)
    };
    let right = usual_scale(depth_scale * factor);
    let times = if times > 3.0 {
        format!("{times:.0}")
    } else {
        format!("{times:.1}")
    };
    let remedy = if SCALES.contains(&right) {
        format!(
            "the images hold about {right} values per metre, not {depth_scale}: run with --depth-scale {right}; for a folder, write depth_scale = {right} to its camera file (--camera camera.toml)"
        )
    } else {
        "no usual number of values per metre makes distances of a room of them: are they distances (--depth-topic), and is a scale stated that is none?".to_owned()
    };
    report.find(Finding {
        symptom: Symptom::DepthScale,
        message: format!(
            "depth is too {much} by a factor of about {times}: half of it lies beyond {middle:.2} m and a twentieth beyond {most:.2} m"
        ),
        remedy,
        evidence: figures,
    });
    false
}

/// Factor by which depth is too large, if it is wrong, after reading at `stated` values per metre.
fn factor(step: Option<f64>, middle: f64, most: f64, stated: f64) -> Option<f64> {
    let odd = |z: f64| libm::log(z / TYPICAL).abs();
    let by_step = step.map(|s| STRUCTURED_LIGHT / s);
    let known = by_step.and_then(|f| {
        let of = FACTORS.iter().flat_map(|k| [*k, 1.0 / k]);
        let near = of.filter(|k| libm::log(k / f).abs() < MATCH);
        near.min_by(|a, b| libm::log(a / f).abs().total_cmp(&libm::log(b / f).abs()))
    });
    let known = known.filter(|f| odd(middle / f) < odd(middle));
    let far = middle > FAR_MEDIAN || most > FAR_MOST;
    if let Some(factor) = known.filter(|f| far || most < NEAR_MOST || *f >= 3.9 || *f <= 0.26) {
        return Some(factor);
    }
    if !far && most >= NEAR_MOST {
        return None;
    }
    // Only the distances are known: the usual confusion that makes them most plausible. Values read as metres are in centimetres or
    // millimetres.
    let usual: &[f64] = if far && stated == 1.0 {
        &[100.0, 1000.0]
    } else {
        &[5.0, 10.0, 100.0, 1000.0]
    };
    let of = usual.iter().map(|k| if far { *k } else { 1.0 / k });
    of.min_by(|a, b| odd(middle / a).total_cmp(&odd(middle / b)))
}

/// A scale in use near the estimated one, or that rounded to two digits.
fn usual_scale(scale: f64) -> f64 {
    let usual = [1.0, 100.0, 1000.0, 2000.0, 4000.0, 5000.0, 10000.0];
    let near = usual.iter().find(|u| libm::log(*u / scale).abs() < 0.2);
    near.copied().unwrap_or_else(|| {
        let digit = libm::pow(10.0, libm::floor(libm::log10(scale)) - 1.0);
        libm::round(scale / digit) * digit
    })
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Depths from 0.7 to 4 m of a camera with this disparity unit (focal length x baseline over step, m).
    fn quantised(unit: f64, scale: f64) -> Depths {
        let mut depths = Depths::default();
        for i in 0..200_000 {
            let z = 0.7 + 3.3 * f64::from(i) / 200_000.0;
            depths
                .values
                .push((scale * unit / (unit / z).round()) as f32);
        }
        depths
    }

    #[test]
    fn disparity_steps_are_distinguished_from_rounding() {
        let unit = 1.0 / STRUCTURED_LIGHT;
        for scale in [0.2, 1.0, 5.0] {
            let step = quantised(unit, scale).step().unwrap();
            let expected = STRUCTURED_LIGHT / scale;
            assert!((step / expected - 1.0).abs() < 0.05, "{step} {expected}");
        }
        let mut rounded = Depths::default();
        for i in 0..200_000 {
            rounded.values.push((700 + i % 3300) as f32 / 1000.0);
        }
        assert_eq!(rounded.step(), None);
    }

    #[test]
    fn room_distances_are_plausible_for_any_camera() {
        for middle in [0.6, 1.0, 2.0, 4.0] {
            assert_eq!(factor(None, middle, 2.5 * middle, 1000.0), None);
            assert_eq!(
                factor(Some(STRUCTURED_LIGHT), middle, 2.5 * middle, 1000.0),
                None
            );
            // Half the step: another camera's.
            assert_eq!(
                factor(Some(0.5 * STRUCTURED_LIGHT), middle, 2.5 * middle, 1000.0),
                None
            );
        }
        assert_eq!(
            factor(Some(STRUCTURED_LIGHT / 5.0), 5.0, 12.0, 1000.0),
            Some(5.0)
        );
        assert_eq!(
            factor(Some(STRUCTURED_LIGHT * 5.0), 0.4, 0.8, 1000.0),
            Some(0.2)
        );
        assert_eq!(factor(None, 1500.0, 4000.0, 1.0), Some(1000.0));
        assert_eq!(factor(None, 0.0015, 0.004, 1000.0), Some(0.001));
        assert_eq!(factor(None, 45.0, 90.0, 1.0), Some(100.0));
        assert_eq!(factor(None, 160.0, 420.0, 1.0), Some(100.0));
    }

    /// Floats, read as metres or by a stated scale, and the result of the remedy: a scale without findings.
    #[test]
    fn suggested_depth_scale_leaves_no_finding() {
        for (per_metre, stated) in [(1000.0, 1.0), (100.0, 1.0), (1.0, 1000.0)] {
            let look = |scale: f64| {
                let mut depths = Depths::default();
                let raw = |i: u32| per_metre * (0.7 + 1e-4 * f64::from(i % 33_000));
                depths.values = (0..100_000).map(|i| (raw(i) / scale) as f32).collect();
                let mut report = Report::default();
                judge(&mut depths, scale, &mut report);
                report.findings.pop().map(|f| f.remedy)
            };
            let remedy = look(stated).unwrap();
            let option = format!("--depth-scale {per_metre};");
            assert!(remedy.contains(&option), "{remedy}");
            assert_eq!(look(per_metre), None);
        }
    }

    #[test]
    fn usual_depth_scales_are_suggested() {
        assert_eq!(usual_scale(5200.0), 5000.0);
        assert_eq!(usual_scale(960.0), 1000.0);
        assert_eq!(usual_scale(256.0), 260.0);
    }
}
