use super::*;
use proptest::prelude::*;
use stillpoint_detection::{BoundingBox, ClassId, Detection};

fn detection() -> impl Strategy<Value = Detection> {
    let number = -1e4..1e4_f64;
    let numbers = [number.clone(), number.clone(), number.clone(), number];
    (0..80_u8, 0.0..1.0_f32, numbers).prop_map(|(class, score, [x0, y0, x1, y1])| Detection {
        class: ClassId(class),
        score,
        bounds: BoundingBox { x0, y0, x1, y1 },
    })
}

fn said() -> impl Strategy<Value = Result<Detections, DetectError>> {
    let frame = any::<u32>().prop_map(FrameId);
    let boxes = proptest::collection::vec(detection(), 0..3);
    let size = || (any::<u16>(), any::<u16>()).prop_map(|(w, h)| (w.into(), h.into()));
    prop_oneof![
        (frame.clone(), -1e10..1e10_f64, boxes).prop_map(|(frame, stamp, items)| Ok(Detections {
            frame,
            stamp,
            items
        })),
        frame
            .clone()
            .prop_map(|frame| Err(DetectError::NoColour { frame })),
        (frame.clone(), size(), size()).prop_map(|(frame, expected, found)| Err(
            DetectError::ImageSize {
                frame,
                expected,
                found
            }
        )),
        (frame.clone(), any::<String>())
            .prop_map(|(frame, reason)| Err(DetectError::Runtime { frame, reason })),
        (frame, any::<String>(), any::<String>()).prop_map(|(frame, expected, found)| Err(
            DetectError::Output {
                frame,
                expected,
                found
            }
        )),
    ]
}

fn sample() -> impl Strategy<Value = ImuSample> {
    let vector = || proptest::array::uniform3(-1e3..1e3_f64);
    (-1e10..1e10_f64, vector(), vector()).prop_map(|(stamp, angular_rate, specific_force)| {
        ImuSample {
            stamp,
            angular_rate,
            specific_force,
        }
    })
}

fn stand() -> impl Strategy<Value = OdometrySample> {
    let vector = || proptest::array::uniform3(-1e3..1e3_f64);
    let turn = proptest::array::uniform4(-1.0..1.0_f64);
    let sigmas = proptest::option::of(proptest::array::uniform2(0.0..10.0_f64));
    (-1e10..1e10_f64, vector(), turn, sigmas).prop_map(|(stamp, position, orientation, sigmas)| {
        OdometrySample {
            stamp,
            position,
            orientation,
            sigmas,
        }
    })
}

fn entry() -> impl Strategy<Value = LogEntry> {
    let keyframe = || any::<u32>().prop_map(KeyframeId);
    prop_oneof![
        (any::<u32>(), -1e10..1e10_f64).prop_map(|(n, stamp)| LogEntry::TrackFrame {
            frame: FrameId(n),
            stamp
        }),
        any::<u64>().prop_map(|answer| LogEntry::TrackView { answer }),
        any::<u64>().prop_map(|answer| LogEntry::TrackPlaces { answer }),
        (any::<u32>(), said()).prop_map(|(n, said)| LogEntry::TrackDetections {
            next: FrameId(n),
            said
        }),
        proptest::collection::vec(sample(), 0..4)
            .prop_map(|samples| LogEntry::TrackInertial { samples }),
        proptest::collection::vec(stand(), 0..4)
            .prop_map(|samples| LogEntry::TrackOdometry { samples }),
        Just(LogEntry::TrackEnd),
        any::<u32>().prop_map(|features| LogEntry::TrackEffort { features }),
        (any::<u32>(), any::<u32>()).prop_map(|(neighbours, window)| LogEntry::MapEffort {
            effort: MappingEffort { neighbours, window }
        }),
        keyframe().prop_map(|keyframe| LogEntry::MapKeyframe { keyframe }),
        keyframe().prop_map(|keyframe| LogEntry::MapRejudge { keyframe }),
        (keyframe(), keyframe()).prop_map(|(first, last)| LogEntry::MapRevoke { first, last }),
        any::<u64>().prop_map(|base_version| LogEntry::MapCorrect { base_version }),
        (keyframe(), any::<u64>()).prop_map(|(keyframe, map_version)| LogEntry::LoopKeyframe {
            keyframe,
            map_version
        }),
        (keyframe(), any::<u64>()).prop_map(|(keyframe, map_version)| LogEntry::LoopRejudged {
            keyframe,
            map_version
        }),
        any::<u64>().prop_map(|map_version| LogEntry::LoopRevoked { map_version }),
        any::<u64>().prop_map(|map_version| LogEntry::LoopCorrected { map_version }),
    ]
}

