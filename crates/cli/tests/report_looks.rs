//! Appearance of the report: a screen shows everything about a frame, the page prints and fits a phone, and screenshots match those in
//! `golden/`. Renew these by `STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --test all report_looks`, and look at them before you commit
//! them.

use crate::common::browser::Browser;
use crate::report::MADE;
use serde_json::{Value, json};
use std::path::PathBuf;
use stillpoint::view::report::Column;

/// Factor by which screenshots are reduced before they are stored.
const KEPT: u32 = 4;
/// Side of the blocks whose means are compared, px of the reduced image: browser versions differ less in block means than in pixels.
const BLOCK: u32 = 6;
/// Maximum difference of equal blocks, grey levels of 255. Measured: text that moves by a pixel changes less, a missing part changes more.
const ALIKE: f64 = 24.0;
/// Maximum share of differing blocks: fonts vary.
const OTHER: f64 = 0.02;

fn size(browser: &mut Browser, [width, height]: [u32; 2], dense: u32) {
    let size =
        json!({"width": width, "height": height, "deviceScaleFactor": dense, "mobile": false});
    browser.call("Emulation.setDeviceMetricsOverride", &size);
}

fn scheme(browser: &mut Browser, name: &str) {
    let media = json!({"features": [{"name": "prefers-color-scheme", "value": name}, {"name": "prefers-reduced-motion", "value": "reduce"}]});
    browser.call("Emulation.setEmulatedMedia", &media);
}

fn open(browser: &mut Browser, fragment: &str) {
    browser.open(&MADE.result.join("report.html"), fragment);
    browser.until("stillpoint.state.ready && document.fonts.status === 'loaded'");
}

fn bytes(value: &Value) -> Vec<u8> {
    let column: Column<u8> = serde_json::from_value(value.clone()).unwrap();
    column.0
}

#[test]
fn one_screen_shows_everything_of_a_frame() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    for (screen, dense) in [([1280, 800], 1), ([1440, 900], 2)] {
        size(&mut browser, screen, dense);
        open(&mut browser, "");
        for part in [
            "title",
            "status",
            "numbers",
            "picture",
            "caption-text",
            "scene",
            "plan",
            "play",
            "timeline",
        ] {
            let at = browser.eval(&format!("(r => [r.left, r.top, r.right, r.bottom])(document.querySelector('#{part}').getBoundingClientRect())"));
            let at = [0_usize, 1, 2, 3].map(|i| at[i].as_f64().unwrap());
            let [width, height] = screen.map(f64::from);
            let holds = at[0] >= 0.0 && at[1] >= 0.0 && at[2] <= width && at[3] <= height;
            assert!(
                holds && at[2] - at[0] > 20.0 && at[3] - at[1] > 8.0,
                "{part} at {screen:?}: {at:?}"
            );
        }
        assert_eq!(
            browser.eval("document.querySelectorAll('#numbers > div').length"),
            6
        );
        // The image is stored large enough, shown large enough, and drawn at the screen's resolution.
        let stored = browser.eval("stillpoint.run.data.pictures.size[0]");
        assert!(stored.as_u64().unwrap() >= 320, "{stored}");
        let wide =
            browser.eval("(c => [c.clientWidth, c.width])(document.querySelector('#picture'))");
        let [shown, drawn] = [0_usize, 1].map(|i| wide[i].as_u64().unwrap());
        assert!(
            shown >= 320 && drawn.abs_diff(shown * u64::from(dense)) <= 2 * u64::from(dense),
            "{wide}"
        );
    }
    assert_eq!(browser.errors, [""; 0]);
}

