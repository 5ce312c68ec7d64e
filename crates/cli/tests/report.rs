//! The report of a run: its contents, and its behaviour in a browser.

use crate::common::browser::Browser;
use crate::common::{check, simulate, stderr, stdout, stillpoint};
use serde_json::{Value, json};
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use tempfile::TempDir;

pub(crate) const FRAMES: usize = 60;

pub(crate) struct Made {
    pub(crate) dir: TempDir,
    pub(crate) result: PathBuf,
    page: PathBuf,
    pub(crate) summary: Value,
}

pub(crate) static MADE: LazyLock<Made> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let (data, result) = (dir.path().join("people walk"), dir.path().join("result"));
    simulate(&data, "walking_xyz", FRAMES);
    let script = format!("scripted:{}", data.join("detections.csv").display());
    let out = text(&result);
    let output = stillpoint(["run", text(&data), "--detector", &script, "--out", out]);
    check(&output, 0, &[]);
    Made {
        page: result.join("report.html"),
        summary: summary(&result),
        result,
        dir,
    }
});

pub(crate) fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

pub(crate) fn summary(result: &Path) -> Value {
    serde_json::from_slice(&std::fs::read(result.join("summary.json")).unwrap()).unwrap()
}

#[test]
fn run_writes_a_report_with_its_command() {
    let page = std::fs::read_to_string(&MADE.page).unwrap();
    assert!(page.len() < 3_000_000, "{}", page.len());
    assert!(page.contains("<title>people walk - Stillpoint</title>"));
    assert!(page.contains("stillpoint run '"), "the command is quoted");
}

#[test]
fn result_is_the_same_without_a_report() {
    let again = MADE.dir.path().join("without");
    let data = MADE.dir.path().join("people walk");
    let script = format!("scripted:{}", data.join("detections.csv").display());
    let args = ["run", text(&data), "--detector", &script, "--no-report"];
    check(
        &stillpoint([&args[..], &["--out", text(&again)]].concat()),
        0,
        &[],
    );
    assert!(!again.join("report.html").exists());
    for file in [
        "trajectory.txt",
        "trajectory_online.txt",
        "frames.csv",
        "run.log",
    ] {
        let read = |folder: &Path| std::fs::read(folder.join(file)).unwrap();
        assert!(read(&again) == read(&MADE.result), "{file}");
    }
    // The page can be made from the remaining files.
    check(&stillpoint(["report", text(&again)]), 0, &[]);
    let page = std::fs::read_to_string(again.join("report.html")).unwrap();
    assert!(page.len() < 300_000, "{}", page.len());
}

#[test]
fn report_is_remade_and_combined_from_several() {
    let out = MADE.dir.path().join("again.html");
    let result = text(&MADE.result);
    let output = stillpoint(["report", result, "--out", text(&out)]);
    check(&output, 0, &[]);
    assert!(
        stdout(&output).contains("report in "),
        "{}",
        stderr(&output)
    );
    assert!(std::fs::read(&out).unwrap() == std::fs::read(&MADE.page).unwrap());
    let both = MADE.dir.path().join("both.html");
    check(
        &stillpoint(["report", result, result, "--out", text(&both)]),
        0,
        &[],
    );
    let page = std::fs::read_to_string(&both).unwrap();
    assert!(page.contains("<title>2 runs - Stillpoint</title>"));
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    browser.open(&both, "#run=1");
    let rows = "document.querySelectorAll('#compare tbody tr').length";
    assert!(browser.eval(rows).as_u64().unwrap() > 5);
    assert_eq!(
        browser.eval("document.querySelector('#title').textContent"),
        "people walk (2)"
    );
    assert_eq!(browser.errors, [""; 0]);
}

#[test]
fn invalid_result_folder_is_refused() {
    let empty = MADE.dir.path().join("empty");
    std::fs::create_dir_all(&empty).unwrap();
    let lacks = ["summary.json", "expected a file of a result folder"];
    check(&stillpoint(["report", text(&empty)]), 2, &lacks);
    let damaged = MADE.dir.path().join("damaged");
    std::fs::create_dir_all(&damaged).unwrap();
    std::fs::copy(
        MADE.result.join("summary.json"),
        damaged.join("summary.json"),
    )
    .unwrap();
    std::fs::write(damaged.join("report.html"), "<html>").unwrap();
    let output = stillpoint(["report", text(&damaged)]);
    check(&output, 2, &["report.html: expected a report of a run"]);
}

/// Share of the view's pixels that are drawn, and a hash of the image.
pub(crate) const LOOK: &str = "new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => {
    const from = document.querySelector('#scene'), canvas = document.createElement('canvas');
    [canvas.width, canvas.height] = [from.width, from.height];
    const g = canvas.getContext('2d');
    g.drawImage(from, 0, 0);
    const p = g.getImageData(0, 0, canvas.width, canvas.height).data;
    let drawn = 0, sum = 0;
    for (let i = 0; i < p.length; i += 4) {
        if (Math.abs(p[i] - p[0]) + Math.abs(p[i + 1] - p[1]) + Math.abs(p[i + 2] - p[2]) > 24) { drawn++; sum = (sum * 31 + i + p[i]) % 1000000007; }
    }
    done([drawn / (p.length / 4), sum]);
})))";

