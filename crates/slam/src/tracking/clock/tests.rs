use super::*;
use proptest::prelude::*;

const PERIOD: f64 = 1.0 / 30.0;

/// Stamps after USB polling: steady exposures arrive at the next multiple of 4 ms, with varying delay.
fn stamped(n: usize) -> f64 {
    let taken = 10.0 + PERIOD * n as f64;
    (taken / 0.004).ceil() * 0.004 + [0.0, 0.004, 0.0, 0.0, 0.006][n % 5]
}

fn times(stamps: &[f64]) -> Vec<f64> {
    let mut clock = SensorClock::default();
    stamps.iter().map(|s| clock.take(*s)).collect()
}

fn worst_gap(times: &[f64]) -> f64 {
    let gaps = times.windows(2).map(|w| (w[1] - w[0] - PERIOD).abs());
    gaps.fold(0.0, f64::max)
}

#[test]
fn jittered_stamps_are_regularised_to_the_frame_rate() {
    let stamps: Vec<f64> = (0..120).map(stamped).collect();
    let found = times(&stamps);
    assert!(worst_gap(&stamps) > 0.006);
    assert!(
        worst_gap(&found[40..]) < 0.001,
        "{}",
        worst_gap(&found[40..])
    );
    // Better than the stamps from the first line on.
    assert!(worst_gap(&found[8..]) < 0.5 * worst_gap(&stamps));
    for (time, stamp) in found.iter().zip(&stamps) {
        assert!((time - stamp).abs() < 0.01);
    }
}

#[test]
fn missing_frames_leave_gaps_of_whole_periods() {
    let kept: Vec<usize> = (0..120).filter(|n| n % 7 != 3 && n % 11 != 5).collect();
    let stamps: Vec<f64> = kept.iter().map(|n| stamped(*n)).collect();
    let found = times(&stamps);
    for i in 41..kept.len() {
        let expected = PERIOD * (kept[i] - kept[i - 1]) as f64;
        let off = (found[i] - found[i - 1] - expected).abs();
        assert!(off < 0.0015, "{i}: {off}");
    }
}

#[test]
fn regular_stamps_are_unchanged() {
    for rate in [10.0, 15.0, 29.97, 60.0] {
        let stamps: Vec<f64> = (0..100).map(|n| 1e9 + f64::from(n) / rate).collect();
        assert_eq!(times(&stamps), stamps);
    }
}

#[test]
fn irregular_frame_times_are_unchanged() {
    let stamps: Vec<f64> = (0..100)
        .map(|n| f64::from(n) * 0.05 + 0.02 * libm::sin(1.7 * f64::from(n)))
        .collect();
    let found = times(&stamps);
    let same = found.iter().zip(&stamps).filter(|(a, b)| a == b).count();
    assert!(same > 90, "{same}");
}

#[test]
fn clock_jump_or_rate_change_restarts_the_fit() {
    let mut stamps: Vec<f64> = (0..60).map(stamped).collect();
    stamps.extend((0..60).map(|n| stamped(n) - 5.0));
    let found = times(&stamps);
    assert_eq!(found[60], stamps[60]);
    assert!(worst_gap(&found[105..]) < 0.0015);
    let mut slower: Vec<f64> = (0..60).map(stamped).collect();
    let start = slower[59];
    slower.extend((1..120).map(|n| start + 0.05 * f64::from(n)));
    let found = times(&slower);
    for i in 110..slower.len() {
        assert!((found[i] - slower[i]).abs() < 0.002, "{i}");
    }
}

#[test]
fn mirrored_clock_keeps_the_fit() {
    let mut clock = SensorClock::default();
    let there: Vec<f64> = (0..60).map(|n| clock.take(stamped(n))).collect();
    let pivot = stamped(59);
    let mut mirrored = clock.mirrored(pivot);
    let back: Vec<f64> = (0..30)
        .map(|n| mirrored.take(2.0 * pivot - stamped(59 - n)))
        .collect();
    assert!(worst_gap(&back) < 2e-4);
    assert!((2.0 * pivot - back[0] - there[59]).abs() < 1e-9);
}

proptest! {
    /// For any stamps, times are finite and near them.
    #[test]
    fn corrected_times_stay_near_their_stamps(gaps in prop::collection::vec(-0.2..0.2f64, 1..80)) {
        let mut at = 100.0;
        let stamps: Vec<f64> = gaps.iter().map(|g| { at += g; at }).collect();
        for (time, stamp) in times(&stamps).iter().zip(&stamps) {
            prop_assert!((time - stamp).abs() < 0.5, "{time} {stamp}");
        }
    }
}
