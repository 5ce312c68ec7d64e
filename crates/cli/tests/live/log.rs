//! Logs that do not match, and conflicting options.

use super::PLAYED;
use crate::common::{check, program};
use stillpoint::slam::{LogEntry, RunLog};

#[test]
fn mismatched_log_is_refused() {
    let log = PLAYED.log();
    let changed = |change: &dyn Fn(&mut RunLog)| {
        let mut log = log.clone();
        change(&mut log);
        log.to_text()
    };
    // Only the trajectory's digest differs.
    let other = changed(&|log| log.trajectory ^= 1);
    check(
        &PLAYED.replay(&other, &[]),
        1,
        &["changed.log: expected the trajectory", "another"],
    );
    let late = changed(&|log| {
        for entry in &mut log.entries {
            if let LogEntry::TrackFrame { stamp, .. } = entry {
                *stamp += 0.5;
            }
        }
    });
    check(
        &PLAYED.replay(&late, &[]),
        2,
        &["changed.log: entry 0: expected frame"],
    );
    let text = log.to_text();
    let refused = |text: &str, more: &[&str], part: &str| {
        check(
            &PLAYED.replay(text, more),
            2,
            &["changed.log", "expected", "found", part],
        );
    };
    refused(&text, &["--seed", "9"], "configuration");
    refused(&text, &["--camera", "tum_fr1"], "camera");
    refused(&text[..text.len() / 2], &[], "line ");
    refused(&text.replacen("frame ", "fame ", 1), &[], "line ");
    refused(
        "fx = 525\n",
        &[],
        "line 1: expected \"stillpoint run log 1\"",
    );
    refused(
        &changed(&|log| log.about = "start = true".into()),
        &[],
        "description of the run",
    );
    refused(
        &changed(&|log| log.about = log.about.replacen("min_inliers", "min_inlier", 1)),
        &[],
        "known key",
    );
    let missing = program()
        .args(["replay", "/no/run.log", "room"])
        .output()
        .unwrap();
    check(&missing, 2, &["/no/run.log: expected the log of a run"]);
}

#[test]
fn live_run_options_are_validated() {
    let run = |more: &[&str]| {
        let mut run = program();
        run.arg("run").arg(PLAYED.path("room")).args(more);
        run.output().unwrap()
    };
    check(&run(&["--live=some"]), 2, &["some"]);
    let room = PLAYED.path("room");
    let room = room.to_str().unwrap();
    check(&run(&["--live", "--log", room]), 2, &["another with --log"]);
    check(&run(&["--trace", room]), 2, &["another with --trace"]);
}
