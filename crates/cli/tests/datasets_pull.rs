//! `datasets pull` and `bench --suite --pull` against a server on loopback.

use crate::common::{check, program, simulate, stderr, stdout, stillpoint};
use std::path::Path;
use std::process::{Command, Output};
use std::sync::LazyLock;
use stillpoint_testdata::server::{Server, break_off, reply, send, serve};
use tempfile::TempDir;

const TUM: &str = "/rgbd/dataset/freiburg3/rgbd_dataset_freiburg3_walking_xyz.tgz";
const BONN: &str = "/html/projects/rgbd_dynamic2019/rgbd_bonn_static.zip";
const FOLDER: &str = "rgbd_dataset_freiburg3_walking_xyz";

/// A sequence of some frames as TUM publishes it.
static WALKING: LazyLock<&'static [u8]> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    simulate(&dir.path().join(FOLDER), "walking_xyz", 6);
    let output = Command::new("tar")
        .args(["-C".as_ref(), dir.path(), "-czf".as_ref(), "-".as_ref()])
        .arg(FOLDER)
        .output()
        .unwrap();
    assert!(output.status.success());
    output.stdout.leak()
});

fn server() -> Server {
    let bytes = *WALKING;
    Server::start(move |_, request, stream| match request.path.as_str() {
        TUM => serve(bytes, "\"v1\"", request, stream),
        _ => reply(stream, "404 Not Found", "", b""),
    })
}

fn pull(name: &str, dir: &Path, server: &Server) -> Output {
    program()
        .args(["datasets", "pull", name])
        .arg(dir)
        .args(["--mirror", &server.base])
        .output()
        .unwrap()
}

fn names(dir: &TempDir) -> Vec<String> {
    let mut names: Vec<String> = std::fs::read_dir(dir.path())
        .unwrap()
        .map(|e| e.unwrap().file_name().into_string().unwrap())
        .filter(|name| !name.ends_with(".lock"))
        .collect();
    names.sort();
    names
}

#[test]
fn interrupted_sequence_download_is_resumed() {
    let dir = tempfile::tempdir().unwrap();
    let bytes = *WALKING;
    let server = Server::start(move |number, request, stream| match number {
        0 => break_off(bytes, 20_000, "ETag: \"v1\"\r\n", stream),
        _ => serve(bytes, "\"v1\"", request, stream),
    });
    let output = pull("fr3_walking_xyz", dir.path(), &server);
    let megabytes = format!("size: {:.1} MB", bytes.len() as f64 * 1e-6);
    let address = format!("{}{TUM}", server.base);
    let shown = [
        address.as_str(),
        "licence: CC BY 4.0 (https://cvg.cit.tum.de/data/datasets/rgbd-dataset)",
        &megabytes,
        "after 20000; run the same command again",
    ];
    check(&output, 2, &shown);
    let output = pull(FOLDER, dir.path(), &server);
    check(&output, 0, &["going on after 0.0 MB", "unpacking"]);
    let text = stdout(&output);
    let record = std::fs::read_to_string(dir.path().join(format!("{FOLDER}.tgz.sha256"))).unwrap();
    let sha256 = record.split(' ').next().unwrap();
    assert_eq!(record, format!("{sha256}  {FOLDER}.tgz\n"));
    for part in [
        &format!("SHA-256 {sha256} (none is published: it was recorded"),
        &format!("`stillpoint run {}/{FOLDER}` runs it", dir.path().display()),
    ] {
        assert!(text.contains(part), "{text}");
    }
    assert_eq!(
        names(&dir),
        [FOLDER.to_owned(), format!("{FOLDER}.tgz.sha256")]
    );
    let ran = program()
        .args(["run", "-q", "--detector", "none", "--out"])
        .arg(dir.path().join("out"))
        .arg(dir.path().join(FOLDER))
        .output()
        .unwrap();
    check(&ran, 0, &[]);
    // It exists already, so that the server gets no request.
    let again = pull("fr3_walking_xyz", dir.path(), &server);
    check(&again, 0, &[]);
    assert!(stdout(&again).contains("it was here"), "{}", stdout(&again));
    assert_eq!(server.requests().len(), 2);
}

