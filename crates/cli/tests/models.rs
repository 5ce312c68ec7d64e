//! `models list|import|check`, with a cache per test.

use crate::common::model_cache::{Cache, checkpoint};
use crate::common::{check, simulate, stderr, stdout, tiny_model};
use std::path::Path;

#[test]
fn empty_cache_is_listed() {
    let cache = Cache::new();
    let output = cache.run(&["models", "list"]);
    check(&output, 0, &[]);
    let text = stdout(&output);
    for part in [
        "yolov7-tiny",
        "GPL-3.0",
        "yolox-nano",
        "3.7 MB",
        "Apache-2.0",
        "no models",
        "without --detector: none",
        "rten (built in)",
        cache.dir.path().to_str().unwrap(),
    ] {
        assert!(text.contains(part), "{text:?} lacks {part:?}");
    }
}

#[test]
fn imported_model_is_used_by_name() {
    let cache = Cache::new();
    check(&cache.import("office"), 0, &["head yolox, 80 classes"]);
    let listed = stdout(&cache.run(&["models", "list"]));
    assert!(listed.contains("office"), "{listed}");
    assert!(listed.contains("without --detector: office"), "{listed}");

    let checked = cache.run(&["models", "check", "office", "--runtime", "rten"]);
    check(&checked, 0, &[]);
    let text = stdout(&checked);
    for part in [
        "[1, 3, 64, 64]",
        "[1, 84, 85]",
        "yolox",
        "80: person, bicycle",
        "rten ",
        "ms on a grey image",
        "[input]",
    ] {
        assert!(text.contains(part), "{text:?} lacks {part:?}");
    }

    // Files that changed since are refused.
    std::fs::write(cache.file("office.onnx"), b"other").unwrap();
    let output = cache.run(&["models", "check", "office"]);
    check(
        &output,
        2,
        &["office.onnx", "expected the model that was installed"],
    );
    let listed = stdout(&cache.run(&["models", "list"]));
    assert!(listed.contains("damaged: office"), "{listed}");
}

#[test]
fn cached_model_is_the_default_detector() {
    let cache = Cache::new();
    check(&cache.import("office"), 0, &[]);
    let dir = tempfile::tempdir().unwrap();
    let (room, out) = (dir.path().join("room"), dir.path().join("out"));
    simulate(&room, "xyz", 3);
    let run = |more: &[&str]| {
        let mut command = cache.program();
        command.arg("run").arg(&room).arg("--out").arg(&out);
        command.args(["--runtime", "rten"]).args(more);
        command.output().unwrap()
    };
    let reported = || -> serde_json::Value {
        let text = std::fs::read(out.join("summary.json")).unwrap();
        serde_json::from_slice::<serde_json::Value>(&text).unwrap()["detector"].clone()
    };
    let output = run(&["-v"]);
    check(&output, 0, &["detector: office (it is in the cache"]);
    assert!(
        stdout(&output).contains("network: head yolox, input 64x64 px, rten "),
        "{}",
        stdout(&output)
    );
    assert_eq!(reported()["name"], "office");
    assert_eq!(reported()["frames"], 3);
    let output = run(&["--detector", "none"]);
    check(&output, 0, &[]);
    assert!(
        !stderr(&output).contains("detector:"),
        "{}",
        stderr(&output)
    );
    assert_eq!(reported()["kind"], "none");
    check(
        &run(&["--detector", "ofice"]),
        2,
        &["did you mean \"office\"?"],
    );

    let report = dir.path().join("bench");
    let mut bench = cache.program();
    bench.arg("bench").arg(&room).args(["--runs", "1", "--out"]);
    let output = bench
        .arg(&report)
        .args(["--runtime", "rten"])
        .output()
        .unwrap();
    check(&output, 0, &["detector: office"]);
    let text = std::fs::read_to_string(report.join("bench.md")).unwrap();
    assert!(
        text.contains("detector office (it is in the cache"),
        "{text}"
    );
    assert!(text.contains("rten "), "{text}");

    // Without --detector, the message says how to go on without a model.
    std::fs::write(cache.file("office.onnx"), b"other").unwrap();
    check(
        &run(&[]),
        2,
        &["office.onnx", "--detector none runs without"],
    );
}

