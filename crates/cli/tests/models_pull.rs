//! `models pull` against a server on loopback.

use crate::common::model_cache::{Cache, checkpoint};
use crate::common::server::{serve, serve_file, write_head};
use crate::common::{check, stderr, stdout};
use std::io::Write;
use std::process::Command;

#[test]
fn download_with_a_wrong_checksum_is_not_kept() {
    let cache = Cache::new();
    let server = serve_file(vec![7; 3_659_407]);
    let output = cache.pull("yolox-nano", &server);
    check(&output, 2, &["expected SHA-256 c789161e", "models import"]);
    assert!(!cache.file("yolox-nano.onnx").exists());
    let requests = server.requests.lock().unwrap().clone();
    let path = "GET /Megvii-BaseDetection/YOLOX/releases/download/0.1.1rc0/yolox_nano.onnx ";
    assert!(requests[0].starts_with(path), "{requests:?}");
}

#[test]
fn missing_file_on_the_server_is_reported() {
    let cache = Cache::new();
    let server = serve(|_, stream| write_head(stream, "404 Not Found", 0));
    check(
        &cache.pull("yolox-nano", &server),
        2,
        &["404", "models import"],
    );
}

/// Without a network the message says what to download, how to check it, and where to put it.
#[test]
fn offline_pull_explains_manual_installation() {
    let cache = Cache::new();
    // A port that was free just before.
    let port = std::net::TcpListener::bind("127.0.0.1:0").unwrap();
    let url = format!("http://{}", port.local_addr().unwrap());
    drop(port);
    let output = cache.run(&["models", "pull", "yolox-nano", "--mirror", &url]);
    check(
        &output,
        2,
        &[
            "https://github.com/Megvii-BaseDetection",
            "3659407 bytes",
            "c789161ed43c8269fcd4e67c67eeeb4e80c622da2eb296a20bc6007bd18a0b7d",
            "stillpoint models import yolox_nano.onnx",
            cache.file("yolox-nano.onnx").to_str().unwrap(),
        ],
    );
}

#[test]
fn pulled_checkpoint_is_converted_to_onnx() {
    let bytes = std::fs::read(checkpoint()).unwrap();
    let cache = Cache::new();
    let server = serve_file(bytes.clone());
    let output = cache.pull("yolov7-tiny", &server);
    check(&output, 0, &["GPL-3.0", "turning the checkpoint into ONNX"]);
    let text = stdout(&output);
    assert!(text.contains("it was recorded"), "{text}");
    assert!(text.contains("--detector yolov7-tiny"), "{text}");
    let checked = cache.run(&["models", "check", "yolov7-tiny", "--runtime", "rten"]);
    check(&checked, 0, &[]);
    assert!(
        stdout(&checked).contains("yolo-anchors"),
        "{}",
        stdout(&checked)
    );
    let quiet = cache.run(&[
        "-q",
        "models",
        "pull",
        "yolov7-tiny",
        "--mirror",
        &server.url,
    ]);
    check(&quiet, 0, &[]);
    assert_eq!(
        (stdout(&quiet), stderr(&quiet)),
        (String::new(), String::new())
    );
    // Other bytes than the first time.
    let mut other = bytes;
    *other.last_mut().unwrap() ^= 1;
    let server = serve_file(other);
    let again = [
        "models",
        "pull",
        "yolov7-tiny",
        "--again",
        "--mirror",
        &server.url,
    ];
    check(&cache.run(&again), 2, &["expected SHA-256"]);
    check(&cache.run(&["models", "check", "yolov7-tiny"]), 0, &[]);
}

#[test]
fn user_model_is_not_replaced_unasked() {
    let cache = Cache::new();
    check(&cache.import("yolox-nano"), 0, &[]);
    let before = std::fs::read(cache.file("yolox-nano.onnx")).unwrap();
    let server = serve_file(vec![7; 3_659_407]);
    check(
        &cache.pull("yolox-nano", &server),
        2,
        &["yolox-nano.onnx", "--again replaces it"],
    );
    assert!(server.requests.lock().unwrap().is_empty());
    assert_eq!(
        std::fs::read(cache.file("yolox-nano.onnx")).unwrap(),
        before
    );
}

/// Ctrl-C ends an endless download, and the partial file is kept.
#[test]
#[cfg(unix)]
fn interrupted_download_keeps_the_partial_file() {
    let cache = Cache::new();
    let server = serve(|_, stream| {
        write_head(stream, "200 OK", 3_659_407)?;
        for _ in 0..3000 {
            stream.write_all(&[7; 1024])?;
            std::thread::sleep(std::time::Duration::from_millis(10));
        }
        Ok(())
    });
    let child = cache
        .program()
        .args(["models", "pull", "yolox-nano", "--mirror", &server.url])
        .stderr(std::process::Stdio::piped())
        .spawn()
        .unwrap();
    let part = cache.file("yolox-nano.part");
    while !part.metadata().is_ok_and(|m| m.len() > 0) {
        std::thread::sleep(std::time::Duration::from_millis(10));
    }
    let id = child.id().to_string();
    assert!(
        Command::new("kill")
            .args(["-INT", &id])
            .status()
            .unwrap()
            .success()
    );
    let output = child.wait_with_output().unwrap();
    check(&output, 1, &["stopped after", "goes on from"]);
    assert!(part.metadata().unwrap().len() > 0);
    assert!(!cache.file("yolox-nano.onnx").exists());
    let listed = stdout(&cache.run(&["models", "list"]));
    assert!(listed.contains("yolox-nano.part"), "{listed}");
}
