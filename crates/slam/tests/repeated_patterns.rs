//! A half-repetitive wall: flow alone cannot tell a camera that moved by one period from a static one.

use std::sync::Arc;
use stillpoint_geometry::Camera;
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame, Simd};
use stillpoint_slam::{Config, DynamicMask};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// Period of the right half, px. Up to this the flow still tracks the rest of the wall; beyond, it restarts from
/// descriptors and finds the pattern correctly at once.
const PERIOD: usize = 8;
/// Number of frames without camera motion.
const STILL: u32 = 12;

fn grey(x: usize, y: usize) -> u8 {
    // Blocks of 4 px, so that there are corners.
    let hash = |a: usize, b: usize| {
        let h = (a as u64).wrapping_mul(0x9E37_79B9_7F4A_7C15)
            ^ (b as u64).wrapping_mul(0xC2B2_AE3D_27D4_EB4F);
        let h = (h ^ (h >> 29)).wrapping_mul(0xBF58_476D_1CE4_E5B9);
        (h >> 56) as u8
    };
    let wide = WIDTH / 2 + PERIOD;
    if x < wide {
        hash(x / 4, y / 4)
    } else {
        hash(1000 + (x - wide) % PERIOD / (PERIOD / 2), y / 4)
    }
}

/// The wall, seen after a sideways step of `shift` px.
fn frame(id: u32, shift: usize) -> RgbdFrame {
    let pixels = (0..WIDTH * HEIGHT).map(|i| grey(i % WIDTH + shift, i / WIDTH));
    RgbdFrame {
        id: FrameId(id),
        stamp: f64::from(id) / 30.0,
        depth_stamp: f64::from(id) / 30.0,
        gray: GrayImage::from_vec(WIDTH, HEIGHT, pixels.collect()).unwrap(),
        colour: None,
        depth: DepthImage::from_vec(WIDTH, HEIGHT, vec![1.5; WIDTH * HEIGHT]).unwrap(),
    }
}

/// Share of the repetitive half detected as moving after a sudden sideways step.
fn moving(step: usize) -> f64 {
    let camera = Camera::pinhole(WIDTH as u32, HEIGHT as u32, [260.0, 260.0, 159.5, 119.5]);
    let mut filter = DynamicMask::new(&Config::default(), camera, Simd::detect()).unwrap();
    for id in 0..STILL {
        let found = filter.step(&Arc::new(frame(id, 0)), None).unwrap();
        assert!(found.world_from_camera.is_some(), "frame {id}");
    }
    let found = filter.step(&Arc::new(frame(STILL, step)), None).unwrap();
    let aside = found.world_from_camera.unwrap().translation.norm();
    let expected = step as f64 * 1.5 / 260.0;
    assert!(
        (aside - expected).abs() < 0.01,
        "{aside} instead of {expected}"
    );
    // By cells: masks omit regions not separated from the wall around.
    let regions = &found.segments;
    let half: Vec<bool> = (0..regions.labels.len())
        .filter(|i| i % regions.width * regions.cell_px > WIDTH / 2 + 20)
        .map(|i| regions.labels[i] > 0)
        .collect();
    half.iter().filter(|m| **m).count() as f64 / half.len() as f64
}

/// Without the second search all of the repetitive half moves.
#[test]
fn repetitive_pattern_is_searched_at_its_expected_place() {
    for step in [0, PERIOD] {
        let share = moving(step);
        assert!(share < 0.01, "{share} of it moves after {step} px");
    }
}
