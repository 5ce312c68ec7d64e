//! What a rough mask says near its border, and of where no depth is known: in the shadow beside a near surface, beyond the border of the depth image,
//! on hair and dark clothes.
//!
//! Depth is exposed at another time than the image, so the border of what moves lies some pixels beside its own. Samples near it, and those without
//! depth, take the side of a sample that is surer, where a way costs what the image's brightness changes along it beside its length: so the sides meet
//! where the image has its edge, and where it has none, halfway. Ways are found by raster scans, there and back (Criminisi, Sharp, Blake: GeoS: Geodesic Image
//! Segmentation, ECCV 2008).

use super::outline::Sample;

/// What a change of brightness by all that there is costs, samples: 2 grey levels of 255, which are noise, cost as much as one sample of way. Chosen.
const CHANGE: f32 = 128.0;
/// So far from its border a side is sure, samples of 4 px. Chosen above the 10 px that somebody near walks in the 15 ms between depth and image (1.4
/// m/s at 1 m; Bohannon 1997).
const BAND: f32 = 4.0;
/// Cost of a side that depth names at its very border, and what a sample of way into it takes off: little enough to be overruled by the image, and
/// enough for an arm that is nowhere far from its border. Chosen: at `BAND`, 12 of 30 are left.
const DOUBT: [f32; 2] = [30.0, 6.0];
/// The middle of a thing is so far from its border, samples, at least; what has none is torn or a few pixels wide. Chosen: half of `BAND`.
const NARROW: f32 = 2.0;
/// Where there is no depth, ways that cost more lead nowhere, samples, chosen: a hole that is wider than a shadow belongs to nobody.
const FAR: f32 = 40.0;
/// Scans there and back, chosen: ways that turn more often are rare.
const SCANS: usize = 2;
/// Weight of a sample without depth, beside 1 of the others, chosen: three guesses count less than one that is measured.
const GUESS: f32 = 0.3;
/// Length of a way over a corner, samples: the diagonal of a square.
const DIAGONAL: f32 = std::f32::consts::SQRT_2;

/// The cheapest way from a sample to one whose side is sure, and which side that is.
#[derive(Clone, Copy)]
struct Way {
    cost: f32,
    inside: bool,
}

/// Settles the samples, in rows of `width`, given each one's brightness and the weight of one whose depth is known everywhere.
pub(super) fn settle(samples: &mut [Sample], brightness: &[f32], width: usize, whole: f32) {
    let is_known = |s: &Sample| s.weight >= 0.5 * whole;
    let is_inside = |s: &Sample| is_known(s) && s.inside > 0.5 * s.weight;
    // How far each sample is from what is inside, and from what is not.
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
    // The middle of what is narrow is sure, too, and no nearer to the border than other sides are: else nothing would be left of it where the image has no edge.
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
        // What is as depth says keeps its share.
        if !known || way.inside != is_inside(sample) {
            let inside = way.inside && (known || way.cost <= FAR);
            sample.weight = if known { whole } else { GUESS * whole };
            sample.inside = if inside { sample.weight } else { 0.0 };
        }
    }
}

/// Calls `step` with every value that is not `settled` and each of its neighbours, the length of the way between, and the places of both: once there, with
/// those before it, and once back, with those behind it.
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
        // Before it, or behind it in the same order, mirrored.
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