fn log() -> impl Strategy<Value = RunLog> {
    let entries = proptest::collection::vec(entry(), 0..12);
    let about = prop_oneof![any::<String>(), "[a-z\"|\r\n ]{0,20}"];
    (any::<u64>(), about, entries, any::<u64>()).prop_map(
        |(fingerprint, about, entries, trajectory)| RunLog {
            fingerprint,
            about,
            entries,
            trajectory,
        },
    )
}

proptest! {
    #[test]
    fn log_round_trips_through_text(log in log()) {
        prop_assert_eq!(RunLog::from_bytes(log.to_text().as_bytes()), Ok(log));
    }

    #[test]
    fn changed_byte_is_detected(log in log(), at in any::<prop::sample::Index>(), change in 1..=255_u8) {
        let mut bytes = log.to_text().into_bytes();
        let at = at.index(bytes.len() - 1);
        bytes[at] ^= change;
        prop_assert!(RunLog::from_bytes(&bytes).is_err_and(|e| e.line > 0));
    }

    #[test]
    fn parser_handles_any_text(log in log(), at in any::<prop::sample::Index>(), with in "[ -~\n]{0,6}", cut in 0..6_usize) {
        let text = log.to_text();
        let at = at.index(text.len());
        let end = (at + cut).min(text.len());
        // Without the checksum: input that it accepts by chance must parse consistently.
        if let Ok(read) = RunLog::parse(&format!("{}{with}{}", &text[..at], &text[end..])) {
            let again = RunLog::from_bytes(read.to_text().as_bytes());
            prop_assert!(again.is_ok_and(|again| again.to_text() == read.to_text()));
        }
    }

    #[test]
    fn truncated_log_is_refused(log in log(), at in any::<prop::sample::Index>()) {
        let bytes = log.to_text().into_bytes();
        prop_assert!(RunLog::from_bytes(&bytes[..at.index(bytes.len() - 1)]).is_err());
    }
}

#[test]
fn errors_name_the_line() {
    let log = RunLog {
        fingerprint: 7,
        about: "seed = 3".to_owned(),
        entries: vec![
            LogEntry::TrackFrame {
                frame: FrameId(3),
                stamp: 0.1,
            },
            LogEntry::MapKeyframe {
                keyframe: KeyframeId(3),
            },
        ],
        trajectory: 9,
    };
    let text = log.to_text();
    let error = |from: &str, to: &str| {
        let changed = text.replacen(from, to, 1);
        RunLog::from_bytes(changed.as_bytes())
            .unwrap_err()
            .to_string()
    };
    for (from, to, expected) in [
        (
            "log 1",
            "log 2",
            "line 1: expected \"stillpoint run log 1\", found \"stillpoint run log 2\"",
        ),
        (
            "frame 3",
            "frame -3",
            "line 4: expected the number of a frame, found \"frame -3 0.1\"",
        ),
        (
            "map-keyframe 3",
            "map-keyframe 4",
            "line 7: expected \"end 2 ",
        ),
        (
            "end 2",
            "end 3",
            "line 7: expected 2 entries, found \"end 3",
        ),
        (
            "| seed",
            "| \"seed",
            "line 3: expected a text in quotes, found \"| \\\"seed = 3\"",
        ),
        ("| seed", "seed", "line 3: expected an entry"),
        ("trajectory", "sidetrack", "line 6: expected an entry"),
    ] {
        let found = error(from, to);
        assert!(found.starts_with(expected), "{found}");
    }
}
