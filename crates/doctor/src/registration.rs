//! Checks that depth is registered to the colour image.
//!
//! Measures the shift between silhouettes of the depth image and contours of the colour image, after removing motion. Depth of another
//! camera is shifted by its baseline over depth, by its direction, and in proportion to the distance from the middle if the focal lengths
//! differ; the model has these three parts along each axis. It also compares with the contours at the silhouettes of a mirrored depth
//! image.

use crate::edges::MeanProfile;
use crate::finding::{Figure, Finding, Report, Symptom};
use crate::gradient::{Axis, PROFILE, REACH};
use crate::median::median;
use crate::sync::{Delay, Moving, sample};

/// Maximum distance of registered silhouettes and contours, px: uncalibrated lenses of depth cameras leave as much.
const NEAR: i32 = 3;
/// Maximum number of silhouette pixels for the fit, and the minimum to judge an axis.
const MAX_EDGES: usize = 4000;
const MIN_EDGES: usize = 800;
/// For a valid model, contours are this much stronger at silhouettes than around them.
const HOLDS: f64 = 1.25;
/// It is better than no shift by this factor.
const BETTER: f64 = 1.25;
/// Minimum strength of contours at silhouettes of registered depth without a shift, even next to frames and shadows: 1.5 and more on real
/// and simulated streams; with depth of a camera 25 mm aside they were not stronger than 1.1.
const REGISTERED: f64 = 1.3;
/// Minimum number of silhouettes of surfaces that end towards one end of the axis, and likewise towards the other, and the factor by which
/// the model improves each of both groups: a ledge beside an edge has its second contour on one side only.
const MIN_ONE_WAY: usize = 200;
const BETTER_ONE_WAY: f64 = 1.1;
/// It shifts half of the silhouettes by more than this, px.
const MIN_SHIFT: f64 = 4.0;
/// If a constant shift is the cause, it agrees better than a delay by this factor.
const FITS: f64 = 1.1;
/// Mirrored images agree better than the given ones by this factor.
const MIRRORED: f64 = 1.3;

/// Shift along an axis: px, px m (over depth), and per px from the middle.
#[derive(Clone, Copy, Debug, Default)]
struct Shift {
    constant: f32,
    by_inverse_depth: f32,
    by_place: f32,
}

/// An edge with all shifts except registration.
struct Sample<'a> {
    edge: &'a Moving,
    /// px from the middle of the image.
    place: f32,
    moved: f32,
    profile: &'a [f32],
}

impl Shift {
    fn of(&self, s: &Sample<'_>) -> f32 {
        self.constant + self.by_inverse_depth / s.edge.z + self.by_place * s.place
    }

    /// Mean strength of contours at the shifted silhouettes.
    fn agreement<'a>(&self, samples: impl Iterator<Item = &'a Sample<'a>>) -> f64 {
        let (mut sum, mut count) = (0.0, 0);
        for s in samples {
            sum += f64::from(sample(s.profile, s.moved + self.of(s)));
            count += 1;
        }
        sum / f64::from(count.max(1))
    }
}

#[derive(Clone, Copy, Debug)]
struct AxisResult {
    /// Agreement near no shift, and with the best model, over the mean of all profiles.
    here: f64,
    best: f64,
    /// Median of the model's shift and of its size, px.
    shift: f64,
    size: f64,
    /// Whether surfaces that end towards either end of the axis support the model.
    both_ways: bool,
}

#[derive(Clone, Copy, Debug)]
pub(crate) struct Registered {
    /// Depth appears registered to the colour image.
    pub(crate) yes: bool,
    /// The delay explains the silhouettes' positions better than a constant shift.
    pub(crate) delay_holds: bool,
}