#[test]
fn missing_model_is_reported() {
    let cache = Cache::new();
    let dir = tempfile::tempdir().unwrap();
    let room = dir.path().join("room");
    simulate(&room, "xyz", 2);
    let mut command = cache.program();
    let output = command
        .arg("run")
        .arg(&room)
        .arg("--out")
        .arg(dir.path().join("out"))
        .output()
        .unwrap();
    let part =
        "detector: none (no model is in the cache; `stillpoint models pull yolox-nano` gets one)";
    check(&output, 0, &[part]);
}

#[test]
fn checkpoints_and_networks_are_imported() {
    let cache = Cache::new();
    let out = cache.dir.path().join("tiny7.onnx");
    let file = checkpoint();
    let args = [
        "models",
        "import",
        file.to_str().unwrap(),
        "--out",
        out.to_str().unwrap(),
    ];
    check(&cache.run(&args), 0, &["yolo-anchors"]);
    assert!(out.is_file() && out.with_extension("toml").is_file());
    assert!(!cache.file("").exists(), "the cache is not touched");
    let checked = cache.run(&["models", "check", out.to_str().unwrap()]);
    check(&checked, 0, &[]);
    assert!(
        stdout(&checked).contains("tiny7.toml"),
        "{}",
        stdout(&checked)
    );
    check(&cache.run(&args[..3]), 0, &[]);
    assert!(cache.file("idetect.onnx").is_file() && cache.file("idetect.toml").is_file());
}

#[test]
fn invalid_models_are_refused() {
    let cache = Cache::new();
    let file = |name: &str, bytes: &[u8]| {
        let path = cache.dir.path().join(name);
        std::fs::write(&path, bytes).unwrap();
        path.to_str().unwrap().to_owned()
    };
    let import = |file: &str| cache.run(&["models", "import", file]);
    check(
        &import("/no/such.onnx"),
        2,
        &["/no/such.onnx", "check the path"],
    );
    check(
        &import(&file("text.onnx", b"hello")),
        2,
        &["text.onnx", "ONNX model"],
    );
    check(&import(&file("empty.pt", b"")), 2, &["empty", "checkpoint"]);
    check(
        &import(&file("half.pt", b"PK\x03\x04")),
        2,
        &["half.pt", "cut short"],
    );
    let tiny = tiny_model::model();
    check(&import(&file("a b.onnx", &tiny)), 2, &["\"a b\"", "--name"]);
    let named = file("good.onnx", &tiny);
    let tricks = ["models", "import", &named, "--name", "../x"];
    check(&cache.run(&tricks), 2, &["../x"]);
    let out = ["models", "import", &named, "--out", "x.txt"];
    check(&cache.run(&out), 2, &["x.txt", ".onnx"]);
    // A card that contradicts the model.
    file("good.toml", b"head = \"yolo-anchors\"\n");
    check(&import(&named), 2, &["good.toml"]);
    assert!(!cache.file("").exists(), "nothing was put into the cache");

    let check_model = |name: &str| cache.run(&["models", "check", name]);
    check(
        &check_model("yolox-nano"),
        2,
        &["`stillpoint models pull yolox-nano` gets it"],
    );
    check(&check_model(&named), 2, &["good.toml"]);
    let pull = |name: &str| cache.run(&["models", "pull", name]);
    check(&pull("yolox"), 2, &["yolox-tiny", "found \"yolox\""]);
    check(&pull("yolox_nano"), 2, &["did you mean \"yolox-nano\"?"]);
}

#[test]
fn unusable_runtime_libraries_are_reported() {
    let cache = Cache::new();
    let model = tiny_model::write(cache.dir.path());
    let broken = cache.dir.path().join("libonnxruntime.so");
    std::fs::write(&broken, "no library").unwrap();
    // With no other library to be found.
    let run = |runtime: &str, library: Option<&Path>| {
        let mut command = cache.program();
        for name in [
            "VIRTUAL_ENV",
            "CONDA_PREFIX",
            "PATH",
            "HOME",
            "ORT_DYLIB_PATH",
        ] {
            command.env_remove(name);
        }
        if let Some(library) = library {
            command.env("ORT_DYLIB_PATH", library);
        }
        command.args(["models", "check"]).arg(&model);
        command.args(["--runtime", runtime]).output().unwrap()
    };
    let output = run("onnxruntime", Some(&broken));
    if output.status.code() == Some(0) {
        stillpoint_testdata::skipped("ONNX Runtime is installed in the system");
        return;
    }
    check(
        &output,
        2,
        &["libonnxruntime.so", "pip install onnxruntime"],
    );
    check(
        &run("onnxruntime", None),
        2,
        &[
            "--runtime onnxruntime",
            "ORT_DYLIB_PATH",
            "pip install onnxruntime",
        ],
    );
    let output = run("auto", Some(&broken));
    check(
        &output,
        0,
        &["warning: the network is run by rten", "libonnxruntime.so"],
    );
    assert!(stdout(&output).contains("rten "), "{}", stdout(&output));
    check(&run("rten", Some(&broken)), 0, &[]);
    check(&run("fast", None), 2, &["fast", "rten"]);
}

