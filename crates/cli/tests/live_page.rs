//! A run shown in a browser while it goes on.

use crate::common::browser::Browser;
use crate::common::program;
use crate::report::{FAINT, FRAMES, LOOK, MADE, summary, text};
use serde_json::{Value, json};
use std::io::{BufRead, BufReader, Read, Write};
use std::net::TcpStream;
use std::path::{Path, PathBuf};
use std::process::{Child, ChildStderr, Stdio};

struct Running {
    child: Child,
    stderr: BufReader<ChildStderr>,
    url: String,
    out: PathBuf,
}

impl Running {
    /// Starts `run` on the walking people, or on another folder beside them.
    fn start(data: &str, name: &str, options: &[&str]) -> Self {
        let dir = MADE.dir.path();
        let out = dir.join(name);
        let script = dir.join(data).join("detections.csv");
        let script = format!("scripted:{}", script.display());
        let data = dir.join(data);
        let mut command = program();
        command.args([
            "run",
            text(&data),
            "--detector",
            &script,
            "--out",
            text(&out),
        ]);
        command.args(options).args(["--view", "127.0.0.1:0"]);
        command.stdout(Stdio::null()).stderr(Stdio::piped());
        let mut child = command.spawn().unwrap();
        let mut stderr = BufReader::new(child.stderr.take().unwrap());
        let mut said = String::new();
        let url = loop {
            let read = stderr.read_line(&mut said).unwrap();
            assert!(read > 0, "it does not say where: {said}");
            let last = said.lines().last().unwrap_or_default();
            if let Some(url) = last.strip_prefix("live page at ") {
                break url.to_owned();
            }
        };
        Self {
            child,
            stderr,
            url,
            out,
        }
    }

    fn connect(&self) -> TcpStream {
        let address = self.url.trim_start_matches("http://");
        TcpStream::connect(address.trim_end_matches('/')).unwrap()
    }

    fn end(mut self) -> Value {
        let mut said = String::new();
        self.stderr.read_to_string(&mut said).unwrap();
        assert!(self.child.wait().unwrap().success(), "{said}");
        summary(&self.out)
    }
}

/// All events of a page.
fn listen(stream: TcpStream) -> Vec<(String, Value)> {
    let (mut events, mut name) = (Vec::new(), String::new());
    let mut stream = stream;
    stream
        .write_all(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .unwrap();
    for line in BufReader::new(stream).lines() {
        let line = line.unwrap();
        if let Some(text) = line.strip_prefix("event: ") {
            name = text.to_owned();
        } else if let Some(text) = line.strip_prefix("data: ") {
            events.push((name.clone(), serde_json::from_str(text).unwrap()));
        }
    }
    events
}

#[test]
fn viewers_receive_the_report_without_changing_the_run() {
    let run = Running::start("people walk", "shown", &[]);
    let stream = run.connect();
    let told = std::thread::spawn(move || listen(stream));
    // A client that reads nothing, and one that leaves at once.
    let mut stopped = run.connect();
    stopped
        .write_all(b"GET /events HTTP/1.1\r\nHost: localhost\r\n\r\n")
        .unwrap();
    drop(run.connect());
    let out = run.out.clone();
    let summary = run.end();
    drop(stopped);
    for file in [
        "trajectory.txt",
        "trajectory_online.txt",
        "frames.csv",
        "run.log",
    ] {
        let read = |folder: &Path| std::fs::read(folder.join(file)).unwrap();
        assert!(read(&out) == read(&MADE.result), "{file}");
    }
    let events = told.join().unwrap();
    let (last, updates) = events.split_last().unwrap();
    assert!(updates.len() > 2 && updates.iter().all(|(name, _)| name == "update"));
    assert_eq!(updates[0].1["about"]["name"], "people walk");
    assert!(updates[1..].iter().all(|(_, u)| u["about"].is_null()));
    let pictures = updates.iter().filter(|(_, u)| !u["picture"].is_null());
    assert!(pictures.count() > 0);
    let landmarks = updates
        .iter()
        .filter_map(|(_, u)| u["map"]["count"].as_u64());
    assert!(landmarks.max() > Some(100));
    assert_eq!(
        (&*last.0, &last.1["summary"]["frames"]),
        ("report", &summary["frames"])
    );
}

/// The same recording at a third of the speed, so that the page can be examined.
fn slowly() -> &'static str {
    let folder = |name: &str| MADE.dir.path().join(name);
    let (from, to) = (folder("people walk"), folder("slowly"));
    crate::common::copy(&from, &to);
    for (name, between) in [
        ("rgb.txt", ' '),
        ("depth.txt", ' '),
        ("detections.csv", ','),
    ] {
        let list = std::fs::read_to_string(from.join(name)).unwrap();
        let line = |line: &str| match line.split_once(between) {
            Some((stamp, rest)) if stamp.parse::<f64>().is_ok() => {
                let stamp: f64 = stamp.parse().unwrap();
                // Depth keeps its delay after colour.
                let frame = (30.0 * stamp + 1e-3).floor() / 30.0;
                format!("{:.6}{between}{rest}", stamp + 2.0 * frame)
            }
            _ => line.to_owned(),
        };
        let lines: Vec<String> = list.lines().map(line).collect();
        std::fs::write(to.join(name), lines.join("\n")).unwrap();
    }
    std::fs::remove_file(to.join("groundtruth.txt")).unwrap();
    "slowly"
}

