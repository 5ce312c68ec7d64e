//! Part G: distance of each feature from its epipolar line, or in degenerate cases from its position in a static scene.

use super::semantic::Mover;
use super::{FlowPair, FrameInput, rigid};
use stillpoint_estimation::{
    Degeneracy, PixelPair, Purpose, TwoViewOptions, epipolar_distance, find_fundamental,
    find_homography, rng, test_degeneracy,
};
use stillpoint_geometry::{Camera, Mat3};

/// Minimum number of pairs outside boxes to estimate the fundamental matrix from them alone. Chosen: seven times the
/// seven of a sample.
const MIN_OUTSIDE: usize = 50;
/// Standard deviation of a flow vector, px, for the test of degeneracy. Chosen: somewhat above the third of a pixel
/// that flow errs by (decision 21).
const SIGMA_PX: f64 = 0.5;

/// Distance of each feature from its epipolar line, px; `None` without flow, and without depth if the camera's motion
/// is degenerate.
pub(super) fn distances(
    input: &FrameInput<'_>,
    camera: &Camera,
    movers: &[Mover],
    seed: u64,
) -> Vec<Option<f64>> {
    let f_matrix = fundamental(input, movers, seed);
    let distance = |(pair, z): (&Option<FlowPair>, &f32)| {
        let pair = pair.as_ref()?;
        match &f_matrix {
            Some(f) => Some(epipolar_distance(f, pair.before.into(), pair.now.into())),
            None => rigid::distance_px(camera, pair, *z, &input.last_from_now),
        }
    };
    if input.pairs.is_empty() {
        return vec![None; input.features.len()];
    }
    input.pairs.iter().zip(input.depths).map(distance).collect()
}

/// Fundamental matrix from the last frame to this one, from pairs outside the boxes if there are enough; `None` if
/// degenerate: motion too small, a pure rotation, or a planar scene.
fn fundamental(input: &FrameInput<'_>, movers: &[Mover], seed: u64) -> Option<Mat3> {
    let _span = tracing::info_span!("epipolar").entered();
    let in_box = |[u, v]: [f32; 2]| {
        let pixel = [f64::from(u), f64::from(v)];
        movers.iter().any(|m| m.bounds.contains(pixel[0], pixel[1]))
    };
    let all: Vec<(PixelPair, bool)> = input
        .pairs
        .iter()
        .zip(input.features)
        .filter_map(|(pair, pixel)| {
            let pair = pair.as_ref()?;
            Some(((pair.before.into(), pair.now.into()), in_box(*pixel)))
        })
        .collect();
    let outside: Vec<PixelPair> = all.iter().filter(|p| !p.1).map(|p| p.0).collect();
    let pairs = if outside.len() >= MIN_OUTSIDE {
        outside
    } else {
        all.iter().map(|p| p.0).collect()
    };
    let frame = u64::from(input.frame.id.0);
    let f = find_fundamental(
        &pairs,
        &TwoViewOptions::default(),
        rng(seed, frame, Purpose::FUNDAMENTAL),
    )?;
    let h = find_homography(
        &pairs,
        &TwoViewOptions::for_homography(),
        rng(seed, frame, Purpose::HOMOGRAPHY),
    );
    let test = test_degeneracy(
        &pairs,
        Some(&f.f_matrix),
        h.as_ref().map(|h| &h.h_matrix),
        SIGMA_PX,
    );
    (test.degeneracy == Degeneracy::None).then_some(f.f_matrix)
}

#[cfg(test)]
mod tests;
