//! Scripts: correct replay, and rejection of malformed ones with their place.

use proptest::prelude::*;
use stillpoint_detection::{
    BoundingBox, ClassId, Detection, Detector, DetectorKind, NoDetector, SCRIPT_HEADER, ScriptRow,
    ScriptedDetector, format_script, parse_script,
};
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame};

fn frame(id: u32, stamp: f64) -> RgbdFrame {
    RgbdFrame {
        id: FrameId(id),
        stamp,
        depth_stamp: stamp,
        gray: GrayImage::default(),
        colour: None,
        depth: DepthImage::default(),
    }
}

fn row(stamp: f64, score: f32) -> ScriptRow {
    let bounds = BoundingBox {
        x0: 1.0,
        y0: 2.0,
        x1: 3.0,
        y1: 4.0,
    };
    let detection = Detection {
        class: ClassId::PERSON,
        score,
        bounds,
    };
    ScriptRow { stamp, detection }
}

fn scores(detector: &mut ScriptedDetector, stamp: f64) -> Vec<f32> {
    let found = detector.detect(&frame(0, stamp)).unwrap();
    found.items.iter().map(|d| d.score).collect()
}

#[test]
fn script_is_played_back_by_stamp() {
    let text = "\
# made by hand
timestamp,class,score,x0,y0,x1,y1

1305031102.211214, person, 0.5, -0.5, 0, 10.25, 20
1305031102.175304,dining table,0.25,1,2,3,4
1305031102.175304,56,0.75,5,6,7,8
";
    let mut detector = ScriptedDetector::parse("boxes.csv", text).unwrap();
    let found = detector.detect(&frame(3, 1305031102.175304)).unwrap();
    assert_eq!((found.frame, found.stamp), (FrameId(3), 1305031102.175304));
    let seen: Vec<_> = found
        .items
        .iter()
        .map(|d| (d.class.name(), d.score, d.bounds.x0))
        .collect();
    assert_eq!(seen, [("chair", 0.75, 5.0), ("dining table", 0.25, 1.0)]);
    let found = detector.detect(&frame(4, 1305031102.2112)).unwrap();
    let expected = BoundingBox {
        x0: -0.5,
        y0: 0.0,
        x1: 10.25,
        y1: 20.0,
    };
    assert_eq!(found.items.len(), 1);
    assert_eq!(found.items[0].bounds, expected);
    assert!(
        detector
            .detect(&frame(5, 1305031102.2433))
            .unwrap()
            .items
            .is_empty()
    );
    let used = detector.usage();
    assert_eq!(
        (
            used.rows,
            used.rows_matched,
            used.frames,
            used.frames_matched
        ),
        (3, 3, 3, 2)
    );
    assert_eq!(detector.remark(), None);
}

#[test]
fn stamps_match_within_a_millisecond() {
    let rows = vec![
        row(10.0, 0.9),
        row(10.01, 0.8),
        row(9.9995, 0.95),
        row(10.0005, 1.0),
    ];
    let mut detector = ScriptedDetector::new("rows", rows).unwrap();
    assert_eq!(
        scores(&mut detector, 10.0),
        [1.0, 0.95, 0.9],
        "best first although the stamps differ"
    );
    assert_eq!(scores(&mut detector, 10.0109), [0.8]);
    assert_eq!(scores(&mut detector, 10.0111), [] as [f32; 0]);
    assert_eq!(scores(&mut detector, f64::NAN), [] as [f32; 0]);
}

#[test]
fn script_of_another_recording_gives_a_remark() {
    let mut detector =
        ScriptedDetector::new("other.csv", vec![row(1.0, 0.5), row(2.0, 0.5)]).unwrap();
    assert_eq!(detector.remark(), None, "nothing was looked at yet");
    detector.detect(&frame(0, 100.0)).unwrap();
    let remark = detector.remark().unwrap();
    assert!(
        remark.contains("other.csv: none of its 2 rows, 1.000000 to 2.000000 s"),
        "{remark}"
    );
    detector.detect(&frame(1, 2.0)).unwrap();
    assert_eq!(detector.remark(), None);
    let empty = ScriptedDetector::parse("empty.csv", SCRIPT_HEADER).unwrap();
    assert!(empty.remark().unwrap().contains("no detections"));
}