#[test]
fn browser_shows_the_live_run_and_then_its_report() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    let more = ["--live=all", "--dense", "--voxel", "0.04"];
    let run = Running::start(slowly(), "slowly shown", &more);
    browser.open_url(&run.url);
    browser.until("stillpoint.state.ready && stillpoint.counts.frames > 5 && stillpoint.counts.landmarks > 50");
    browser.until("stillpoint.state.live.state === 'live'");
    assert_eq!(browser.eval("stillpoint.state.following"), true);
    // Image and map are drawn.
    browser.until("stillpoint.counts.pictures > 1 && document.querySelector('#picture').width > 0");
    // The surface is shown during the run.
    browser.until("stillpoint.counts.triangles > 100");
    assert_eq!(browser.eval("stillpoint.state.live.state"), "live");
    let before = browser.eval("stillpoint.counts.frames").as_u64().unwrap();
    browser.until(&format!("stillpoint.state.frame > {before}"));
    let share = browser.eval(LOOK)[0].as_f64().unwrap();
    assert!(share > 0.02, "{share}");
    assert_eq!(browser.eval(FAINT), json!([]));
    let phone = json!({"width": 400, "height": 800, "deviceScaleFactor": 1, "mobile": false});
    browser.call("Emulation.setDeviceMetricsOverride", &phone);
    let media = json!({"features": [{"name": "prefers-color-scheme", "value": "dark"}]});
    browser.call("Emulation.setEmulatedMedia", &media);
    let wide = browser.eval("document.documentElement.scrollWidth");
    assert!(wide.as_u64().unwrap() <= 400, "{wide}");
    assert_eq!(browser.eval(FAINT), json!([]));
    // A user who looks at an earlier frame stays there, and can return to the newest.
    browser.eval("document.querySelector('#timeline').focus()");
    browser.press("Home", 0);
    browser.eval("new Promise(done => setTimeout(done, 300))");
    let state = browser.eval("stillpoint.state");
    assert_eq!(
        (&state["frame"], &state["following"]),
        (&json!(0), &json!(false))
    );
    browser.eval("document.querySelector('#live').click()");
    assert_eq!(browser.eval("stillpoint.state.following"), true);
    // At the end the page becomes the report.
    browser.until("stillpoint.state.live.state === 'over'");
    let summary = run.end();
    let counts = browser.eval("stillpoint.counts");
    for name in ["frames", "tracked", "keyframes", "landmarks"] {
        assert_eq!(counts[name], summary[name], "{name}");
    }
    assert_eq!(counts["frames"], FRAMES as u64);
    let said = browser.eval("document.querySelector('#status').textContent");
    assert!(
        said.as_str().unwrap().starts_with("The run has ended."),
        "{said}"
    );
    let rows = browser.eval("document.querySelectorAll('#tables tbody tr').length");
    assert!(rows.as_u64().unwrap() > 3);
    // The time line has the latency of the detector's answers.
    let lanes = browser.eval("page.timeline.lanes.map(l => l[0])");
    assert!(
        lanes.as_array().unwrap().contains(&json!("answer_ms")),
        "{lanes}"
    );
    assert_eq!(browser.errors, [""; 0]);
    assert!(
        browser.requests.iter().all(|r| r.ends_with("/events")),
        "{:?}",
        browser.requests
    );
    assert_eq!(browser.eval("stillpoint.state.errors"), json!([]));
}