pub(crate) fn judge(
    edges: &[Moving],
    profiles: &[f32],
    delay: Option<&Delay>,
    size: [usize; 2],
    mirrored: &[[MeanProfile; 2]; 3],
    report: &mut Report,
) -> Registered {
    let at = |delay: f64| Axis::BOTH.map(|axis| examine(axis, edges, profiles, delay, size));
    let still = at(0.0);
    let moved = delay.filter(|d| d.is_sharp()).map(|d| at(d.value));
    // Unregistered depth has a spurious best delay.
    let held = moved.filter(|moved| mean(&still, |r| r.best) <= FITS * mean(moved, |r| r.here));
    let mut found = Registered {
        yes: true,
        delay_holds: held.is_some(),
    };
    let along = held.unwrap_or(still);
    let judged: Vec<AxisResult> = along.iter().flatten().copied().collect();
    if judged.is_empty() {
        report
            .pass_over("whether depth is registered to colour: too few surfaces end before others");
        return found;
    }
    if mirror(edges, profiles, mirrored, report) {
        found.yes = false;
        return found;
    }
    for (axis, result) in along.iter().enumerate() {
        let Some(result) = result else { continue };
        let name = [
            "contours at silhouettes, along x",
            "contours at silhouettes, along y",
        ][axis];
        report.measure(Figure::new(name, result.here, "times those around"));
    }
    let off = |r: &&AxisResult| {
        r.both_ways
            && r.here < REGISTERED
            && r.best >= HOLDS
            && r.best >= BETTER * r.here
            && r.size > MIN_SHIFT
    };
    let worst = judged
        .iter()
        .filter(off)
        .max_by(|a, b| a.size.total_cmp(&b.size));
    let Some(worst) = worst else {
        return found;
    };
    found.yes = false;
    let mut evidence = Vec::new();
    for (axis, result) in along.iter().enumerate() {
        let Some(result) = result.as_ref().filter(off) else {
            continue;
        };
        let [shift, here, best] = [
            [
                "median shift along x",
                "contours where depth ends, along x",
                "the same with that shift, along x",
            ],
            [
                "median shift along y",
                "contours where depth ends, along y",
                "the same with that shift, along y",
            ],
        ][axis];
        evidence.push(Figure::new(shift, result.shift, "px"));
        evidence.push(Figure::new(here, result.here, "times those around"));
        evidence.push(Figure::new(best, result.best, "times those around"));
    }
    report.find(Finding {
        symptom: Symptom::Registration,
        message: format!(
            "depth is not registered to colour: surfaces end {:.0} px beside their contours, about",
            worst.size
        ),
        remedy: "record depth aligned to colour (RealSense: align_depth.enable:=true; Azure Kinect, Femto: depth transformed to the colour camera; OpenNI: depth_registered), or give the file its CameraInfo and tf of both cameras: depth is then registered when it is read".into(),
        evidence,
    });
    found
}

/// Mean of a value over both axes.
fn mean(along: &[Option<AxisResult>; 2], of: impl Fn(&AxisResult) -> f64) -> f64 {
    let values: Vec<f64> = along.iter().flatten().map(of).collect();
    values.iter().sum::<f64>() / values.len().max(1) as f64
}

fn examine(
    axis: Axis,
    edges: &[Moving],
    profiles: &[f32],
    delay: f64,
    size: [usize; 2],
) -> Option<AxisResult> {
    let middle = size[axis.index()] as f32 / 2.0;
    let mut samples: Vec<Sample<'_>> = edges
        .iter()
        .zip(profiles.chunks_exact(PROFILE))
        .filter(|(e, _)| e.axis == axis)
        .map(|(edge, profile)| Sample {
            edge,
            place: f32::from(if axis == Axis::X { edge.x } else { edge.y }) - middle,
            moved: edge.shift(delay),
            profile,
        })
        // Edges that move far between both exposures are more informative about time.
        .filter(|s| s.moved.abs() < 0.5 * REACH as f32)
        .collect();
    let stride = samples.len().div_ceil(MAX_EDGES).max(1);
    let mut k = 0;
    samples.retain(|_| {
        k += 1;
        (k - 1) % stride == 0
    });
    if samples.len() < MIN_EDGES {
        return None;
    }
    let values = samples.iter().flat_map(|s| s.profile);
    let mean = values.map(|v| f64::from(*v)).sum::<f64>() / (samples.len() * PROFILE) as f64;
    let mean = mean.max(1e-6);
    let constant = |c: i32| Shift {
        constant: c as f32,
        ..Shift::default()
    };
    let here = (-NEAR..=NEAR)
        .map(|c| constant(c).agreement(samples.iter()) / mean)
        .fold(0.0, f64::max);
    // Fitted to one half of the silhouettes, judged on the other: a model with three parts would fit a few contours by chance.
    let model = fit(&samples);
    let second = samples.iter().skip(1).step_by(2);
    let best = model.agreement(second) / mean;
    let one_way = |backwards: bool| {
        let side = || samples.iter().filter(|s| s.edge.backwards == backwards);
        let without = (-NEAR..=NEAR)
            .map(|c| constant(c).agreement(side()))
            .fold(0.0, f64::max);
        let with = model.agreement(side());
        side().count() >= MIN_ONE_WAY && with >= BETTER_ONE_WAY * without
    };
    let both_ways = one_way(false) && one_way(true);
    let mut shifts: Vec<f64> = samples.iter().map(|s| f64::from(model.of(s))).collect();
    let shift = median(&mut shifts)?;
    shifts.iter_mut().for_each(|s| *s = s.abs());
    Some(AxisResult {
        here,
        best,
        shift,
        size: median(&mut shifts)?,
        both_ways,
    })
}

