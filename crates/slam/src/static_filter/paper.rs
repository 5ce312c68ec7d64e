//! Preset `paper`: objects, epipolar constraint and depth fused as published in "A real-time visual SLAM based on
//! semantic information and geometric information in dynamic environment" (Journal of Real-Time Image Processing, 2024,
//! doi:10.1007/s11554-024-01527-4), Algorithm 2. Gaps are filled in algorithm.md, section 15.

use super::semantic::{MOVER, Mover};
use super::verdict::{FeatureVerdict, Reasons};
use super::{FrameInput, StaticFilterConfig, depth, epipolar};
use stillpoint_estimation::{Purpose, address, rng};
use stillpoint_geometry::Camera;

struct SplitBox<'a> {
    mover: &'a Mover,
    /// Features deeper than this are background, m.
    background_beyond: Option<f64>,
}

pub(super) fn judge(
    config: &StaticFilterConfig,
    input: &FrameInput<'_>,
    camera: &Camera,
    movers: &[Mover],
    seed: u64,
) -> Vec<FeatureVerdict> {
    let movers = if config.parts.objects { movers } else { &[] };
    let distances = if config.parts.geometry {
        epipolar::distances(input, camera, movers, seed)
    } else {
        vec![None; input.features.len()]
    };
    let boxes: Vec<SplitBox<'_>> = movers
        .iter()
        .map(|mover| SplitBox {
            mover,
            background_beyond: split(config, input, mover, seed),
        })
        .collect();
    input
        .features
        .iter()
        .zip(input.depths)
        .zip(&distances)
        .map(|((pixel, z), d)| decide(config, *pixel, *z, *d, &boxes))
        .collect()
}

/// The depth that separates background from object in a box; `None` if the box is not split.
fn split(
    config: &StaticFilterConfig,
    input: &FrameInput<'_>,
    mover: &Mover,
    seed: u64,
) -> Option<f64> {
    if !config.parts.depth || mover.weight < config.split_weight {
        return None;
    }
    let inside = |(pixel, z): (&[f32; 2], &f32)| {
        let held = *z > 0.0
            && mover
                .bounds
                .contains(f64::from(pixel[0]), f64::from(pixel[1]));
        held.then(|| f64::from(*z))
    };
    let depths: Vec<f64> = input
        .features
        .iter()
        .zip(input.depths)
        .filter_map(inside)
        .collect();
    let stream = address(input.frame.id.0, mover.id.0);
    depth::threshold(&depths, rng(seed, stream, Purpose::DEPTH))
}

fn decide(
    config: &StaticFilterConfig,
    pixel: [f32; 2],
    z: f32,
    distance: Option<f64>,
    boxes: &[SplitBox<'_>],
) -> FeatureVerdict {
    let [u, v] = pixel.map(f64::from);
    let is_background = |b: &SplitBox<'_>| b.background_beyond.is_some_and(|t| f64::from(z) > t);
    let holding = boxes.iter().filter(|b| b.mover.bounds.contains(u, v));
    // Of overlapping boxes the heaviest whose object the feature may lie on, else the heaviest.
    let chosen = holding.max_by(|a, b| {
        let rank = |x: &SplitBox<'_>| (!is_background(x), x.mover.weight);
        rank(a)
            .partial_cmp(&rank(b))
            .unwrap_or(std::cmp::Ordering::Equal)
    });
    let mut reasons = Reasons::default();
    let Some(b) = chosen else {
        let dynamic = distance.is_some_and(|d| d >= config.epipolar_px);
        if dynamic {
            reasons |= Reasons::EPIPOLAR;
        }
        return FeatureVerdict {
            pixel,
            dynamic,
            reasons,
            risk: distance.unwrap_or(0.0).min(4.0) as f32,
        };
    };
    let weight = b.mover.weight;
    let background = is_background(b);
    let off_line = distance.is_some_and(|d| weight * d >= config.epipolar_px);
    let split = config.parts.depth && weight >= config.split_weight;
    let by_depth = split && !background;
    // Without depth and flow only the class remains.
    let by_class = !split && distance.is_none() && weight >= MOVER;
    let dynamic = off_line || by_depth || by_class;
    for (given, reason) in [
        (off_line, Reasons::EPIPOLAR),
        (by_depth || (split && background), Reasons::DEPTH),
        (dynamic, Reasons::OBJECT),
    ] {
        if given {
            reasons |= reason;
        }
    }
    FeatureVerdict {
        pixel,
        dynamic,
        reasons,
        // Release order: low weights, background, near the line.
        risk: (10.0 * weight
            + if background { 0.0 } else { 5.0 }
            + distance.unwrap_or(0.0).min(4.0)) as f32,
    }
}

#[cfg(test)]
mod tests;
