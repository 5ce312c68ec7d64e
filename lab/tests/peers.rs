//! `lab peers` with a fake Python environment: the arguments of peers, their results, and that no run is repeated.

use crate::sweep::scene;
use crate::{lab, program};
use std::os::unix::fs::PermissionsExt;

/// A fake Python interpreter with a peer: returns the ground truth without the first pose, and logs its arguments.
const PEER: &str = r#"#!/bin/sh
echo "$@" >> "$(dirname "$0")/asked.txt"
out=$4
grep -v '^#' "$3/groundtruth.txt" | tail -n +2 > "$out"
echo '{"frames": 90, "median_ms": 12.5, "p95_ms": 20.0, "memory_bytes": 150000000}' > "${out%.txt}.json"
"#;

#[test]
fn peers_run_once_on_the_same_images() {
    let dir = tempfile::tempdir().unwrap();
    let bin = dir.path().join("environment/bin");
    std::fs::create_dir_all(&bin).unwrap();
    std::fs::write(bin.join("python"), PEER).unwrap();
    let all = std::fs::Permissions::from_mode(0o755);
    std::fs::set_permissions(bin.join("python"), all).unwrap();
    let (program, out) = (program(), dir.path().join("out"));
    let environment = dir.path().join("environment");
    let compare = || {
        lab(&[
            "peers",
            scene().to_str().unwrap(),
            "--runs",
            "2",
            "--program",
            program.to_str().unwrap(),
            "--commit",
            "here",
            "--environment",
            environment.to_str().unwrap(),
            "--vocabulary",
            "words.txt",
            "--out",
            out.to_str().unwrap(),
        ])
    };
    let (code, table, said) = compare();
    assert_eq!(code, Some(0), "{table}{said}");
    let row = |table: &str, begin: &str| -> Vec<String> {
        let cells =
            |l: &str| -> Vec<String> { l.split('|').map(|c| c.trim().to_owned()).collect() };
        let mut rows = table.lines().map(cells).filter(|c| c.len() > 2);
        rows.find(|c| c[1] == begin || c[2] == begin).unwrap()
    };
    // The columns of the sweep, then the table of README.
    assert_eq!(row(&table, "orbslam3")[3..5], ["2", "0.0"], "{table}");
    assert_eq!(
        row(&table, "rtabmap")[8],
        "2",
        "a pose of each run is missing: {table}"
    );
    let peer = row(&table, "ORB-SLAM3");
    assert_eq!(
        peer[2..6],
        ["0.0", "12 to 12", "150 MB", "GPL-3.0"],
        "{table}"
    );
    assert_eq!(
        row(&table, "**Stillpoint**")[5],
        "MIT or Apache-2.0",
        "{table}"
    );
    let asked = || std::fs::read_to_string(bin.join("asked.txt")).unwrap();
    let first = asked();
    assert_eq!(first.lines().count(), 4, "{first}");
    let slam: Vec<&str> = first
        .lines()
        .filter(|l| l.contains("orbslam3.py"))
        .collect();
    assert!(
        slam.len() == 2 && slam[0].ends_with("--vocabulary words.txt"),
        "{first}"
    );
    // All runs are in the file already.
    let (code, again, said) = compare();
    assert_eq!((code, asked()), (Some(0), first), "{said}");
    assert_eq!(again, table);
}