/// The model that agrees best with every second sample: over a grid, then finer around the best.
fn fit(samples: &[Sample<'_>]) -> Shift {
    let few: Vec<&Sample<'_>> = samples.iter().step_by(2).collect();
    let grid = |centre: Shift, steps: [f32; 3], counts: [i32; 3], every: usize| {
        let mut best = (f64::MIN, centre);
        for i in -counts[0]..=counts[0] {
            for j in -counts[1]..=counts[1] {
                for k in -counts[2]..=counts[2] {
                    let shift = Shift {
                        constant: centre.constant + steps[0] * i as f32,
                        by_inverse_depth: centre.by_inverse_depth + steps[1] * j as f32,
                        by_place: centre.by_place + steps[2] * k as f32,
                    };
                    let agreement = shift.agreement(few.iter().step_by(every).copied());
                    if agreement > best.0 {
                        best = (agreement, shift);
                    }
                }
            }
        }
        best.1
    };
    let coarse = grid(Shift::default(), [3.0, 4.0, 0.03], [6, 9, 6], 4);
    let finer = grid(coarse, [1.0, 1.5, 0.01], [2, 2, 2], 1);
    grid(finer, [0.5, 0.7, 0.004], [1, 1, 1], 1)
}

/// Detects that one of the images is mirrored.
fn mirror(
    edges: &[Moving],
    profiles: &[f32],
    mirrored: &[[MeanProfile; 2]; 3],
    report: &mut Report,
) -> bool {
    let mut plain = [MeanProfile::default(); 2];
    for (edge, profile) in edges.iter().zip(profiles.chunks_exact(PROFILE)) {
        plain[edge.axis.index()].add(profile);
    }
    let here = strength(&plain);
    let others = mirrored.each_ref().map(strength);
    let (k, best) = (0..3)
        .map(|k| (k, others[k]))
        .max_by(|a, b| a.1.total_cmp(&b.1))
        .unwrap_or((0, 0.0));
    if best < HOLDS || best < MIRRORED * here {
        return false;
    }
    let how = [
        "mirrored from left to right",
        "mirrored from top to bottom",
        "turned by half a turn",
    ][k];
    report.find(Finding {
        symptom: Symptom::Mirrored,
        message: format!("one of colour and depth is {how} against the other"),
        remedy: "switch off mirroring or flipping in the driver of one of both cameras, or undo it before recording".into(),
        evidence: vec![
            Figure::new("contours at silhouettes", here, "times those around"),
            Figure::new("the same if that is undone", best, "times those around"),
        ],
    });
    true
}

/// Strength of contours near silhouettes over that around them, both axes together.
fn strength(profiles: &[MeanProfile; 2]) -> f64 {
    let (mut near, mut all) = (0.0, 0.0);
    for p in profiles {
        let range = REACH - NEAR as usize..=REACH + NEAR as usize;
        near += p.sum[range].iter().copied().fold(0.0, f64::max);
        all += p.sum.iter().sum::<f64>() / PROFILE as f64;
    }
    near / all.max(1e-9)
}
