//! Restores the order of stamps where a clock was set back during a recording.
//!
//! Decides whether a stamp older than its predecessor came late and belongs between earlier ones, or was made after the clock was set back.
//! Late stamps fill a gap between earlier ones; after a clock was set back, stamps fall among existing ones. Sorting would interleave two
//! times, so the order of writing is kept, and later stamps are shifted to continue.

use std::collections::BTreeSet;

/// Maximum backward step of a late stamp, in usual steps; it is sorted in. Two images written in the wrong order by two threads are one
/// step apart.
const MOMENT: f64 = 1.5;
/// Minimum number of consecutive backward stamps after a clock was set back: a single one may be late.
const ROW: usize = 2;
/// Maximum number of such places; a list with more is unordered, and is sorted: NTP sets a clock at most some times in a recording.
const MOST: usize = 10;
/// Maximum gap, in usual steps, between two parts of a list that were written in the wrong order; some images may be missing between them.
const SEAM: f64 = 5.0;
/// Maximum step of the writer's clock that counts as the time between two images, s: a longer one means that the writer's clock was set, or
/// the recording was paused.
const LONGEST_STEP: f64 = 10.0;
/// Maximum difference of the backward steps of two streams of one clock, as a share of the step, plus some usual steps: each lacks up to a
/// step on either side of that moment, and images may be missing there.
const ALIKE: f64 = 0.5;
const ALIKE_STEPS: f64 = 3.0;

/// A place at which a clock was set back.
#[derive(Clone, Copy, Debug, PartialEq)]
pub struct SetBack {
    /// Index of the first stamp after it, in the order of writing.
    pub index: usize,
    /// Backward step relative to the newest previous stamp, s.
    pub by: f64,
    /// Offset added to the stamps from there on, besides earlier offsets, s.
    pub added: f64,
}

/// Stamps in a playable order.
#[derive(Clone, Debug, Default, PartialEq)]
pub struct Mended {
    /// Ascending unique stamps, s, each with its index in the order of writing.
    pub stamps: Vec<(f64, usize)>,
    /// Number of repeated stamps, which are left out.
    pub repeats: usize,
    /// Number of late stamps, which were sorted in.
    pub late: usize,
    /// Where the clock was set back.
    pub set_back: Vec<SetBack>,
}

impl Mended {
    /// Message about a place at which the clock was set back, described by `place`.
    #[must_use]
    pub fn remark(at: &SetBack, place: &str) -> String {
        format!(
            "{place}: stamps go back by {:.3} s, as the clock was set back; the order of writing is kept, and stamps from there on are {:.3} s later",
            at.by, at.added
        )
    }
}

/// Brings stamps (s, in the order of writing) into a playable order. `step` is the time between a stamp and its predecessor by another
/// clock, if there is one; `like` are the places where another stream of the same clock was set back.
#[must_use]
pub fn mend(stamps: &[f64], step: impl Fn(usize) -> Option<f64>, like: &[SetBack]) -> Mended {
    let own = places(stamps, &step);
    let usual = usual_step(stamps);
    let alike = own.len() == like.len()
        && own
            .iter()
            .zip(like)
            .all(|(a, b)| (a.added - b.added).abs() < ALIKE * b.by + ALIKE_STEPS * usual);
    let set_back: Vec<SetBack> = own
        .iter()
        .enumerate()
        .map(|(k, at)| SetBack {
            added: if alike { like[k].added } else { at.added },
            ..*at
        })
        .collect();
    let mut next = set_back.iter().peekable();
    let mut added = 0.0;
    let mut mended: Vec<(f64, usize)> = Vec::with_capacity(stamps.len());
    for (i, stamp) in stamps.iter().enumerate() {
        if let Some(at) = next.next_if(|at| at.index == i) {
            added += at.added;
        }
        mended.push((stamp + added, i));
    }
    let late = mended.windows(2).filter(|w| w[1].0 < w[0].0).count();
    mended.sort_by(|a, b| a.0.total_cmp(&b.0));
    mended.dedup_by(|a, b| a.0 == b.0);
    Mended {
        repeats: stamps.len() - mended.len(),
        stamps: mended,
        late,
        set_back,
    }
}

