//! `--record`: results as ROS 2 messages; recording does not change the results.

use crate::common::{check, simulate, stderr, stdout, stillpoint};
use std::collections::BTreeMap;
use std::path::{Path, PathBuf};
use std::sync::LazyLock;
use stillpoint::datasets::{StampedPose, trajectory};
use stillpoint::geometry::nalgebra::{Quaternion, UnitQuaternion};
use stillpoint::geometry::{Se3, Vec3};
use stillpoint::ros_events::axes;
use stillpoint::ros_messages as ros;
use stillpoint::ros_messages::{Format, Message, Wire};
use tempfile::TempDir;

const FRAMES: usize = 40;

struct Made {
    dir: TempDir,
    data: PathBuf,
    result: PathBuf,
    file: PathBuf,
}

static MADE: LazyLock<Made> = LazyLock::new(|| {
    let dir = tempfile::tempdir().unwrap();
    let (data, result) = (dir.path().join("walk"), dir.path().join("result"));
    let file = dir.path().join("run.mcap");
    simulate(&data, "walking_xyz", FRAMES);
    run(&data, &result, &["--record", text(&file)]);
    Made {
        dir,
        data,
        result,
        file,
    }
});

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

/// Runs a data set with its own detections, and returns stdout.
#[track_caller]
fn run(data: &Path, result: &Path, more: &[&str]) -> String {
    let script = format!("scripted:{}", data.join("detections.csv").display());
    let args = ["run", text(data), "--detector", &script, "--no-report"];
    let output = stillpoint([&args[..], &["--out", text(result)], more].concat());
    check(&output, 0, &[]);
    stdout(&output)
}

/// Topics with the type, the encoding and the bytes of their messages.
type Topics = BTreeMap<String, Vec<(String, u64, Vec<u8>)>>;

fn topics(file: &Path) -> Topics {
    let bytes = std::fs::read(file).unwrap();
    let mut topics = Topics::new();
    for message in mcap::MessageStream::new(&bytes).unwrap() {
        let message = message.unwrap();
        let channel = message.channel;
        assert_eq!(channel.message_encoding, "cdr");
        let schema = channel.schema.as_ref().unwrap();
        assert_eq!(schema.encoding, "ros2msg");
        topics.entry(channel.topic.clone()).or_default().push((
            schema.name.clone(),
            message.log_time,
            message.data.into_owned(),
        ));
    }
    topics
}

fn decode<'a, T: Message + Wire<'a>>(topics: &'a Topics, topic: &str) -> Vec<(u64, T)> {
    let decoded = |(name, time, bytes): &'a (String, u64, Vec<u8>)| {
        assert_eq!(name, T::NAME);
        let message = ros::from_bytes::<T>(bytes, Format::CdrLittleEndian);
        (*time, message.unwrap())
    };
    topics[topic].iter().map(decoded).collect()
}

fn pose(transform: &ros::Transform) -> Se3 {
    let (t, q) = (&transform.translation, &transform.rotation);
    Se3::new(
        UnitQuaternion::new_unchecked(Quaternion::new(q.w, q.x, q.y, q.z)),
        Vec3::new(t.x, t.y, t.z),
    )
}

/// The poses of the transforms `map -> odom -> camera_link`, converted back to camera axes.
fn trajectory_of(topics: &Topics) -> String {
    let poses: Vec<StampedPose> = decode::<ros::TfMessage<'_>>(topics, "/tf")
        .iter()
        .map(|(time, message)| {
            let [map_from_odom, odom_from_body] = &message.transforms[..] else {
                panic!("expected two transforms");
            };
            let chain = pose(&map_from_odom.transform) * pose(&odom_from_body.transform);
            StampedPose {
                stamp: *time as f64 * 1e-9,
                world_from_camera: axes::pose_to_optical(&chain),
            }
        })
        .collect();
    trajectory::format(&poses)
}

fn online(result: &Path) -> String {
    std::fs::read_to_string(result.join("trajectory_online.txt")).unwrap()
}

#[test]
fn recorded_transforms_equal_the_online_trajectory() {
    let expected = online(&MADE.result);
    assert!(expected.lines().count() > FRAMES / 2);
    assert_eq!(trajectory_of(&topics(&MADE.file)), expected);
}

#[test]
fn every_frame_has_messages_and_a_full_size_picture() {
    let topics = topics(&MADE.file);
    let poses = online(&MADE.result).lines().count() - 1;
    for (topic, expected) in [
        ("/tf", poses),
        ("/stillpoint/odometry", poses),
        ("/stillpoint/objects", poses),
        ("/stillpoint/objects/markers", poses),
        ("/stillpoint/camera_info", FRAMES),
        ("/stillpoint/image/compressed", FRAMES),
        ("/diagnostics", FRAMES),
    ] {
        assert_eq!(topics[topic].len(), expected, "{topic}");
    }
    assert!(topics["/stillpoint/map"].len() >= 2);
    let image = &decode::<ros::CompressedImage<'_>>(&topics, "/stillpoint/image/compressed")[3].1;
    let picture = image::load_from_memory(&image.data).unwrap().to_rgb8();
    let info = &decode::<ros::CameraInfo<'_>>(&topics, "/stillpoint/camera_info")[0].1;
    assert_eq!(picture.dimensions(), (info.width, info.height));
    // Rejected features on the people are marked in red.
    let red = |p: &image::Rgb<u8>| p.0[0] > 180 && p.0[1] < 90 && p.0[2] < 90;
    assert!(picture.pixels().filter(|p| red(p)).count() > 20);
}