#[test]
fn report_page_matches_the_summary() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    browser.open(&MADE.page, "");
    browser.until("stillpoint.state.ready");
    let counts = browser.eval("stillpoint.counts");
    for name in ["frames", "tracked", "keyframes", "landmarks"] {
        assert_eq!(counts[name], MADE.summary[name], "{name}");
    }
    assert_eq!(counts["pictures"], MADE.summary["frames"]);
    assert_eq!(browser.eval("stillpoint.state.is3d"), true);
    let mut looks = Vec::new();
    let mut look = |browser: &mut Browser, what: &str| {
        let seen = browser.eval(LOOK);
        let share = seen[0].as_f64().unwrap();
        assert!(share > 0.05, "{what}: {share}");
        assert!(!looks.contains(&seen[1]), "{what} looks as before");
        // An incremental redraw equals a full one.
        browser.eval("page.view.scene.key = null, page.view.redraw()");
        assert_eq!(browser.eval(LOOK), seen, "{what}, drawn anew");
        looks.push(seen[1].clone());
    };
    for frame in [10, 30, 50] {
        browser.eval(&format!("stillpoint.go({frame})"));
        look(&mut browser, &format!("frame {frame}"));
    }
    browser.eval("stillpoint.view('top')");
    look(&mut browser, "from above");
    let mover =
        "stillpoint.run.tracks.values().find(t => t.some(o => o.motion === 1 && o.at <= 50))[0].id";
    browser.eval(&format!("stillpoint.choose({mover})"));
    look(&mut browser, "a mover");
    assert_eq!(browser.errors, [""; 0]);
    assert_eq!(browser.requests, [""; 0]);
    assert_eq!(browser.eval("stillpoint.state.errors"), json!([]));
}

#[test]
fn keyboard_and_touch_work_like_the_mouse() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    browser.open(&MADE.page, "");
    browser.until("stillpoint.state.ready");
    // Every control can be focused, and shows its focus.
    let mut reached = Vec::new();
    for _ in 0..60 {
        browser.press("Tab", 0);
        let at = browser.eval("(e => e === document.body ? '' : e.id || e.dataset.view || e.tagName)(document.activeElement)");
        let at = at.as_str().unwrap_or_default().to_owned();
        if at.is_empty() {
            break;
        }
        let outlined = "getComputedStyle(document.activeElement).outlineStyle !== 'none'";
        assert_eq!(browser.eval(outlined), true, "{at}");
        reached.push(at);
    }
    for id in [
        "home",
        "colouring",
        "scene",
        "play",
        "verdicts",
        "timeline",
        "previous",
    ] {
        assert!(reached.iter().any(|r| r == id), "{id}: {reached:?}");
    }
    let last = MADE.summary["frames"].as_u64().unwrap() - 1;
    browser.eval("document.querySelector('#timeline').focus()");
    for (key, expected) in [
        ("Home", 0),
        ("ArrowRight", 1),
        ("End", last),
        ("ArrowLeft", last - 1),
        ("Home", 0),
    ] {
        browser.press(key, 0);
        assert_eq!(browser.eval("stillpoint.state.frame"), expected, "{key}");
    }
    let told = browser.eval("document.querySelector('#timeline').getAttribute('aria-valuetext')");
    assert!(told.as_str().unwrap().starts_with("frame 0, "), "{told}");
    let scene = |name: &str| format!("page.view.scene.{name}");
    browser.eval("document.querySelector('#scene').focus()");
    for (key, modifiers, what) in [
        ("ArrowLeft", 0, "yaw"),
        ("ArrowUp", 0, "pitch"),
        ("+", 0, "distance"),
        ("ArrowUp", 8, "target[0]"),
        ("2", 0, "pitch"),
    ] {
        let before = browser.eval(&scene(what));
        browser.press(key, modifiers);
        assert_ne!(browser.eval(&scene(what)), before, "{key}");
    }

    // Spreading two fingers zooms; one finger rotates.
    let touch = json!({"enabled": true, "maxTouchPoints": 2});
    browser.call("Emulation.setTouchEmulationEnabled", &touch);
    browser.eval("document.querySelector('#scene').scrollIntoView({block: 'center'})");
    let at = browser.eval("(r => [r.left + r.width / 2, r.top + r.height / 2])(document.querySelector('#scene').getBoundingClientRect())");
    let (x, y) = (at[0].as_f64().unwrap(), at[1].as_f64().unwrap());
    let fingers = |browser: &mut Browser, kind: &str, points: &[[f64; 2]]| {
        let points: Vec<Value> = points
            .iter()
            .enumerate()
            .map(|(i, [dx, dy])| json!({"x": x + dx, "y": y + dy, "id": i}))
            .collect();
        browser.call(
            "Input.dispatchTouchEvent",
            &json!({"type": kind, "touchPoints": points}),
        );
    };
    let before = browser.eval(&scene("distance")).as_f64().unwrap();
    fingers(&mut browser, "touchStart", &[[-30.0, 0.0], [30.0, 0.0]]);
    fingers(&mut browser, "touchMove", &[[-90.0, 0.0], [90.0, 0.0]]);
    fingers(&mut browser, "touchEnd", &[]);
    let after = browser.eval(&scene("distance")).as_f64().unwrap();
    assert!(after < 0.6 * before, "{after} after {before}");
    let before = browser.eval(&scene("yaw"));
    fingers(&mut browser, "touchStart", &[[0.0, 0.0]]);
    fingers(&mut browser, "touchMove", &[[60.0, 10.0]]);
    fingers(&mut browser, "touchEnd", &[]);
    assert_ne!(browser.eval(&scene("yaw")), before);
    assert_eq!(browser.errors, [""; 0]);
}

