//! Arguments turned back into text, for a run in a separate process.

use crate::args::models::DetectorArgs;
use crate::args::{ConfigArgs, InputArgs};
use std::ffi::OsString;
use std::path::Path;

/// Placeholder for the recording in a detector argument.
const PLACE: &str = "{}";

/// Whether the detector argument depends on the recording.
pub(crate) fn is_of_recording(detector: &str) -> bool {
    detector.contains(PLACE)
}

/// Input and configuration options for the recording at `path`. The structs are destructured, so that the compiler reports a field that was
/// added and not handled.
pub(crate) fn typed(input: &InputArgs, config: &ConfigArgs, path: &Path) -> Vec<OsString> {
    let InputArgs {
        camera,
        start,
        max_frames,
        topics,
        detector:
            DetectorArgs {
                detector,
                runtime,
                detector_threads,
            },
        strict,
    } = input;
    let ConfigArgs { config, set, seed } = config;
    let mut all: Vec<OsString> = Vec::new();
    let mut add = |option: &str, value: OsString| all.extend([option.into(), value]);
    if let Some(camera) = camera {
        add("--camera", camera.into());
    }
    add("--start", start.to_string().into());
    if let Some(n) = max_frames {
        add("--max-frames", n.to_string().into());
    }
    if let Some(detector) = detector {
        let detector = detector.replace(PLACE, &path.display().to_string());
        add("--detector", detector.into());
    }
    add("--runtime", runtime.name().into());
    add("--detector-threads", detector_threads.to_string().into());
    if let Some(file) = config {
        add("--config", file.into());
    }
    for value in set {
        add("--set", value.into());
    }
    if let Some(seed) = seed {
        add("--seed", seed.to_string().into());
    }
    for (option, topic) in [
        ("--color-topic", &topics.color_topic),
        ("--depth-topic", &topics.depth_topic),
        ("--info-topic", &topics.info_topic),
        ("--truth-topic", &topics.truth_topic),
        ("--imu-topic", &topics.imu_topic),
        ("--odometry-topic", &topics.odometry_topic),
    ] {
        if let Some(topic) = topic {
            add(option, topic.into());
        }
    }
    if let Some(scale) = topics.depth_scale {
        add("--depth-scale", scale.to_string().into());
    }
    let flags = [
        ("--no-imu", topics.no_imu),
        ("--no-odometry", topics.no_odometry),
        ("--strict", *strict),
    ];
    all.extend(flags.iter().filter(|f| f.1).map(|f| f.0.into()));
    all
}

#[cfg(test)]
mod tests {
    use super::*;
    use crate::args::TopicArgs;
    use crate::args::models::RuntimeChoice;

    #[test]
    fn bench_and_batch_options_are_forwarded_to_runs() {
        let input = InputArgs {
            camera: Some("tum_fr3".into()),
            start: 5,
            max_frames: Some(7),
            topics: TopicArgs {
                color_topic: Some("/c".into()),
                depth_topic: Some("/d".into()),
                info_topic: Some("/f".into()),
                truth_topic: Some("/t".into()),
                imu_topic: Some("/i".into()),
                no_imu: true,
                odometry_topic: Some("/o".into()),
                no_odometry: true,
                depth_scale: Some(5000.0),
            },
            detector: DetectorArgs {
                detector: Some("scripted:{}/boxes.csv".into()),
                runtime: RuntimeChoice::Rten,
                detector_threads: 2,
            },
            strict: true,
        };
        let config = ConfigArgs {
            config: Some("my.toml".into()),
            set: vec!["a.b=1".into(), "a.c=2".into()],
            seed: Some(9),
        };
        let expected = "--camera tum_fr3 --start 5 --max-frames 7 --detector scripted:a/boxes.csv --runtime rten \
                        --detector-threads 2 --config my.toml \
                        --set a.b=1 --set a.c=2 --seed 9 --color-topic /c --depth-topic /d --info-topic /f --truth-topic /t \
                        --imu-topic /i --odometry-topic /o --depth-scale 5000 --no-imu --no-odometry --strict";
        let found: Vec<String> = typed(&input, &config, Path::new("a"))
            .iter()
            .map(|a| a.to_string_lossy().into_owned())
            .collect();
        assert_eq!(found.join(" "), expected);
    }
}
