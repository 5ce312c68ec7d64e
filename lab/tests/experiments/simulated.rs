//! Experiments on simulated scenes and synthetic maps.

use super::{Done, lab, number, scratch};

#[test]
fn crowds_have_a_row_per_method_and_a_failing_control() {
    let run = |frames: &str| lab(&["crowds", "--seeds", "1", "--frames", frames, "crowd_static"]);
    let done = run("24").with_code(0);
    let verdicts: Vec<&str> = done.rows().iter().map(|row| row[10]).collect();
    assert_eq!(verdicts, ["met", "met", "short"], "{}", done.out);
    // In three frames people hardly move: the control meets its bound, which fails the experiment.
    let done = run("3").with_code(1);
    assert_eq!(done.rows()[2][10], "met", "{}", done.out);
}

#[test]
fn covariance_rows_need_a_second_of_motion() {
    let run = |frames: &str| lab(&["covariance", "sim:xyz@1", "--frames", frames]);
    let done = run("45");
    let (rows, code) = (done.rows(), done.code);
    assert!(code < 2 && rows.len() == 1, "{}{}", done.out, done.errors);
    assert_eq!(number(rows[0][1]), 45.0);
    assert!((0.5..=1.0).contains(&number(rows[0][2])), "{}", done.out);
    assert_eq!(code == 0, rows[0][9] == "met, met");
    assert!(
        run("10")
            .with_code(2)
            .errors
            .contains("over more than a second")
    );
}

#[test]
fn unobserved_readout_time_fails_the_verdict() {
    // In ten frames at 35 deg/s the estimate stays at its initial 0, which is correct only for a global shutter.
    let done = lab(&["readout", "--seeds", "2", "--frames", "10", "rpy"]).with_code(1);
    let verdicts: Vec<&str> = done.rows().iter().map(|row| row[9]).collect();
    assert_eq!(verdicts[0], "met", "{}", done.out);
    assert!(verdicts[2].starts_with("short: readout"), "{}", done.out);
}

#[test]
fn sensors_are_compared_with_runs_without_them() {
    let run = |sensor, scene| lab(&[sensor, "--seeds", "1", "--frames", "10", scene]);
    let inertial = run("inertial", "xyz").with_code(0);
    let names: Vec<&str> = inertial.rows().iter().map(|row| row[1]).collect();
    assert_eq!(names, ["without", "with", "mounted wrongly"]);
    assert_eq!(inertial.rows()[1][10], "met");
    let odometry = run("odometry", "xyz").with_code(0);
    assert_eq!(odometry.rows().len(), 6, "{}", odometry.out);
    assert_eq!(odometry.rows()[0][10], "");
}

#[test]
fn degraded_detectors_change_the_object_scores() {
    let run = |more: &[&str]| {
        let tiny = ["objects", "--seeds", "1", "--frames", "150", "walking_xyz"];
        lab(&[&tiny[..], more].concat()).with_code(0)
    };
    let (plain, worse) = (run(&[]), run(&["--alarms", "--bursts"]));
    assert_eq!(plain.rows().len(), 1, "{}", plain.out);
    assert_ne!(plain.out, worse.out);
}

#[test]
fn briefly_seen_objects_miss_the_bounds() {
    let done = lab(&["things", "xyz", "--frames", "6", "--all"]).with_code(1);
    assert!(done.out.contains("a bar is missed"), "{}", done.out);
    assert!(
        done.out.contains("true desk at") || done.out.contains("true "),
        "{}",
        done.out
    );
    assert_eq!(done.rows().len(), 1);
}

#[test]
fn room_variants_are_compared_with_the_default_room() {
    let done = lab(&["scale", "rooms", "--seeds", "1", "--seconds", "0.4", "xyz"]).with_code(0);
    let rows = done.rows();
    assert_eq!(rows.len(), 9, "{}", done.out);
    assert_eq!(rows[0][5], "1.00");
    assert!(number(rows[5][4]) > 0.0);
}

#[test]
fn solvers_optimise_maps_of_all_kinds() {
    for (kind, said) in [
        ("path", "bundle: "),
        ("laps", "bundle: "),
        ("graph", "graph: "),
    ] {
        let done = lab(&["scale", "maps", kind, "60"]).with_code(0);
        assert!(
            done.out.contains(said) && done.out.contains(" -> "),
            "{}",
            done.out
        );
    }
}

