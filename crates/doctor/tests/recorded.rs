//! Recordings of real cameras, if available: they have no faults, and each injected fault is found.

use crate::common::{SECONDS, Stream, assert_well};
use stillpoint_datasets::{Dataset, FrameOptions, OpenOptions};
use stillpoint_doctor::{Setup, Symptom};
use stillpoint_imaging::FrameSource;

fn recorded(name: &str, start: usize) -> Option<Stream> {
    let folder = stillpoint_testdata::recording(name)?;
    let dataset = Dataset::open(&folder, &OpenOptions::default()).unwrap();
    let mut source = dataset
        .frames(&FrameOptions {
            start,
            max_frames: None,
            keep_colour: true,
        })
        .unwrap();
    let mut frames = Vec::new();
    while let Some(frame) = source.next_frame() {
        let frame = frame.unwrap();
        let first = frames
            .first()
            .map_or(frame.stamp, |f: &stillpoint_imaging::RgbdFrame| f.stamp);
        if frame.stamp - first > SECONDS {
            break;
        }
        frames.push(frame);
    }
    let model = dataset.camera();
    Some(Stream {
        name: format!("{name} from {start}"),
        frames,
        setup: Setup {
            camera: model.camera,
            depth_scale: model.depth_scale,
        },
    })
}

#[test]
fn recordings_have_no_findings() {
    for (name, starts) in [
        ("fr1_xyz", [0, 120]),
        ("fr1_xyz_walkers", [0, 120]),
        ("fr1_rpy_walkers", [0, 60]),
        ("corridor_fixed", [0, 100]),
    ] {
        for start in starts {
            let Some(stream) = recorded(name, start) else {
                return;
            };
            assert_well(&stream.name, &stream.report());
        }
    }
}

/// Its depth is not exactly registered to colour.
#[test]
fn kitchen_has_at_most_a_registration_finding() {
    for start in [0, 150] {
        let Some(stream) = recorded("kitchen", start) else {
            return;
        };
        let report = stream.report();
        let other = report
            .findings
            .iter()
            .find(|f| f.symptom != Symptom::Registration);
        assert!(other.is_none(), "{}\n{report}", stream.name);
    }
}

#[test]
fn injected_faults_of_a_recording_are_found() {
    let Some(stream) = recorded("fr1_xyz", 0) else {
        return;
    };
    stream.check_faults();
}
