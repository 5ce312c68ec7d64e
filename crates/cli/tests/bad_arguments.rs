//! Every kind of bad argument gets a message with the expectation and the finding, and exit code 2.

use crate::common::case::Case;
use crate::common::{check, program, stillpoint};
use std::path::Path;

#[test]
fn configuration_errors_are_reported() {
    let case = Case::new();
    case.fails(
        &["--set", "tracking.min_inlier=20"],
        &[
            "--set tracking.min_inlier=20",
            "did you mean \"tracking.min_inliers\"",
        ],
    );
    let file = case.dir.path().join("my.toml");
    std::fs::write(&file, "seed = 1\n\n[traking]\nmin_inliers = 20\n").unwrap();
    let file = file.to_str().unwrap();
    case.fails(
        &["--config", file],
        &["my.toml:4", "\"tracking.min_inliers\""],
    );
    case.fails(&["--config", "/no/such.toml"], &["/no/such.toml"]);
    // All values out of range are reported at once.
    case.fails(
        &[
            "--set",
            "tracking.min_inliers=1",
            "--set",
            "features.features=99",
        ],
        &["tracking.min_inliers", "features.features"],
    );
}

#[test]
fn invalid_arguments_are_reported() {
    let case = Case::new();
    case.fails(
        &["--detector", "yolo"],
        &["--detector", "\"yolo\"", "FILE.onnx"],
    );
    case.fails(&["--start", "12"], &["start 12"]);
    check(&case.run(&["--max-frames", "0"]), 2, &["--max-frames"]);
    check(&case.run(&["--seed", "-1"]), 2, &[]);
    check(&stillpoint(["fly"]), 2, &["fly"]);
    check(
        &stillpoint(["simulate", "--scene", "xzy", "--out", "/tmp/never"]),
        2,
        &["\"xyz\"?"],
    );
    let output = program()
        .env("STILLPOINT_SIMD", "fast")
        .arg("run")
        .arg(case.room())
        .output()
        .unwrap();
    check(&output, 2, &["STILLPOINT_SIMD", "scalar"]);
    let output = program()
        .env("STILLPOINT_WORKERS", "0")
        .arg("run")
        .arg(case.room())
        .output()
        .unwrap();
    check(&output, 2, &["STILLPOINT_WORKERS", "1 to 64", "\"0\""]);
}

#[test]
fn unusable_detectors_are_reported() {
    let case = Case::new();
    let file = |name: &str, text: &str| {
        let path = case.dir.path().join(name);
        std::fs::write(&path, text).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let script = |name: &str, text: &str| format!("scripted:{}", file(name, text));
    let header = "timestamp,class,score,x0,y0,x1,y1";
    for (detector, parts) in [
        (
            "/no/such/model.onnx".to_owned(),
            &["/no/such/model.onnx", "check the path"][..],
        ),
        (file("bad.onnx", "no model"), &["bad.onnx", "ONNX model"]),
        ("/no/such.csv".to_owned(), &["scripted:/no/such.csv?"]),
        (
            "scripted:/no/such.csv".to_owned(),
            &["--detector scripted:/no/such.csv: ", "script of detections"],
        ),
        (
            script("a.csv", "0.0,person,0.9,10,10\n"),
            &["a.csv:1", header, "5 in"],
        ),
        (
            script("b.csv", &format!("{header}\n0.0,persn,0.9,10,10,90,90\n")),
            &["b.csv:2", "such as \"person\""],
        ),
        // A script of another recording would silently have no effect.
        (
            script("c.csv", "1305031102.175304,person,0.9,10,10,90,90\n"),
            &[
                "c.csv",
                "none of its 1 rows",
                "12 frames",
                "belongs to this recording",
            ],
        ),
    ] {
        case.fails(&["--detector", &detector], parts);
    }
    // A script without any detection is valid, but gives a message.
    let empty = script("empty.csv", header);
    let output = case.run(&["--detector", &empty]);
    check(&output, 0, &["warning: ", "empty.csv", "no detections"]);
}

#[test]
fn eval_errors_are_reported() {
    let case = Case::new();
    let truth = case.room().join("groundtruth.txt");
    let late = case.dir.path().join("late.txt");
    std::fs::write(
        &late,
        "1000 0 0 0 0 0 0 1\n1001 1 0 0 0 0 0 1\n1002 1 1 0 0 0 0 1\n",
    )
    .unwrap();
    let eval = |estimate: &Path, more: &[&str]| {
        program()
            .arg("eval")
            .arg(&truth)
            .arg(estimate)
            .args(more)
            .output()
            .unwrap()
    };
    check(
        &eval(&late, &[]),
        2,
        &["late.txt", "no overlap in time", "1000.000"],
    );
    check(&eval(Path::new("/no/such.txt"), &[]), 2, &["/no/such.txt"]);
    check(&eval(&truth, &["--delta", "3"]), 2, &["30f"]);
    check(
        &eval(&truth, &["--plot", "a.jpg"]),
        2,
        &["a.jpg", ".svg or .png"],
    );
    check(
        &eval(&truth, &["--plot", "/no/such/a.svg"]),
        2,
        &["/no/such/a.svg"],
    );
    let empty = case.dir.path().join("empty.txt");
    std::fs::write(&empty, "# nothing\n").unwrap();
    check(&eval(&empty, &[]), 2, &["the estimate holds no pose"]);
    std::fs::write(&late, "1 0 0 0 0 0 0 1\n1 0 0 0 0 0 0 1\n").unwrap();
    check(&eval(&late, &[]), 2, &["late.txt:2", "repeats"]);
    check(&eval(&truth, &[]), 0, &[]);
}

#[test]
fn simulate_refuses_a_non_empty_folder() {
    let case = Case::new();
    let room = case.room();
    let args = [
        "simulate",
        "--scene",
        "xyz",
        "--frames",
        "1",
        "--out",
        room.to_str().unwrap(),
    ];
    check(&stillpoint(args), 2, &["room", "new or empty folder"]);
}