#[test]
fn loops_are_listed_by_scene_and_hard_rows_have_a_bound() {
    let table = |only| {
        lab(&[
            "loops", "table", "--seeds", "2", "--frames", "16", "--only", only,
        ])
    };
    let easy = table("loop_two_rooms.2").with_code(0);
    assert_eq!(easy.rows()[0][..4], ["`loop_two_rooms`", "2", "2", "0"]);
    // Control: two frames close no loop, where one has to be closed.
    let hard = table("loop_two_rooms.8").with_code(1);
    assert!(hard.out.contains("0 of 2 hard runs"), "{}", hard.out);
    let scene = ["loops", "scene", "xyz", "--seeds", "1", "--frames", "8"];
    let scene = lab(&scene).with_code(0);
    assert!(scene.out.contains("median ATE without"), "{}", scene.out);
}

#[test]
fn loop_is_closed_at_the_end_of_a_long_path() {
    let done = lab(&["closing", "180", "450"]).with_code(0);
    for said in ["Closed", "recognise", "adjust", "landmarks merged"] {
        assert!(done.out.contains(said), "{said}: {}", done.out);
    }
}

#[test]
fn soak_has_a_row_per_minute() {
    let done = lab(&["soak", "--minutes", "1", "--rate", "1", "--dense-mb", "1"]).with_code(0);
    assert!(done.out.contains("no verdict"), "{}", done.out);
    let rows = done.rows();
    assert_eq!((rows.len(), rows[0].len()), (1, 11), "{}", done.out);
}

#[test]
fn allocations_are_counted_per_stage() {
    let done = lab(&["allocations", "--frames", "114"]).with_code(0);
    let rows = done.rows();
    let filter = rows.iter().find(|row| row[0] == "filter").unwrap();
    assert!(number(filter[1]) >= 1.0, "{}", done.out);
}

#[test]
fn vector_and_scalar_kernels_agree() {
    let folder = scratch("kernels");
    let folder = folder.to_str().unwrap();
    lab(&["kernels", folder, "--render"]).with_code(0);
    for kernel in [
        "gray",
        "scale",
        "smooth",
        "corners",
        "orientation",
        "descriptors",
        "extract",
        "flow",
        "distances",
        "words",
        "fuse",
        "frame",
    ] {
        let found = |how: &[&str]| {
            let done = lab(&[&["kernels", folder, kernel, "--times", "2"], how].concat());
            let out = done.with_code(0).out;
            out.split_once(": ").unwrap().1.to_owned()
        };
        assert_eq!(found(&[]), found(&["--scalar"]), "{kernel}");
    }
}

#[test]
fn scene_difficulty_is_measured_by_feature_tracking() {
    let done = lab(&["difficulty", "--window", "2", "xyz", "walking_static"]).with_code(0);
    let rows = done.rows();
    assert_eq!(rows.len(), 9, "{}", done.out);
    assert!(
        number(rows[3][1]) > 0.5,
        "inliers of true motion: {}",
        done.out
    );
    assert_eq!(rows[8][0], "`walking_static`");
}

#[test]
fn place_recognition_methods_have_a_row_each() {
    let done = lab(&["place", "compare", "--seeds", "1", "--frames", "40"]).with_code(0);
    assert!(done.out.contains("kitchen is not there"), "{}", done.out);
    let rows = done.rows();
    assert_eq!((rows.len(), rows[0].len()), (6, 6), "{}", done.out);
}

#[test]
fn surfaces_are_compared_with_ground_truth() {
    let dense = |words: &[&str]| lab(&[&["dense"], words].concat()).with_code(0);
    let millimetres = |done: &Done| number(done.rows()[0][2]);
    let tiny = ["xyz", "--frames", "10"];
    let exact = millimetres(&dense(&[&["true"], &tiny[..]].concat()));
    assert!((0.1..20.0).contains(&exact), "{exact} mm");
    // Control: larger voxels are less accurate.
    let coarse = dense(&[&["true"], &tiny[..], &["--voxel", "0.08"]].concat());
    assert!(millimetres(&coarse) > exact, "{}", coarse.out);
    let merged = dense(&[&["merge"], &tiny[..]].concat());
    let names: Vec<&str> = merged.rows().iter().map(|row| row[0]).collect();
    assert_eq!(names[2..], ["both, merged", "in one run"], "{}", merged.out);
    assert!(millimetres(&dense(&["run", "xyz", "scripted", "--frames", "10"])) < 20.0);
    let folder = scratch("dumped");
    let folder = folder.to_str().unwrap();
    dense(&["dump-sim", "xyz", folder, "--frames", "10"]);
    let time = dense(&["time", folder, "--rounds", "1"]).out;
    assert!(time.contains("(5 frames, 1 rounds"), "{time}");
}