#[test]
fn unavailable_sequences_are_reported() {
    let dir = tempfile::tempdir().unwrap();
    let output = pull("bonn_static", dir.path(), &server());
    check(
        &output,
        2,
        &[
            BONN,
            "https://www.ipb.uni-bonn.de/data/rgbd-dynamic-dataset/",
            "404 (not found)",
            "unpack it in",
        ],
    );
    let output = pull("fr3_walking_xzy", dir.path(), &server());
    check(&output, 2, &["did you mean \"fr3_walking_xyz\"?"]);
    assert!(names(&dir).is_empty());
    let listed = stdout(&stillpoint(["datasets", "list"]));
    for part in ["fr2_desk_with_person", "bonn_crowd3", "CC BY 4.0"] {
        assert!(listed.contains(part), "{listed}");
    }
    assert_eq!(listed.lines().filter(|l| l.contains("rgbd_")).count(), 35);
}

/// The first failed download ends the command before any run; existing sequences are neither requested nor changed.
#[test]
fn suite_is_pulled_and_run() {
    let dir = tempfile::tempdir().unwrap();
    let (data, bytes) = (dir.path().join("data"), *WALKING);
    let server = Server::start(move |_, request, stream| match request.path.as_str() {
        // All sequences are the same: the archive's folder may have any name.
        path if path.ends_with("_rpy.tgz") => reply(stream, "503 Busy", "", b""),
        path if path.ends_with(".tgz") => serve(bytes, "\"v1\"", request, stream),
        _ => reply(stream, "404 Not Found", "", b""),
    });
    let bench = |server: &Server| {
        let mut bench = program();
        bench.current_dir(dir.path()).args([
            "bench",
            "--suite",
            "tum-dynamic",
            "--pull",
            "--runs",
            "1",
            "--max-frames",
            "3",
            "--detector",
            "none",
            "--out",
            "out",
            "--mirror",
            &server.base,
        ]);
        bench.output().unwrap()
    };
    let output = bench(&server);
    check(
        &output,
        2,
        &["freiburg3_walking_rpy.tgz", "503", "try again later"],
    );
    assert!(!dir.path().join("out").exists());
    assert!(data.join(FOLDER).join("rgb.txt").is_file());
    let good = Server::start(move |_, request, stream| serve(bytes, "\"v1\"", request, stream));
    let output = bench(&good);
    check(&output, 0, &["9 of 9 sequences found"]);
    let asked: Vec<String> = good.requests().into_iter().map(|r| r.path).collect();
    assert_eq!(asked.len(), 7, "{asked:?}");
    assert!(!asked.contains(&TUM.to_owned()));
    let report = std::fs::read_to_string(dir.path().join("out/suite.md")).unwrap();
    assert_eq!(report.matches("| ran ").count(), 9, "{report}");
    check(&stillpoint(["bench", "--pull", "sim:xyz"]), 2, &["--suite"]);
}

/// Ctrl-C ends an endless download, and the partial file is kept.
#[test]
#[cfg(unix)]
fn interrupted_pull_keeps_the_partial_file() {
    let dir = tempfile::tempdir().unwrap();
    let server = Server::start(|_, _, stream| {
        send(
            stream,
            b"HTTP/1.1 200 OK\r\nContent-Length: 3000000\r\n\r\n",
        );
        for _ in 0..3000 {
            send(stream, &[7; 1000]);
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
    });
    let child = program()
        .args(["datasets", "pull", "fr3_walking_xyz"])
        .arg(dir.path())
        .args(["--mirror", &server.base])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let part = dir.path().join(format!("{FOLDER}.tgz.part"));
    while !part.metadata().is_ok_and(|m| m.len() > 0) {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let id = child.id().to_string();
    let sent = Command::new("kill").args(["-INT", &id]).status().unwrap();
    assert!(sent.success());
    let output = child.wait_with_output().unwrap();
    check(&output, 1, &["stopped after", "goes on from"]);
    assert!(part.metadata().unwrap().len() > 0, "{}", stderr(&output));
}