/// The places at which a clock was set back; none for an unordered list.
fn places(stamps: &[f64], step: &impl Fn(usize) -> Option<f64>) -> Vec<SetBack> {
    let usual = usual_step(stamps);
    let mut found: Vec<SetBack> = Vec::new();
    let Some(&first) = stamps.first().filter(|_| usual > 0.0) else {
        return found;
    };
    // Previous stamps including their offsets, ns.
    let mut before = BTreeSet::from([nanoseconds(first)]);
    let (mut newest, mut added) = (first, 0.0);
    // Stamps before this index were judged together with their run.
    let mut judged = 0;
    for (i, raw) in stamps.iter().enumerate().skip(1) {
        let stamp = raw + added;
        if i >= judged && newest - stamp > MOMENT * usual {
            let row = stamps[i..].iter().map(|t| t + added);
            let row: Vec<f64> = row.take_while(|t| *t <= newest).collect();
            judged = i + row.len();
            if falls_among(&row, &before, usual) {
                let ahead = step(i).filter(|s| *s > 0.0 && *s < LONGEST_STEP);
                let more = newest + ahead.unwrap_or(usual) - stamp;
                found.push(SetBack {
                    index: i,
                    by: newest - stamp,
                    added: more,
                });
                if found.len() > MOST {
                    return Vec::new();
                }
                added += more;
                judged = i;
            }
        }
        let stamp = raw + added;
        newest = newest.max(stamp);
        before.insert(nanoseconds(stamp));
    }
    found
}

/// Whether a run of backward stamps falls among earlier ones, or precedes all of them, and fills no gap.
fn falls_among(row: &[f64], before: &BTreeSet<i64>, usual: f64) -> bool {
    let fold = |of: fn(f64, f64) -> f64| row.iter().copied().reduce(of).unwrap_or(0.0);
    let (low, high) = (nanoseconds(fold(f64::min)), nanoseconds(fold(f64::max)));
    if row.len() < ROW {
        return false;
    }
    let among = before.range(low..=high).take(row.len()).count();
    if 2 * among >= row.len() {
        return true;
    }
    let first = before.first().copied().unwrap_or(high);
    high < first && (first - high) as f64 > SEAM * usual * 1e9
}

fn nanoseconds(stamp: f64) -> i64 {
    (stamp * 1e9) as i64
}

/// The median forward step, s; 0 if there is none.
fn usual_step(stamps: &[f64]) -> f64 {
    let steps = stamps.iter().zip(stamps.iter().skip(1));
    let mut steps: Vec<f64> = steps.map(|(a, b)| b - a).filter(|s| *s > 0.0).collect();
    if steps.is_empty() {
        return 0.0;
    }
    let middle = steps.len() / 2;
    *steps.select_nth_unstable_by(middle, f64::total_cmp).1
}

#[cfg(test)]
mod tests {
    use super::*;
    use proptest::prelude::*;

    const RATE: f64 = 30.0;

    fn steady(count: usize) -> Vec<f64> {
        (0..count).map(|i| 100.0 + i as f64 / RATE).collect()
    }

    fn mended(stamps: &[f64]) -> Mended {
        mend(stamps, |_| None, &[])
    }

    fn order(m: &Mended) -> Vec<usize> {
        m.stamps.iter().map(|s| s.1).collect()
    }