#[test]
fn report_opens_at_the_worst_frame_and_accepts_keys() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    open(&mut browser, "");
    let worst = browser.eval("(r => { let best = -1; r.error_mm.forEach((e, i) => { if (Number.isFinite(e) && r.state[i] === 2 && !(e <= r.error_mm[best])) best = i; }); return best; })(stillpoint.run)");
    let worst = worst.as_i64().unwrap();
    assert_eq!(browser.eval("stillpoint.state.frame"), worst);
    for (key, modifiers, expected) in [
        ("ArrowLeft", 0, worst - 1),
        ("ArrowRight", 0, worst),
        ("Home", 0, 0),
        ("ArrowRight", 8, 10),
    ] {
        browser.press(key, modifiers);
        assert_eq!(browser.eval("stillpoint.state.frame"), expected, "{key}");
    }
    // A click on the map or on a button leaves the keyboard focus to the page.
    for part in ["#scene", "#next"] {
        let at = browser.eval(&format!("(r => [r.left + 9, r.top + 9])(document.querySelector('{part}').getBoundingClientRect())"));
        for kind in ["mousePressed", "mouseReleased"] {
            browser.call(
                "Input.dispatchMouseEvent",
                &json!({"type": kind, "x": at[0], "y": at[1], "button": "left", "clickCount": 1}),
            );
        }
    }
    assert_eq!(browser.eval("stillpoint.state.frame"), 11);
    browser.press("ArrowRight", 0);
    assert_eq!(browser.eval("stillpoint.state.frame"), 12);
    browser.press(" ", 0);
    assert_eq!(browser.eval("stillpoint.state.playing"), true);
    browser.until("stillpoint.state.frame > 12");
    browser.press(" ", 0);
    assert_eq!(browser.eval("stillpoint.state.playing"), false);
    assert_eq!(browser.errors, [""; 0]);
}

#[test]
fn report_prints_on_two_pages() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    scheme(&mut browser, "dark");
    open(&mut browser, "");
    let printed = browser.call(
        "Page.printToPDF",
        &json!({"preferCSSPageSize": true, "printBackground": true}),
    );
    let pdf = bytes(&printed["data"]);
    let pages = pdf.windows(11).filter(|w| *w == b"/Type /Page").count();
    let lists = pdf.windows(12).filter(|w| *w == b"/Type /Pages").count();
    assert_eq!(pages - lists, 2);
}

/// Overlapping texts of two elements, none of which contains the other.
const OVERLAPS: &str = "(() => {
    const words = [...document.querySelectorAll('body *')].filter(e => e.checkVisibility() && !e.closest('script, .menu > div') && [...e.childNodes].some(n => n.nodeType === 3 && n.textContent.trim()));
    const clipped = (e, r) => {
        for (let p = e; p; p = p.parentElement) {
            if (getComputedStyle(p).overflowX === 'visible') continue;
            const b = p.getBoundingClientRect();
            r = { left: Math.max(r.left, b.left), top: Math.max(r.top, b.top), right: Math.min(r.right, b.right), bottom: Math.min(r.bottom, b.bottom) };
        }
        return r;
    };
    const boxes = words.map(e => { const range = document.createRange(); range.selectNodeContents(e); return [...range.getClientRects()].map(r => clipped(e, r)).filter(r => r.right - r.left > 1 && r.bottom - r.top > 1); });
    const over = (a, b) => Math.min(a.right, b.right) - Math.max(a.left, b.left) > 2 && Math.min(a.bottom, b.bottom) - Math.max(a.top, b.top) > 4;
    const found = [];
    words.forEach((a, i) => words.slice(0, i).forEach((b, j) => {
        if (!a.contains(b) && !b.contains(a) && boxes[i].some(p => boxes[j].some(q => over(p, q)))) found.push(`${a.textContent.slice(0, 40)} | ${b.textContent.slice(0, 40)}`);
    }));
    return found;
})()";

#[test]
fn nothing_overlaps_at_any_screen_size() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    for screen in [[390, 844], [1280, 800], [1440, 900], [960, 700]] {
        size(&mut browser, screen, 1);
        open(&mut browser, "");
        let wide = browser.eval("document.documentElement.scrollWidth");
        assert!(
            wide.as_u64().unwrap() <= u64::from(screen[0]),
            "{screen:?}: {wide}"
        );
        assert_eq!(browser.eval(OVERLAPS), json!([]), "{screen:?}");
    }
}

/// Replaces times, which differ from run to run.
const STEADY: &str = "(() => {
    const run = stillpoint.run, s = run.summary;
    run.time_ms.fill(12);
    s.seconds = 2;
    s.peak_memory_bytes = 1e8;
    for (const t of s.timing_ms) { const ms = t.stage === 'total' ? 12 : t.stage === 'frame' ? 10 : 1; Object.assign(t, { n: 60, median: ms, p95: ms, p99: ms, max: ms, mean: ms }); }
    stillpoint.select(0);
    return new Promise(done => requestAnimationFrame(() => requestAnimationFrame(() => setTimeout(() => done(true), 200))));
})()";

