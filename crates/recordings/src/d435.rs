//! Tests on a recording of a RealSense D435, in both formats of librealsense.

use crate::choose::{Named, choose};
use crate::decode::{self, depth::Unit};
use crate::optics::Optics;
use crate::probe::Probe;
use crate::realsense::device_stamps;
use crate::recording::{Files, Recording};
use crate::register::Registration;
use crate::store::Slot;
use std::path::PathBuf;
use stillpoint_geometry::{Se3, Vec2, Vec3};
use stillpoint_imaging::DepthImage;
use stillpoint_ros_messages as ros;

fn opened(ending: &str) -> Option<(PathBuf, Recording, Probe)> {
    let path = stillpoint_testdata::beside(&format!("data/recordings/d435_640x480.{ending}"))?;
    let mut recording = Files::scan(&path).unwrap().open().unwrap();
    let probe = Probe::new(&mut recording).unwrap();
    Some((path, recording, probe))
}

/// The image in a message, raw or compressed, in metres.
fn depth(recording: &mut Recording, slot: &Slot) -> DepthImage {
    let bytes = recording.read(slot).unwrap();
    if recording
        .channel(slot)
        .type_name
        .ends_with("CompressedImage")
    {
        let m: ros::CompressedImage<'_> = recording.parse(slot, &bytes).unwrap();
        decode::compressed_depth(&m.format, &m.data, Unit::default()).unwrap()
    } else {
        decode::depth(&recording.parse(slot, &bytes).unwrap(), Unit::default()).unwrap()
    }
}

fn setup(probe: &Probe, path: &std::path::Path) -> (crate::choose::Pair, Optics, Optics, Se3) {
    let pair = choose(path, probe, Named::default()).unwrap();
    let colour = Optics::new(pair.colour.info.as_ref().unwrap(), false).unwrap();
    let depth = Optics::new(pair.depth.info.as_ref().unwrap(), false).unwrap();
    let pose = probe
        .transforms
        .find(&pair.colour.frame, &pair.depth.frame)
        .unwrap();
    (pair, colour, depth, pose)
}

#[test]
fn d435_camera_depth_unit_and_extrinsics_are_read() {
    let endings = if cfg!(feature = "sqlite") {
        &["bag", "db3"][..]
    } else {
        &["bag"]
    };
    for ending in endings {
        let Some((path, mut recording, probe)) = opened(ending) else {
            return;
        };
        assert_eq!(
            probe.device.as_deref(),
            Some("Intel RealSense D435"),
            "{ending}"
        );
        assert_eq!(probe.depth_scale, Some(1000.0), "{ending}");
        let (pair, colour, depth, pose) = setup(&probe, &path);
        for (found, expected) in [
            (
                colour.k,
                [613.203_674, 613.419_312, 319.938_843, 239.182_999],
            ),
            (
                depth.k,
                [390.431_458, 390.431_458, 331.387_878, 242.187_347],
            ),
        ] {
            assert!(
                found
                    .iter()
                    .zip(expected)
                    .all(|(f, e)| (f - e).abs() < 1e-5),
                "{ending}: {found:?}"
            );
        }
        let expected = Vec3::new(0.014_311, 0.000_602, 0.000_611);
        assert!(
            (pose.translation - expected).norm() < 1e-6,
            "{ending}: {pose:?}"
        );
        // The stamps are the device's, not the time of arrival.
        let slots: Vec<Slot> = recording.slots_of(pair.depth.channel).copied().collect();
        let device = device_stamps(&mut recording, &pair.depth.topic).unwrap();
        let stamps: Vec<i64> = slots
            .iter()
            .map(|s| device.get(&s.logged).copied().or(s.stamp).unwrap())
            .collect();
        assert_eq!(stamps, [360_815_089_000, 360_981_765_000], "{ending}");
    }
}

#[cfg(feature = "sqlite")]
#[test]
fn both_librealsense_formats_give_the_same_images() {
    let Some(((path, mut bag, bag_probe), (_, mut base, base_probe))) =
        opened("bag").zip(opened("db3"))
    else {
        return;
    };
    let (a, ..) = setup(&bag_probe, &path);
    let (b, ..) = setup(&base_probe, &path);
    for (a, b) in [(&a.depth, &b.depth), (&a.colour, &b.colour)] {
        let slots = |r: &Recording, channel| r.slots_of(channel).copied().collect::<Vec<Slot>>();
        let (ours, others) = (slots(&bag, a.channel), slots(&base, b.channel));
        assert_eq!(ours.len(), others.len());
        for (x, y) in ours.iter().zip(&others) {
            if a.shows == crate::probe::Shows::Depth {
                assert_eq!(depth(&mut bag, x).data(), depth(&mut base, y).data());
            } else {
                let raw = bag.read(x).unwrap();
                let raw = decode::colour(&bag.parse(x, &raw).unwrap(), true).unwrap();
                let bytes = base.read(y).unwrap();
                let m: ros::CompressedImage<'_> = base.parse(y, &bytes).unwrap();
                let png = decode::compressed_colour(&m.data, true).unwrap();
                assert_eq!(raw.colour.unwrap().data(), png.colour.unwrap().data());
            }
        }
    }
}

/// Compares with `rs.align`: `tests/golden/README.md`. That keeps depth along the depth camera's axis; here depth is along the colour
/// camera's, so its values are converted first.
#[test]
fn registration_matches_librealsense() {
    let Some((path, mut recording, probe)) = opened("bag") else {
        return;
    };
    let (pair, colour, depth_camera, pose) = setup(&probe, &path);
    let slot = recording
        .slots_of(pair.depth.channel)
        .nth(1)
        .copied()
        .unwrap();
    let image = depth(&mut recording, &slot);
    let found = Registration::new(&depth_camera, &colour, &pose)
        .register(&image)
        .unwrap();
    let png = include_bytes!("../tests/golden/d435_aligned.png");
    let aligned = image::load_from_memory(png).unwrap().into_luma16();
    let inverse = pose.inverse();
    let (mut both, mut near, mut one) = (0, 0, 0);
    for (x, y, value) in aligned.enumerate_pixels() {
        let ours = f64::from(found.at(x as usize, y as usize));
        let theirs = f64::from(value.0[0]) / 1000.0;
        match (ours > 0.0, theirs > 0.0) {
            (true, true) => {
                let ray = colour.ray(Vec2::new(f64::from(x), f64::from(y)));
                let turned = inverse.rotation * Vec3::new(ray.x, ray.y, 1.0);
                let z = (theirs - inverse.translation.z) / turned.z;
                both += 1;
                near += i32::from((ours - z).abs() < 0.001);
            }
            (false, false) => {}
            _ => one += 1,
        }
    }
    let share = |n: i32| f64::from(n) / f64::from(both + one);
    assert!(share(near) >= 0.98, "{} within 1 mm", share(near));
    assert!(share(one) <= 0.01, "{} in one only", share(one));
}
