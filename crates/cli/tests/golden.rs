//! Compares help and configuration output with files. After an intended change, renew them by `STILLPOINT_BLESS=1 cargo test -p
//! stillpoint-cli --test all golden`, after those of the test `config_docs`.

use crate::common::{check, stdout, stillpoint};
use std::path::Path;

fn golden(name: &str, args: &[&str]) {
    let output = stillpoint(args);
    check(&output, 0, &[]);
    let path = Path::new(env!("CARGO_MANIFEST_DIR"))
        .join("tests/golden")
        .join(name);
    let found = stdout(&output);
    if std::env::var_os("STILLPOINT_BLESS").is_some() {
        std::fs::write(&path, &found).unwrap();
    }
    let expected = std::fs::read_to_string(&path).unwrap_or_default();
    assert_eq!(
        found, expected,
        "{name} differs; if that is intended, renew it: STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --test all golden"
    );
}

#[test]
fn help_matches_the_golden_files() {
    golden("help.txt", &["--help"]);
    for command in [
        "demo",
        "run",
        "live",
        "replay",
        "report",
        "render",
        "eval",
        "simulate",
        "batch",
        "bench",
        "detect",
        "doctor",
        "recording",
        "map",
        "models",
        "datasets",
        "config",
        "completions",
        "man",
    ] {
        golden(&format!("help_{command}.txt"), &[command, "--help"]);
    }
    golden("help_config_print.txt", &["config", "print", "--help"]);
    golden("help_live_file.txt", &["live", "file", "--help"]);
    golden("help_live_realsense.txt", &["live", "realsense", "--help"]);
    golden("help_batch_merge.txt", &["batch", "merge", "--help"]);
    for command in ["info", "convert", "cut"] {
        let name = format!("help_recording_{command}.txt");
        golden(&name, &["recording", command, "--help"]);
    }
    for command in [
        "info", "check", "export", "mesh", "grid", "octomap", "merge",
    ] {
        let name = format!("help_map_{command}.txt");
        golden(&name, &["map", command, "--help"]);
    }
    for command in ["list", "pull"] {
        let name = format!("help_datasets_{command}.txt");
        golden(&name, &["datasets", command, "--help"]);
    }
    for command in ["list", "pull", "import", "check"] {
        let name = format!("help_models_{command}.txt");
        golden(&name, &["models", command, "--help"]);
    }
}

#[test]
fn every_help_has_examples() {
    for args in [
        &["--help"][..],
        &["demo", "--help"],
        &["run", "--help"],
        &["live", "--help"],
        &["live", "file", "--help"],
        &["live", "realsense", "--help"],
        &["replay", "--help"],
        &["report", "--help"],
        &["render", "--help"],
        &["eval", "--help"],
        &["simulate", "--help"],
        &["bench", "--help"],
        &["detect", "--help"],
        &["doctor", "--help"],
        &["recording", "--help"],
        &["recording", "info", "--help"],
        &["recording", "convert", "--help"],
        &["recording", "cut", "--help"],
        &["map", "--help"],
        &["map", "info", "--help"],
        &["map", "check", "--help"],
        &["map", "export", "--help"],
        &["map", "merge", "--help"],
        &["models", "--help"],
        &["models", "list", "--help"],
        &["models", "pull", "--help"],
        &["models", "import", "--help"],
        &["models", "check", "--help"],
        &["datasets", "--help"],
        &["datasets", "list", "--help"],
        &["datasets", "pull", "--help"],
        &["config", "--help"],
        &["config", "print", "--help"],
        &["completions", "--help"],
        &["man", "--help"],
    ] {
        let text = stdout(&stillpoint(args));
        assert!(
            text.contains("Examples:\n  stillpoint "),
            "{args:?}: {text}"
        );
    }
}

#[test]
fn printed_configuration_matches_the_golden_files() {
    golden("config_print.txt", &["config", "print"]);
    golden(
        "config_print_set.txt",
        &[
            "config",
            "print",
            "--set",
            "sensor.max_depth=6",
            "--seed",
            "7",
        ],
    );
}