/// Text whose contrast with its background is under 4.5 (WCAG 2.1).
pub(crate) const FAINT: &str = "(() => {
    const parse = c => c.match(/[\\d.]+/g).map(Number);
    const light = c => { const [r, g, b] = parse(c).map(v => (v /= 255) <= 0.03928 ? v / 12.92 : ((v + 0.055) / 1.055) ** 2.4); return 0.2126 * r + 0.7152 * g + 0.0722 * b; };
    const behind = e => { for (; e; e = e.parentElement) { const c = getComputedStyle(e).backgroundColor, p = parse(c); if (p.length < 4 || p[3] > 0) return c; } return 'rgb(255, 255, 255)'; };
    const faint = [];
    for (const e of document.querySelectorAll('body *')) {
        const own = [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim());
        if (!own || !e.offsetParent || e.tagName === 'SCRIPT') continue;
        const [a, b] = [light(getComputedStyle(e).color), light(behind(e))].sort((x, y) => y - x);
        if ((a + 0.05) / (b + 0.05) < 4.5) faint.push(e.outerHTML.slice(0, 80));
    }
    return faint;
})()";

#[test]
fn report_supports_phone_dark_mode_and_reduced_motion() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    let size = json!({"width": 400, "height": 800, "deviceScaleFactor": 2, "mobile": false});
    browser.call("Emulation.setDeviceMetricsOverride", &size);
    for scheme in ["light", "dark"] {
        let media = json!({"features": [{"name": "prefers-color-scheme", "value": scheme}, {"name": "prefers-reduced-motion", "value": "reduce"}]});
        browser.call("Emulation.setEmulatedMedia", &media);
        browser.open(&MADE.page, "#frame=20&view=top");
        browser.until("stillpoint.state.ready");
        assert_eq!(browser.eval("stillpoint.state.frame"), 20);
        let wide = browser.eval("document.documentElement.scrollWidth");
        assert!(wide.as_u64().unwrap() <= 400, "{scheme}: {wide}");
        assert_eq!(browser.eval(FAINT), json!([]), "{scheme}");
        let moving = "document.getAnimations().length + [...document.querySelectorAll('*')].filter(e => parseFloat(getComputedStyle(e).transitionDuration) > 0).length";
        assert_eq!(browser.eval(moving), 0, "{scheme}");
        let dark = browser.eval("getComputedStyle(document.body).backgroundColor");
        assert_eq!(dark == "rgb(255, 255, 255)", scheme == "light", "{dark}");
    }
    assert_eq!(browser.errors, [""; 0]);
}

#[test]
fn without_webgl_all_but_the_3d_view_works() {
    let Some(mut browser) = Browser::start(&["--disable-3d-apis"]) else {
        return;
    };
    browser.open(&MADE.page, "");
    browser.until("stillpoint.state.ready");
    assert_eq!(browser.eval("stillpoint.state.is3d"), false);
    let said = browser.eval("document.querySelector('#no3d').innerText");
    assert!(said.as_str().unwrap().contains("WebGL 2"), "{said}");
    let drawn = |id: &str| {
        format!(
            "(c => new Set(c.getContext('2d').getImageData(0, 0, c.width, c.height).data).size)(document.querySelector('#{id}'))"
        )
    };
    for id in ["timeline", "scene"] {
        assert!(browser.eval(&drawn(id)).as_u64().unwrap() > 8, "{id}");
    }
    assert!(
        browser
            .eval("document.querySelectorAll('#tables tbody tr').length")
            .as_u64()
            .unwrap()
            > 3
    );
    browser.eval("stillpoint.go(30)");
    assert_eq!(browser.errors, [""; 0]);
}
