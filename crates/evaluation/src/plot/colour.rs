//! Colours of plots, shared by pages and pictures.

/// 8-bit RGB.
#[derive(Clone, Copy, Debug, PartialEq, Eq)]
pub struct Colour(pub u8, pub u8, pub u8);

/// Text.
pub const INK: Colour = Colour(26, 29, 33);
pub(super) const FRAME: Colour = Colour(120, 120, 120);
pub(super) const GRID: Colour = Colour(228, 228, 228);
/// Ground truth: wide, under the estimate, as in the report.
pub const REFERENCE: Colour = Colour(134, 140, 150);
pub(super) const WHITE: Colour = Colour(255, 255, 255);

/// Estimate.
pub const ESTIMATE: Colour = SERIES[0];

/// Colours of series that most colour-blind people can distinguish (Okabe and Ito, 2008).
pub(super) const SERIES: [Colour; 6] = [
    Colour(0, 114, 178),
    Colour(213, 94, 0),
    Colour(0, 158, 115),
    Colour(204, 121, 167),
    Colour(230, 159, 0),
    Colour(86, 180, 233),
];

/// Supporting points of the colour map viridis (CC0), dark to light; without the lightest end, which is invisible on white.
const MAP: [[f64; 3]; 8] = [
    [68.0, 1.0, 84.0],
    [70.0, 50.0, 127.0],
    [54.0, 92.0, 141.0],
    [39.0, 127.0, 142.0],
    [31.0, 161.0, 135.0],
    [74.0, 194.0, 109.0],
    [159.0, 218.0, 58.0],
    [226.0, 221.0, 30.0],
];

/// The colour of a value from 0 to 1.
pub(super) fn map(share: f64) -> Colour {
    let at = share.clamp(0.0, 1.0) * (MAP.len() - 1) as f64;
    let low = (at as usize).min(MAP.len() - 2);
    let part = at - low as f64;
    let mix = |c: usize| (MAP[low][c] + (MAP[low + 1][c] - MAP[low][c]) * part).round() as u8;
    Colour(mix(0), mix(1), mix(2))
}