    #[test]
    fn order_is_kept_after_a_backward_clock_jump() {
        for by in [0.1, 0.5, 1.7, 3600.0] {
            let mut stamps = steady(90);
            stamps[40..].iter_mut().for_each(|t| *t -= by);
            let m = mended(&stamps);
            assert_eq!(order(&m), (0..90).collect::<Vec<_>>(), "{by}");
            let [at] = m.set_back[..] else {
                panic!("{by}: {:?}", m.set_back);
            };
            assert_eq!(at.index, 40);
            assert!((at.by - (by - 1.0 / RATE)).abs() < 1e-6, "{by}: {}", at.by);
            for (k, (stamp, _)) in m.stamps.iter().enumerate() {
                assert!((stamp - (100.0 + k as f64 / RATE)).abs() < 1e-6);
            }
        }
        // Twice, once over the first part, and at the very end.
        let mut stamps = steady(90);
        stamps[30..].iter_mut().for_each(|t| *t -= 0.4);
        stamps[60..].iter_mut().for_each(|t| *t -= 100.0);
        stamps[88..].iter_mut().for_each(|t| *t -= 0.7);
        let m = mended(&stamps);
        let places: Vec<usize> = m.set_back.iter().map(|s| s.index).collect();
        assert_eq!(places, [30, 60, 88]);
        assert_eq!(order(&m), (0..90).collect::<Vec<_>>());
    }

    #[test]
    fn late_stamps_are_sorted_into_place() {
        let mut swapped = steady(60);
        swapped.swap(10, 11);
        swapped.swap(20, 22);
        let mut late = steady(60);
        let one = late.remove(12);
        late.insert(40, one);
        let mut burst = steady(60);
        let held: Vec<f64> = burst.drain(10..25).collect();
        burst.splice(30..30, held);
        let mut parts = steady(60);
        parts.rotate_left(35);
        // Like sorted file names without leading zeros.
        let mut names: Vec<usize> = (0..60).collect();
        names.sort_by_key(usize::to_string);
        let by_name: Vec<f64> = names.iter().map(|i| steady(60)[*i]).collect();
        for stamps in [swapped, late, burst, parts, by_name] {
            let m = mended(&stamps);
            assert!(m.set_back.is_empty() && m.late > 0, "{:?}", m.set_back);
            let found: Vec<f64> = m.stamps.iter().map(|s| s.0).collect();
            assert_eq!(found, steady(60));
        }
    }

    #[test]
    fn repeats_are_dropped_and_another_clock_gives_the_step() {
        let m = mended(&[1.0, 1.1, 1.1, 1.2]);
        assert_eq!((m.repeats, order(&m)), (1, vec![0, 1, 3]));
        let mut stamps = steady(40);
        stamps[20..].iter_mut().for_each(|t| *t -= 0.5);
        let m = mend(&stamps, |i| Some(if i == 20 { 0.2 } else { 0.0 }), &[]);
        let step = m.stamps[20].0 - m.stamps[19].0;
        assert!((step - 0.2).abs() < 1e-9, "{step}");
        // The other stream continues with the same offset.
        let depth: Vec<f64> = stamps.iter().map(|t| t + 0.004).collect();
        let like = mend(&depth, |_| None, &m.set_back);
        assert_eq!(like.set_back[0].added, m.set_back[0].added);
    }

    proptest! {
        #[test]
        fn stamps_increase_and_none_is_lost(steps in proptest::collection::vec(-2.0..2.0f64, 0..80)) {
            let mut t = 0.0;
            let stamps: Vec<f64> = steps.iter().map(|s| { t += s; t }).collect();
            let m = mended(&stamps);
            prop_assert!(m.stamps.windows(2).all(|w| w[0].0 < w[1].0));
            prop_assert_eq!(m.stamps.len() + m.repeats, stamps.len());
        }

        #[test]
        fn ordered_stamps_are_unchanged(steps in proptest::collection::vec(1e-3..2.0f64, 0..80)) {
            let mut t = 1.3e9;
            let stamps: Vec<f64> = steps.iter().map(|s| { t += s; t }).collect();
            let m = mended(&stamps);
            let found: Vec<f64> = m.stamps.iter().map(|s| s.0).collect();
            prop_assert_eq!(found, stamps);
        }
    }
}
