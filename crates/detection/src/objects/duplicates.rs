//! Duplicate tracks of one object: prevention and merging.

use super::common::{LOOKS, SAME_BOX};
use super::expected::Expected;
use super::kind::may_be_one;
use super::measurement::Measurement;
use super::track::Track;
use super::view::View;
use crate::{BoundingBox, ClassId};

/// Minimum share of a box inside another to be a part of it (section 14 of docs/algorithm.md).
const INSIDE: f64 = 0.85;
/// Maximum depth difference of surfaces of one body, m: half the depth of a body with its arms. Measured: 0.4 exchanges
/// simulated people, IDF1 is 0.05 less.
pub(super) const SAME_DEPTH: f64 = 0.25;

/// Whether the smaller of two boxes has the shape of a part of the larger. Networks cut people horizontally: head and
/// shoulders, or legs, keep more of the width than of the height. A box that keeps more of the height is another
/// person, partly hidden by the one in front.
fn cut_across(a: &BoundingBox, b: &BoundingBox) -> bool {
    let (part, whole) = if a.area() < b.area() { (a, b) } else { (b, a) };
    part.width() * whole.height() >= part.height() * whole.width()
}

pub(super) fn overlap(a: &BoundingBox, b: &BoundingBox) -> f64 {
    let iou = a.iou(b);
    let common = iou * (a.area() + b.area()) / (1.0 + iou);
    let least = a.area().min(b.area());
    if least > 0.0 { common / least } else { 0.0 }
}

/// Whether a detection is a part of one already assigned to a track: the upper half of a person beside the whole, or a
/// thing on a person at the same depth (networks call legs a cake). Its area is masked already.
pub(super) fn part_of_another(m: &Measurement, all: &[Measurement], taken: &[bool]) -> bool {
    all.iter().zip(taken).any(|(other, taken)| {
        let same = match (m.modes.first(), other.modes.first()) {
            (Some(a), Some(b)) => (a.depth - b.depth).abs() <= SAME_DEPTH,
            _ => false,
        };
        let (own, whole) = (&m.detection, &other.detection);
        let on_person = whole.class == ClassId::PERSON && own.class != ClassId::PERSON;
        let of_kind = own.class == whole.class && cut_across(&own.bounds, &whole.bounds);
        *taken
            && same
            && (on_person || of_kind)
            && own.bounds.area() <= whole.bounds.area()
            && overlap(&own.bounds, &whole.bounds) >= INSIDE
    })
}

/// Removes detections of the same object with another class: of nearly equal boxes of different classes the one of the
/// highest score stays.
pub(super) fn one_name_each(mut all: Vec<Measurement>) -> Vec<Measurement> {
    all.sort_by(|a, b| b.detection.score.total_cmp(&a.detection.score));
    let mut kept: Vec<Measurement> = Vec::with_capacity(all.len());
    for m in all {
        let d = &m.detection;
        let named = |k: &Measurement| {
            let other = &k.detection;
            other.class != d.class
                && may_be_one(other.class, d.class)
                && other.bounds.iou(&d.bounds) >= SAME_BOX
        };
        if !kept.iter().any(named) {
            kept.push(m);
        }
    }
    kept
}

/// Whether two tracks are on the same object at present.
fn same((a, at_a): (&Track, &Expected), (b, at_b): (&Track, &Expected)) -> bool {
    if !may_be_one(a.class, b.class) {
        return false;
    }
    let same_class = a.class == b.class;
    let (box_a, box_b) = (at_a.bounds, at_b.bounds);
    match (at_a.depth(), at_b.depth()) {
        // A cup is inside the box of a table: tracks of different classes are equal only if their boxes are.
        (Some(x), Some(y)) if same_class => {
            // Two detections of one frame are two people unless they have the shape of a whole and its part.
            let two = a.misses == 0 && b.misses == 0 && !cut_across(&box_a, &box_b);
            !two && (x - y).abs() <= SAME_DEPTH && overlap(&box_a, &box_b) >= INSIDE
        }
        (Some(x), Some(y)) => (x - y).abs() <= SAME_DEPTH && box_a.iou(&box_b) >= SAME_BOX,
        _ => (a.misses > 0) != (b.misses > 0) && box_a.iou(&box_b) >= SAME_BOX,
    }
}

/// Merges tracks that have been on the same object for some updates. The older keeps its id; the state is that of the
/// one detected more recently, or of the larger. Returns the merged tracks, which may separate again: two people, one
/// in front of the other.
pub(super) fn merge(tracks: &mut Vec<Track>, view: &View) -> Vec<Track> {
    // Confirmed tracks count as older than tentative ones.
    let mut order: Vec<usize> = (0..tracks.len()).collect();
    order.sort_by_key(|&i| (!tracks[i].confirmed(), tracks[i].id));
    let mut gone = vec![false; tracks.len()];
    let mut expected: Vec<Expected> = tracks.iter().map(|t| t.expected(view)).collect();
    for n in 0..order.len() {
        let young = order[n];
        let elder = order[..n].iter().copied().find(|&i| {
            let of = |i: usize| (&tracks[i], &expected[i]);
            !gone[i] && same(of(i), of(young))
        });
        let Some(elder) = elder else {
            tracks[young].duplicate = 0;
            continue;
        };
        tracks[young].duplicate += 1;
        if tracks[young].duplicate < LOOKS {
            continue;
        }
        gone[young] = true;
        let other = tracks[young].clone();
        let kept = &mut tracks[elder];
        let larger = expected[young].bounds.area() > expected[elder].bounds.area();
        // A track detected once with a low score must not override the other's state.
        let sure = other.confirmed() && !kept.votes.surer_than_those_of(&other.votes);
        if sure && (other.misses < kept.misses || (other.misses == kept.misses && larger)) {
            kept.body = other.body;
            kept.trunk = other.trunk;
            kept.reach = other.reach;
            kept.score = other.score;
            expected[elder] = kept.expected(view);
        }
        kept.misses = kept.misses.min(other.misses);
        kept.last_seen = kept.last_seen.max(other.last_seen);
        kept.hits = kept.hits.saturating_add(other.hits);
        kept.votes.merge(&other.votes);
    }
    let all = std::mem::take(tracks).into_iter().zip(gone);
    let (ended, kept): (Vec<_>, Vec<_>) = all.partition(|(_, gone)| *gone);
    tracks.extend(kept.into_iter().map(|(track, _)| track));
    ended.into_iter().map(|(track, _)| track).collect()
}