#[test]
fn recording_does_not_change_the_run() {
    let without = MADE.dir.path().join("without");
    run(&MADE.data, &without, &[]);
    for file in ["trajectory.txt", "trajectory_online.txt", "frames.csv"] {
        let read = |folder: &Path| std::fs::read(folder.join(file)).unwrap();
        assert!(read(&without) == read(&MADE.result), "{file}");
    }
}

#[test]
fn replay_records_the_same_messages_without_pictures() {
    let log = MADE.result.join("run.log");
    let out = MADE.dir.path().join("replayed");
    let file = MADE.dir.path().join("replayed.mcap");
    let args = ["replay", text(&log), text(&MADE.data), "--no-report"];
    let more = ["--out", text(&out), "--record", text(&file)];
    let output = stillpoint([&args[..], &more, &["--no-record-images"]].concat());
    check(&output, 0, &[]);
    assert!(
        stdout(&output).contains("messages in "),
        "{}",
        stdout(&output)
    );
    let mut expected = topics(&MADE.file);
    expected.remove("/stillpoint/camera_info");
    expected.remove("/stillpoint/image/compressed");
    assert!(topics(&file) == expected);
}

#[test]
fn live_run_records_its_reported_poses() {
    let out = MADE.dir.path().join("live");
    let file = MADE.dir.path().join("live.mcap");
    let said = run(
        &MADE.data,
        &out,
        &["--live=all", "--record", text(&file), "--no-record-images"],
    );
    assert!(said.contains("live.mcap"), "{said}");
    assert_eq!(trajectory_of(&topics(&file)), online(&out));
}

#[test]
fn surface_and_grid_are_recorded_at_the_end() {
    let (result, file) = (
        MADE.dir.path().join("fused"),
        MADE.dir.path().join("fused.mcap"),
    );
    let more = [
        "--dense",
        "--voxel",
        "0.04",
        "--record",
        text(&file),
        "--no-record-images",
    ];
    run(&MADE.data, &result, &more);
    let topics = topics(&file);
    let clouds = decode::<ros::PointCloud2<'_>>(&topics, "/stillpoint/surface");
    let grids = decode::<ros::OccupancyGrid<'_>>(&topics, "/stillpoint/grid");
    assert_eq!((clouds.len(), grids.len()), (1, 1));
    let (cloud, grid) = (&clouds[0].1, &grids[0].1);
    assert!(cloud.width > 300, "{}", cloud.width);
    assert_eq!(&*cloud.header.frame_id, "map");
    let cells = grid.data.iter();
    assert_eq!(cells.len() as u32, grid.info.width * grid.info.height);
    for state in [-1, 0, 100] {
        assert!(cells.clone().any(|c| *c == state), "no cell is {state}");
    }
    assert!((grid.info.resolution - 0.05).abs() < 1e-6);
    assert!(result.join("grid.pgm").exists());
}

#[test]
fn complete_recording_replaces_an_older_one() {
    let dir = tempfile::tempdir().unwrap();
    let (file, out) = (dir.path().join("old.mcap"), dir.path().join("out"));
    std::fs::write(&file, "old").unwrap();
    let args = ["run", "nothing/there", "--record", text(&file)];
    let output = stillpoint([&args[..], &["--out", text(&out)]].concat());
    check(&output, 2, &["nothing/there"]);
    assert_eq!(std::fs::read_to_string(&file).unwrap(), "old");
    let part = ["--max-frames", "3", "--no-record-images", "--record"];
    run(&MADE.data, &out, &[&part[..], &[text(&file)]].concat());
    assert_eq!(topics(&file)["/diagnostics"].len(), 3);
    let names = std::fs::read_dir(dir.path()).unwrap();
    assert_eq!(names.count(), 2, "nothing is left beside");
}

#[test]
fn unwritable_recording_path_is_refused_before_the_run() {
    let dir = tempfile::tempdir().unwrap();
    let folder = text(dir.path());
    let inside = dir.path().join("absent/run.mcap");
    let same = dir.path().join("both");
    for (more, said) in [
        (vec!["--record", folder], "expected a file"),
        (vec!["--record", text(&inside)], "absent"),
        (
            vec!["--record", text(&same), "--save-map", text(&same)],
            "--record",
        ),
        (vec!["--no-record-images"], "--record"),
    ] {
        let args = ["run", text(&MADE.data), "--detector", "none"];
        let output = stillpoint([&args[..], &more].concat());
        assert!(stderr(&output).contains(said), "{}", stderr(&output));
        check(&output, 2, &[]);
    }
}