/// Share of blocks whose mean differs between two images in any channel.
fn difference(a: &image::RgbImage, b: &image::RgbImage) -> f64 {
    assert_eq!(a.dimensions(), b.dimensions());
    let (width, height) = a.dimensions();
    let (mut other, mut all) = (0_u32, 0_u32);
    for y in (0..height).step_by(BLOCK as usize) {
        for x in (0..width).step_by(BLOCK as usize) {
            let mean = |image: &image::RgbImage, c: usize| {
                let (w, h) = (BLOCK.min(width - x), BLOCK.min(height - y));
                let pixels =
                    (0..w * h).map(|i| f64::from(image.get_pixel(x + i % w, y + i / w).0[c]));
                pixels.sum::<f64>() / f64::from(w * h)
            };
            all += 1;
            other += u32::from((0..3).any(|c| (mean(a, c) - mean(b, c)).abs() > ALIKE));
        }
    }
    f64::from(other) / f64::from(all)
}

#[test]
fn report_matches_golden_screenshots() {
    let Some(mut browser) = Browser::start(&[]) else {
        return;
    };
    for (name, screen, colours) in [
        ("report_light", [1440, 900], "light"),
        ("report_dark", [1280, 800], "dark"),
        ("report_phone", [390, 1600], "light"),
    ] {
        size(&mut browser, screen, 1);
        scheme(&mut browser, colours);
        open(&mut browser, "#frame=30");
        browser.eval(STEADY);
        let shot = browser.call("Page.captureScreenshot", &json!({"format": "png"}));
        let seen = image::load_from_memory(&bytes(&shot["data"])).unwrap();
        let small = seen.resize_exact(
            screen[0] / KEPT,
            screen[1] / KEPT,
            image::imageops::FilterType::Triangle,
        );
        let small = small.to_rgb8();
        let file =
            PathBuf::from(env!("CARGO_MANIFEST_DIR")).join(format!("tests/golden/{name}.png"));
        if std::env::var_os("STILLPOINT_BLESS").is_some() {
            small.save(&file).unwrap();
            continue;
        }
        let kept = image::open(&file).unwrap().to_rgb8();
        let found = difference(&kept, &small);
        if found > OTHER {
            let other = std::env::temp_dir().join(format!("{name}.png"));
            seen.save(&other).unwrap();
            panic!(
                "{name}: {:.1} % of it look otherwise than {}; it is in {}; if that is intended, renew them: STILLPOINT_BLESS=1 cargo test -p stillpoint-cli --test all report_looks",
                100.0 * found,
                file.display(),
                other.display()
            );
        }
        // Control: a page without map or image is detected.
        for part in ["#scene", "#picture"] {
            browser.eval(&format!(
                "document.querySelector('{part}').style.visibility = 'hidden'"
            ));
            let shot = browser.call("Page.captureScreenshot", &json!({"format": "png"}));
            let seen = image::load_from_memory(&bytes(&shot["data"])).unwrap();
            let small = seen.resize_exact(
                screen[0] / KEPT,
                screen[1] / KEPT,
                image::imageops::FilterType::Triangle,
            );
            assert!(
                difference(&kept, &small.to_rgb8()) > OTHER,
                "{name} without {part}"
            );
            browser.eval(&format!(
                "document.querySelector('{part}').style.visibility = ''"
            ));
        }
    }
    assert_eq!(browser.errors, [""; 0]);
}

#[test]
fn plots_and_page_have_one_palette() {
    let read = |name: &str| std::fs::read_to_string(MADE.result.join(name)).unwrap();
    let (page, plot) = (read("report.html"), read("plot.svg"));
    for (name, what) in [
        ("accent", "an estimate"),
        ("truth", "the truth"),
        ("ink", "words"),
    ] {
        let rest = page.split(&format!(" --{name}: ")).nth(1).unwrap();
        let colour = &rest[..7];
        assert!(
            plot.contains(colour),
            "{what} is {colour} in the page, and no such colour is in the plot"
        );
    }
}
