//! Assigns a side of the mask to samples near its border and to those without depth: depth shadows, beyond the border
//! of the depth image, hair, dark clothes.
//!
//! Depth and colour are exposed at different times, so the border in depth is off by some pixels. Uncertain samples
//! take the side of the certain sample with the cheapest path, where the cost is path length plus brightness changes
//! along it: sides meet at image edges, or halfway without any. Paths are found by raster scans in both directions
//! (Criminisi, Sharp, Blake: GeoS: Geodesic Image Segmentation, ECCV 2008).

/// Path cost of a full brightness change, samples: 2 grey levels of 255, which are noise, cost as much as one sample of
/// path. Chosen.
const CHANGE: f32 = 128.0;
/// Distance from its border at which a side is certain, samples of 4 px. Chosen above the 10 px that a near person
/// walks in the 15 ms between depth and image (1.4 m/s at 1 m; Bohannon 1997).
const BAND: f32 = 4.0;
/// Initial path cost of a side from depth at its border, and reduction per sample of distance: low enough to be
/// overruled by the image, and high enough for an arm that is nowhere far from its border. Chosen: at `BAND`, 12 of 30
/// are left.
const DOUBT: [f32; 2] = [30.0, 6.0];
/// Minimum distance of a narrow object's centre line from its border, samples; thinner ones are fragments. Chosen: half
/// of `BAND`.
const NARROW: f32 = 2.0;
/// Maximum path cost for samples without depth, samples, chosen: a hole wider than a shadow belongs to no object.
const FAR: f32 = 40.0;
/// Number of forward and backward scans, chosen: paths that turn more often are rare.
const SCANS: usize = 2;
/// Weight of a sample without depth, relative to 1 of the others, chosen: three guesses count less than one measured
/// sample.
const GUESS: f32 = 0.3;
/// Length of a diagonal step, samples: the diagonal of a square.
const DIAGONAL: f32 = std::f32::consts::SQRT_2;

/// Sums over a sample's pixels.
#[derive(Clone, Copy, Debug, Default)]
pub(super) struct Sample {
    pub(super) weight: f32,
    /// Weights of those in the mask.
    pub(super) inside: f32,
}

/// The cheapest path from a sample to a certain one, and the side of that.
#[derive(Clone, Copy)]
struct Way {
    cost: f32,
    inside: bool,
}

/// Settles the samples, in rows of `width`, given their brightness and the weight of a sample with depth everywhere.
pub(super) fn settle(samples: &mut [Sample], brightness: &[f32], width: usize, whole: f32) {
    let is_known = |s: &Sample| s.weight >= 0.5 * whole;
    let is_inside = |s: &Sample| is_known(s) && s.inside > 0.5 * s.weight;
    // Distances of each sample from the inside and from the outside.
    let reach = |zero: bool| -> Vec<f32> {
        let start = |s: &Sample| {
            if is_inside(s) == zero {
                0.0
            } else {
                f32::INFINITY
            }
        };
        samples.iter().map(start).collect()
    };
    let [mut from, mut within] = [reach(true), reach(false)];
    for distances in [&mut from, &mut within] {
        scan(
            width,
            distances,
            |d| *d == 0.0,
            |here, there, length, _| {
                *here = here.min(there + length);
            },
        );
    }
    // Centre lines of narrow objects are certain as well; otherwise such objects would vanish where the image has no
    // edge.
    let is_middle = |i: usize| {
        let beside = [
            i.checked_sub(1),
            Some(i + 1),
            i.checked_sub(width),
            Some(i + width),
        ];
        let mut beside = beside.into_iter().flatten().filter_map(|j| within.get(j));
        within[i] >= NARROW && beside.all(|other| *other <= within[i])
    };
    let way = |(i, s): (usize, &Sample)| {
        let inside = is_inside(s);
        let depth = if inside { within[i] } else { from[i] };
        let doubt = if depth > BAND {
            0.0
        } else if is_middle(i) {
            BAND - depth
        } else {
            DOUBT[0] - DOUBT[1] * (depth - 1.0)
        };
        Way {
            cost: if is_known(s) { doubt } else { f32::INFINITY },
            inside,
        }
    };
    let mut ways: Vec<Way> = samples.iter().enumerate().map(way).collect();
    for _ in 0..SCANS {
        scan(
            width,
            &mut ways,
            |way| way.cost == 0.0,
            |here, there, length, [i, j]| {
                let change = CHANGE * (brightness[i] - brightness[j]).abs();
                let cost = there.cost + length + change;
                if cost < here.cost {
                    *here = Way { cost, ..there };
                }
            },
        );
    }
    for (sample, way) in samples.iter_mut().zip(&ways) {
        let known = is_known(sample);
        // Samples that keep their side from depth keep their share.
        if !known || way.inside != is_inside(sample) {
            let inside = way.inside && (known || way.cost <= FAR);
            sample.weight = if known { whole } else { GUESS * whole };
            sample.inside = if inside { sample.weight } else { 0.0 };
        }
    }
}

/// Calls `step` with every value that is not `settled` and each preceding neighbour, the distance between them, and
/// both indices, in a forward and a backward scan.
fn scan<T: Copy>(
    width: usize,
    values: &mut [T],
    settled: impl Fn(&T) -> bool,
    mut step: impl FnMut(&mut T, T, f32, [usize; 2]),
) {
    let count = values.len();
    let mut visit = |i: usize, back: bool| {
        let mut here = values[i];
        if settled(&here) {
            return;
        }
        let column = i % width;
        let (first, last) = (column == 0, column + 1 == width);
        // Preceding neighbours in scan order; mirrored in the backward scan.
        let (start, end) = if back { (last, first) } else { (first, last) };
        let place = |back_by: usize| {
            let at = if back {
                i.checked_add(back_by)
            } else {
                i.checked_sub(back_by)
            };
            at.filter(|j| *j < count)
        };
        let neighbours = [
            (!start).then(|| place(1)).flatten().map(|j| (j, 1.0)),
            place(width).map(|j| (j, 1.0)),
            (!start)
                .then(|| place(width + 1))
                .flatten()
                .map(|j| (j, DIAGONAL)),
            (!end)
                .then(|| place(width - 1))
                .flatten()
                .map(|j| (j, DIAGONAL)),
        ];
        for (j, length) in neighbours.into_iter().flatten() {
            step(&mut here, values[j], length, [i, j]);
        }
        values[i] = here;
    };
    (0..count).for_each(|i| visit(i, false));
    (0..count).rev().for_each(|i| visit(i, true));
}
