//! A wall half of which repeats itself: there the flow alone cannot tell a camera that moved by one repetition from one that stood still.

use std::sync::Arc;
use stillpoint_geometry::Camera;
use stillpoint_imaging::{DepthImage, FrameId, GrayImage, RgbdFrame, Simd};
use stillpoint_slam::{Config, DynamicMask};

const WIDTH: usize = 320;
const HEIGHT: usize = 240;
/// Repetition of the right half, px. By so much the flow still follows the rest of the wall from where it was; by more it begins again where descriptors
/// say, and finds the pattern in its right place at once.
const PERIOD: usize = 8;
/// The camera stands still for this many frames.
const STILL: u32 = 12;

/// Grey of a place on the wall.
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

/// The wall, seen after a step to the side of so many px.
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

/// Share of the repeated half that is said to move when the camera steps aside by so many pixels at once.
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
    // By cells: a mask leaves out what nothing sets apart from the wall around it.
    let regions = &found.segments;
    let half: Vec<bool> = (0..regions.labels.len())
        .filter(|i| i % regions.width * regions.cell_px > WIDTH / 2 + 20)
        .map(|i| regions.labels[i] > 0)
        .collect();
    half.iter().filter(|m| **m).count() as f64 / half.len() as f64
}

/// Without the second look all of the repeated half moves.
#[test]
fn what_looks_like_its_neighbour_is_looked_for_again_where_it_should_be() {
    for step in [0, PERIOD] {
        let share = moving(step);
        assert!(share < 0.01, "{share} of it moves after {step} px");
    }
}
