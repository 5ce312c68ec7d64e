//! `run --things`, then `map objects` and `map merge`.

use crate::common::{check, stdout, stillpoint};
use serde_json::Value;
use std::path::Path;

fn text(path: &Path) -> &str {
    path.to_str().unwrap()
}

fn things(level: &Value) -> &Vec<Value> {
    level["things"].as_array().unwrap()
}

#[test]
fn things_are_found_saved_listed_and_kept_by_localize() {
    let dir = tempfile::tempdir().unwrap();
    let at = |name: &str| dir.path().join(name);
    let (data, result, map) = (at("room"), at("result"), at("room.spmap"));
    let simulate = [
        "-q", "simulate", "--scene", "xyz", "--frames", "40", "--jpeg",
    ];
    let more = ["--furniture", "--ideal", "--out", text(&data)];
    check(&stillpoint([&simulate[..], &more].concat()), 0, &[]);
    let script = format!("scripted:{}", data.join("detections.csv").display());
    let run = [
        "-q",
        "run",
        text(&data),
        "--no-report",
        "--detector",
        &script,
    ];
    let more = ["--things", "--out", text(&result), "--save-map", text(&map)];
    // Frequent keyframes, so that so short a map is recognised when it is merged.
    let often = [
        "--set",
        "keyframes.max_view_angle=0",
        "--set",
        "keyframes.min_seconds=0.22",
        "--set",
        "mapping.redundant_share=1",
    ];
    check(&stillpoint([&run[..], &more, &often].concat()), 0, &[]);

    let written = std::fs::read_to_string(result.join("things.json")).unwrap();
    let level: Value = serde_json::from_str(&written).unwrap();
    assert!(things(&level).len() >= 2, "{written}");
    for thing in things(&level) {
        assert!(thing["class"] != "person" && thing["size"][2].as_f64().unwrap() > 0.0);
        let room = &thing["room"];
        let rooms = level["rooms"].as_array().unwrap();
        assert!(rooms.iter().any(|r| r["number"] == *room), "{thing}");
    }
    let listed = stillpoint(["map", "objects", text(&map), "--json"]);
    assert_eq!(stdout(&listed), written);
    let table = stdout(&stillpoint(["map", "objects", text(&map)]));
    assert_eq!(
        table.lines().count(),
        things(&level).len() + level["rooms"].as_array().unwrap().len() + 1,
        "{table}"
    );
    assert!(table.starts_with("room 1: "), "{table}");

    // Localisation leaves the map unchanged, and finds no objects of its own.
    let before = std::fs::read(&map).unwrap();
    let (asked, load) = (at("asked"), ["--localize", text(&map)]);
    let out = ["--out", text(&asked)];
    check(&stillpoint([&run[..], &load, &out].concat()), 0, &[]);
    assert!(std::fs::read(&map).unwrap() == before && !asked.join("things.json").exists());

    // Merging two maps of one room keeps each object once.
    let both = at("both.spmap");
    let merge = ["map", "merge", text(&map), text(&map), "--out", text(&both)];
    check(&stillpoint(merge), 0, &[]);
    let merged = stdout(&stillpoint(["map", "objects", text(&both), "--json"]));
    let merged: Value = serde_json::from_str(&merged).unwrap();
    assert_eq!(merged["rooms"].as_array().unwrap().len(), 1);
    for thing in things(&level) {
        let near = |other: &&Value| {
            let apart = |k: usize| {
                let at = |t: &Value| t["centre"][k].as_f64().unwrap();
                (at(other) - at(thing)).abs()
            };
            other["class"] == thing["class"] && (0..3).all(|k| apart(k) < 0.1)
        };
        let same: Vec<&Value> = things(&merged).iter().filter(near).collect();
        let found = thing["found"].as_u64().unwrap();
        let twice = same.iter().any(|t| t["found"] == 2 * found);
        assert!(twice, "{thing} in {merged}");
    }
}

#[test]
fn map_without_things_explains_how_to_get_them() {
    let dir = tempfile::tempdir().unwrap();
    let (data, map) = (dir.path().join("room"), dir.path().join("room.spmap"));
    crate::common::simulate(&data, "xyz", 4);
    let out = dir.path().join("result");
    let run = [
        "-q",
        "run",
        text(&data),
        "--no-report",
        "--save-map",
        text(&map),
    ];
    check(
        &stillpoint([&run[..], &["--out", text(&out)]].concat()),
        0,
        &[],
    );
    let refused = stillpoint(["map", "objects", text(&map)]);
    check(
        &refused,
        2,
        &["expected a map with things", "--things --save-map"],
    );
}