/// Text, line number, and a part of the message.
#[test]
fn malformed_lines_are_reported_with_their_number() {
    let cases = [
        (
            "1,person,0.5,1,2,3",
            1,
            "expected 7 columns timestamp,class,score,x0,y0,x1,y1, found 6 in",
        ),
        ("1 person 0.5 1 2 3 4", 1, "separate the columns by commas"),
        (
            "1,person,0.5,1,2,3,4\n\n1,persn,0.5,1,2,3,4",
            3,
            "such as \"person\", or its number from 0 to 79, found \"persn\"",
        ),
        ("1,80,0.5,1,2,3,4", 1, "found \"80\""),
        ("1,-1,0.5,1,2,3,4", 1, "found \"-1\""),
        (
            "one,person,0.5,1,2,3,4",
            1,
            "expected a number as timestamp, found \"one\"",
        ),
        (
            "nan,person,0.5,1,2,3,4",
            1,
            "expected a finite stamp, found NaN",
        ),
        (
            "1,person,50,1,2,3,4",
            1,
            "expected a score from 0 to 1, found 50",
        ),
        (
            "1,person,nan,1,2,3,4",
            1,
            "expected a score from 0 to 1, found NaN",
        ),
        (
            "1,person,0.5,3,2,1,4",
            1,
            "expected a box with x0 < x1 and y0 < y1, found 3,2,1,4",
        ),
        ("1,person,0.5,1,2,inf,4", 1, "found 1,2,inf,4"),
        (
            "# x\ntimestamp,class,x0,y0,x1,y1,score",
            2,
            "expected a number as timestamp",
        ),
        (
            "1,person,0.5,1,2,3,4\ntimestamp,class,score,x0,y0,x1,y1",
            2,
            "expected a number as timestamp",
        ),
    ];
    for (text, line, part) in cases {
        let error = ScriptedDetector::parse("bad.csv", text).unwrap_err();
        let message = error.to_string();
        assert!(
            message.starts_with(&format!("bad.csv:{line}: expected ")),
            "{message}"
        );
        assert!(message.contains(part), "{part} is not in: {message}");
    }
}

#[test]
fn rows_from_code_are_validated_like_text() {
    let mut bad = row(1.0, 0.5);
    bad.detection.class = ClassId(80);
    let error = ScriptedDetector::new("rows", vec![row(1.0, 0.5), bad]).unwrap_err();
    assert_eq!(error.line, 2);
    assert!(ScriptedDetector::new("rows", vec![row(f64::INFINITY, 0.5)]).is_err());
    assert!(ScriptedDetector::new("rows", vec![row(1.0, 1.5)]).is_err());
}

#[test]
fn fingerprint_is_the_digest_of_the_text() {
    let text = format_script(&[row(1.0, 0.5)]);
    assert_eq!(
        text,
        "timestamp,class,score,x0,y0,x1,y1\n1.000000,person,0.500000,1.000,2.000,3.000,4.000\n"
    );
    let parsed = ScriptedDetector::parse("a", &text).unwrap().info();
    assert_eq!(parsed.kind, DetectorKind::Scripted);
    // printf 'timestamp,...' | sha256sum
    assert_eq!(parsed.sha256.as_deref(), Some(DIGEST));
    assert_eq!(
        ScriptedDetector::new("b", vec![row(1.0, 0.5)])
            .unwrap()
            .info()
            .sha256,
        parsed.sha256
    );
    let json = serde_json::to_value(&parsed).unwrap();
    assert_eq!(json["kind"], "scripted");
    assert_eq!(json["runtime"], serde_json::Value::Null);
}

const DIGEST: &str = "35f9e2c352255861d4a4ca8864fe26144a3b1ae7c9dde5a0a99ab5f3081f379f";

