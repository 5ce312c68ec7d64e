//! Checks the stamps.
//!
//! Answers: the frame rate, the number of missing frames, and where stamps decrease, repeat or jump.

use crate::finding::{Figure, Finding, Report, Symptom};
use crate::median::median;

/// A step of more than this many intervals, and of more than this many seconds, is a jump.
const JUMP: f64 = 10.0;
const JUMP_S: f64 = 1.0;
/// A step of more than this many intervals means missing frames.
const GAP: f64 = 1.7;
/// Fraction of missing frames from which tracking suffers: fast motion then sometimes doubles between frames.
const MISSING: f64 = 0.15;
/// Minimum duration to judge missing frames, s: one pause of a driver is as large a fraction of half a second.
const LONG_ENOUGH: f64 = 1.0;
/// Minimum number of frames to judge.
const MIN_FRAMES: usize = 10;

pub(crate) fn judge(stamps: &[f64], report: &mut Report) {
    if stamps.len() < MIN_FRAMES {
        report.pass_over("stamps and dropped frames: there are too few frames");
        return;
    }
    let steps: Vec<f64> = stamps.windows(2).map(|w| w[1] - w[0]).collect();
    let mut forward: Vec<f64> = steps.iter().copied().filter(|s| *s > 0.0).collect();
    let interval = median(&mut forward).unwrap_or(0.0);
    let backwards = steps.iter().filter(|s| **s <= 0.0).count();
    let is_jump = |s: &f64| *s > JUMP_S && *s > JUMP * interval;
    let jumps = steps.iter().filter(|s| is_jump(s)).count();
    if interval > 0.0 {
        report.measure(Figure::new("frames per second", 1.0 / interval, "1/s"));
    }
    if backwards + jumps > 0 {
        let mut sizes = steps.iter().filter(|s| is_jump(s) || **s <= 0.0);
        let first = sizes.next().copied().unwrap_or(0.0);
        report.find(Finding {
            symptom: Symptom::Stamps,
            message: format!("stamps jump {} times, first by {first:.3} s", backwards + jumps),
            remedy: "use the device's stamps, or let no other clock set the recording computer's while it records; cut the recording there: stillpoint recording cut".into(),
            evidence: vec![
                Figure::new("steps backwards or of nothing", backwards as f64, ""),
                Figure::new("jumps ahead", jumps as f64, ""),
            ],
        });
    }
    let left_out = |s: &f64| {
        let gap = s / interval;
        if gap > GAP && !is_jump(s) {
            libm::round(gap) - 1.0
        } else {
            0.0
        }
    };
    let missing: f64 = steps.iter().map(left_out).sum();
    let share = missing / (missing + stamps.len() as f64);
    report.measure(Figure::new("share of frames missing", share, ""));
    let seconds = stamps[stamps.len() - 1] - stamps[0];
    if share > MISSING && seconds < LONG_ENOUGH {
        report.pass_over(format!(
            "dropped frames: only {seconds:.1} s were looked at"
        ));
    } else if share > MISSING {
        report.find(Finding {
            symptom: Symptom::DroppedFrames,
            message: format!("{:.0} % of the frames are missing", 100.0 * share),
            remedy: "record on a faster disk or uncompressed, through USB 3, or at a lower rate that is kept; where stamps of colour and depth differ, allow more: the pairing leaves out what has no partner".into(),
            evidence: vec![Figure::new("share of frames missing", share, "")],
        });
    }
}

/// Judges the points at which the clock of the images was set back: by how much, s, and at which image in the order of writing, from 0.
pub fn judge_clock(set_back: impl IntoIterator<Item = (usize, f64)>, report: &mut Report) {
    let all: Vec<(usize, f64)> = set_back.into_iter().collect();
    let Some((index, by)) = all.first() else {
        return;
    };
    let again = match all.len() - 1 {
        0 => String::new(),
        n => format!(", and {n} times more"),
    };
    let finding = Finding {
        symptom: Symptom::Stamps,
        message: format!(
            "the clock was set back while this was recorded: stamps go back by {by:.3} s at image {}{again}",
            index + 1
        ),
        remedy: "use the device's stamps, or let no other clock set the recording computer's while it records; images are taken in the order in which they were written, and later stamps go on from there".into(),
        evidence: vec![Figure::new("stamps go back by", *by, "s")],
    };
    report.findings.push(finding);
    report.findings.sort_by_key(|f| f.symptom);
}

#[cfg(test)]
mod tests {
    use super::*;

    fn findings(stamps: &[f64]) -> Vec<Symptom> {
        let mut report = Report::default();
        judge(stamps, &mut report);
        report.findings.iter().map(|f| f.symptom).collect()
    }

    #[test]
    fn steady_clock_passes_and_jumps_and_gaps_are_reported() {
        let steady: Vec<f64> = (0..60).map(|i| f64::from(i) / 30.0).collect();
        assert_eq!(findings(&steady), []);
        let mut back = steady.clone();
        back[30] -= 0.1;
        assert_eq!(findings(&back), [Symptom::Stamps]);
        let jumped: Vec<f64> = steady
            .iter()
            .map(|t| t + if *t > 1.0 { 5.0 } else { 0.0 })
            .collect();
        assert_eq!(findings(&jumped), [Symptom::Stamps]);
        let mut gaps = steady.clone();
        let mut k = 0;
        gaps.retain(|_| {
            k += 1;
            k % 4 != 0
        });
        assert_eq!(findings(&gaps), [Symptom::DroppedFrames]);
        // Half a second is too short to judge.
        assert_eq!(findings(&gaps[..15]), []);
        // One in twenty does no harm.
        let mut few = steady;
        few.remove(20);
        few.remove(40);
        assert_eq!(findings(&few), []);
    }
}