#[test]
fn models_are_written_to_any_file_name() {
    let cache = Cache::new();
    let path = |name: &str| cache.dir.path().join(name);
    std::fs::copy(checkpoint(), path("yolov7 (1).pt")).unwrap();
    let import = |file: &str, out: &str| {
        let [file, out] = [path(file), path(out)];
        cache.run(&[
            "models".as_ref(),
            "import".as_ref(),
            file.as_os_str(),
            "--out".as_ref(),
            out.as_os_str(),
        ])
    };
    check(&import("yolov7 (1).pt", "y.onnx"), 0, &["yolo-anchors"]);
    assert!(path("y.onnx").is_file() && path("y.toml").is_file());
    // The file extension is checked before the file.
    check(&import("missing.pt", "y.txt"), 2, &["--out", "y.txt"]);

    // An unrelated card would be taken for the model's.
    tiny_model::write(cache.dir.path());
    let before = std::fs::read(path("y.onnx")).unwrap();
    check(&import("tiny.onnx", "y.onnx"), 2, &["y.toml", "its card"]);
    assert_eq!(std::fs::read(path("y.onnx")).unwrap(), before);
    check(&import("tiny.onnx", "z.onnx"), 0, &[]);
    assert!(path("z.onnx").is_file() && !path("z.toml").exists());
}

#[test]
#[cfg(unix)]
fn endless_and_huge_model_files_are_refused() {
    let cache = Cache::new();
    let zero = cache.dir.path().join("zero.onnx");
    std::os::unix::fs::symlink("/dev/zero", &zero).unwrap();
    let huge = cache.dir.path().join("huge.onnx");
    // A sparse file, which takes no disk space.
    let file = std::fs::File::create(&huge).unwrap();
    file.set_len(1 << 40).unwrap();
    for (model, part) in [
        (&zero, "a device, where a regular file is needed"),
        (
            &huge,
            "1099511627776 bytes, where at most 536870912 are read",
        ),
    ] {
        let model = model.to_str().unwrap();
        for command in ["check", "import"] {
            check(&cache.run(&["models", command, model]), 2, &[model, part]);
        }
    }
}

#[test]
fn unreadable_cache_is_reported() {
    let cache = Cache::new();
    std::fs::write(cache.dir.path().join("models"), "a file").unwrap();
    let room = cache.dir.path().join("room");
    simulate(&room, "xyz", 2);
    let run = |more: &[&str]| {
        let mut command = cache.program();
        command.arg("run").arg(&room).args(more).arg("--out");
        command.arg(cache.dir.path().join("out")).output().unwrap()
    };
    check(&run(&[]), 2, &["models", "--detector none runs without"]);
    check(&run(&["--detector", "none"]), 0, &[]);
    check(&cache.run(&["models", "list"]), 2, &["expected a folder"]);
}

#[test]
fn scene_without_people_runs_without_a_detector() {
    let cache = Cache::new();
    check(&cache.import("office"), 0, &[]);
    let out = cache.dir.path().join("bench");
    let mut bench = cache.program();
    bench.args(["bench", "sim:xyz", "--runs", "1", "--max-frames", "3"]);
    let output = bench.arg("--out").arg(&out).output().unwrap();
    check(&output, 0, &[]);
    let text = std::fs::read_to_string(out.join("bench.md")).unwrap();
    let part = "detector none (nobody is in the scene)";
    assert!(text.contains(part), "{text}");
    assert!(!stderr(&output).contains("office"), "{}", stderr(&output));
}