#[test]
fn null_detector_detects_nothing() {
    let mut detector: Box<dyn Detector> = Box::new(NoDetector);
    let found = detector.detect(&frame(9, 2.5)).unwrap();
    assert_eq!(
        (found.frame, found.stamp, found.items.len()),
        (FrameId(9), 2.5, 0)
    );
    assert_eq!(
        (detector.info().kind, detector.remark()),
        (DetectorKind::None, None)
    );
}

fn any_row() -> impl Strategy<Value = ScriptRow> {
    let sides = (-1000.0..1000.0f64, 0.01..1000.0f64);
    (0.0..2e9f64, 0..80u8, 0.0..=1.0f32, sides.clone(), sides).prop_map(
        |(stamp, class, score, (x0, w), (y0, h))| {
            let bounds = BoundingBox {
                x0,
                y0,
                x1: x0 + w,
                y1: y0 + h,
            };
            let detection = Detection {
                class: ClassId(class),
                score,
                bounds,
            };
            ScriptRow { stamp, detection }
        },
    )
}

proptest! {
    /// Round trip, up to the decimals written.
    #[test]
    fn scripts_round_trip(rows in prop::collection::vec(any_row(), 0..20)) {
        let read = parse_script("text", &format_script(&rows)).unwrap();
        prop_assert_eq!(read.len(), rows.len());
        for (a, b) in rows.iter().zip(&read) {
            let (p, q) = (a.detection, b.detection);
            prop_assert_eq!(p.class, q.class);
            prop_assert!((a.stamp - b.stamp).abs() < 1e-6);
            prop_assert!((p.score - q.score).abs() < 1e-6);
            let sides = [(p.bounds.x0, q.bounds.x0), (p.bounds.y0, q.bounds.y0), (p.bounds.x1, q.bounds.x1), (p.bounds.y1, q.bounds.y1)];
            prop_assert!(sides.iter().all(|(u, v)| (u - v).abs() < 6e-4));
        }
        // After the first reading the round trip is exact.
        prop_assert_eq!(parse_script("text", &format_script(&read)).unwrap(), read);
    }

    #[test]
    fn row_order_does_not_matter(stamps in prop::collection::vec(0..50u32, 1..30)) {
        // Distinct scores, so that the order is total.
        let rows: Vec<_> = stamps.iter().enumerate().map(|(i, &s)| row(f64::from(s) / 30.0, i as f32 / 64.0)).collect();
        let backwards: Vec<_> = rows.iter().rev().copied().collect();
        let (mut a, mut b) = (ScriptedDetector::new("a", rows).unwrap(), ScriptedDetector::new("b", backwards).unwrap());
        let mut seen = 0;
        for s in 0..50u32 {
            let found = scores(&mut a, f64::from(s) / 30.0);
            prop_assert_eq!(&found, &scores(&mut b, f64::from(s) / 30.0));
            prop_assert!(found.is_sorted_by(|p, q| p > q));
            seen += found.len();
        }
        prop_assert_eq!(seen, stamps.len());
    }

    /// A damaged script gives rows or an error with its name and a line number.
    #[test]
    fn damaged_script_errors_name_the_line(
        rows in prop::collection::vec(any_row(), 1..6), at in any::<prop::sample::Index>(), cut in 0..6_usize,
        with in prop_oneof!["[-0-9a-z,.# \n]{0,6}", "\\PC{0,3}"]
    ) {
        let text = format_script(&rows);
        let at = at.index(text.len());
        let end = (at + cut).min(text.len());
        let damaged = format!("{}{with}{}", &text[..at], &text[end..]);
        if let Err(e) = parse_script("boxes.csv", &damaged) {
            let message = e.to_string();
            let line = message.strip_prefix("boxes.csv:").and_then(|rest| rest.split(':').next());
            let line = line.and_then(|l| l.parse::<usize>().ok());
            prop_assert!(line.is_some_and(|l| l >= 1 && l <= damaged.lines().count()), "{message}");
        }
    }

    #[test]
    fn parser_never_panics(text in "[0-9a-z,.#\\n -]{0,200}") {
        let _ = parse_script("text", &text);
    }
}
