//! Frame sequences of a wall and a person, in cells.

use super::super::history::{CapturePose, Spent};
use super::super::rigid::Vote;
use super::*;
use crate::anchored_pose::AnchoredPose;
use crate::sensor::DepthNoise;
use std::sync::Arc;
use stillpoint_detection::{BoundingBox, ObjectId};
use stillpoint_geometry::Camera;
use stillpoint_imaging::{DepthImage, FrameId};
use stillpoint_map::KeyframeId;

/// A static camera in front of a wall at 3 m, with a person of 8 x 20 cells at 1.5 m.
struct World {
    cells: Cells,
    history: History,
    surfaces: Surfaces,
    next: Surfaces,
    memory: Memory,
    spent: Spent,
    frame: u32,
    holes: fn(usize) -> bool,
}

fn person(cell: usize, column: usize) -> bool {
    (column..column + 8).contains(&(cell % 40)) && (5..25).contains(&(cell / 40))
}

impl World {
    fn new() -> Self {
        let cells = Cells::new(
            &Camera::pinhole(320, 240, [260.0, 260.0, 159.5, 119.5]),
            DepthNoise::default(),
        );
        Self {
            surfaces: Surfaces::new(&cells),
            cells,
            history: History::default(),
            next: Surfaces::default(),
            memory: Memory::default(),
            spent: Spent::default(),
            frame: 0,
            holes: |_| false,
        }
    }

    /// The next frame at 30 Hz, with the person's left edge in a column of cells.
    fn step(&mut self, column: Option<usize>, movers: &[Mover], votes: &[Vote]) {
        self.step_in_doubt(column, movers, votes, 1.0);
    }

    /// Likewise with this certainty of the flow.
    fn step_in_doubt(
        &mut self,
        column: Option<usize>,
        movers: &[Mover],
        votes: &[Vote],
        certainty: f32,
    ) {
        let holes = self.holes;
        let depth = |i: usize| {
            let cell = i / 320 / 8 * 40 + i % 320 / 8;
            let there = column.is_some_and(|c| person(cell, c));
            match there {
                _ if holes(cell) => 0.0,
                true => 1.5,
                false => 3.0,
            }
        };
        let image = DepthImage::from_vec(320, 240, (0..320 * 240).map(depth).collect());
        let grid = Arc::new(super::super::cells::coarse(&image.unwrap()));
        let stamp = f64::from(self.frame) / 30.0;
        let now = Now {
            stamp,
            grid: &grid,
            world_from_depth: Se3::identity(),
            view: &MapView::default(),
            history: &self.history,
        };
        let mut flow = Votes::default();
        (flow.votes, flow.certainty) = (votes.to_vec(), certainty);
        let (next, memory) = (&mut self.next, &mut self.memory);
        self.surfaces
            .next(&self.cells, &now, movers, &flow, (next, memory));
        std::mem::swap(&mut self.surfaces, &mut self.next);
        let moving = self.surfaces.motion.iter().map(|o| *o > MOVES);
        let place = CapturePose {
            anchored: AnchoredPose {
                keyframe: None,
                reference: KeyframeId(0),
                reference_from_camera: Se3::identity(),
                online_world_from_camera: Se3::identity(),
            },
            camera_from_depth: Se3::identity(),
        };
        let frame = FrameId(self.frame);
        self.history.push(
            frame,
            stamp,
            Arc::clone(&grid),
            (moving, &place),
            &mut self.spent,
        );
        self.frame += 1;
    }

    /// Shares of moving cells of the person and of the wall.
    fn moving(&self, column: usize) -> (f64, f64) {
        let share = |of_person: bool| {
            let cells: Vec<usize> = (0..self.cells.count())
                .filter(|c| person(*c, column) == of_person)
                .collect();
            let moving = cells.iter().filter(|c| self.surfaces.odds[**c] > MOVES);
            moving.count() as f64 / cells.len() as f64
        };
        (share(true), share(false))
    }
}

fn mover(strength: f32) -> Mover {
    Mover {
        id: ObjectId(0),
        bounds: BoundingBox {
            x0: 95.5,
            y0: 39.5,
            x1: 159.5,
            y1: 199.5,
        },
        range: Some([1.2, 1.8]),
        weight: 5.0,
        strength,
    }
}

#[test]
fn entering_person_is_moving_and_the_wall_is_not() {
    let mut world = World::new();
    for _ in 0..30 {
        world.step(None, &[], &[]);
    }
    assert!(world.moving(12).1.abs() < f64::EPSILON);
    for i in 0..10 {
        world.step(Some(8 + i / 2), &[], &[]);
    }
    let (person, wall) = world.moving(12);
    assert!(person > 0.95, "{person}");
    assert!(wall < 0.01, "{wall}");
    // The first frame has no evidence.
    let mut blank = World::new();
    blank.step(Some(12), &[], &[]);
    assert_eq!(blank.moving(12), (0.0, 0.0));
}

#[test]
fn stopped_person_stays_suspected_for_seconds() {
    let mut world = World::new();
    for i in 0..40 {
        world.step((i >= 30).then(|| 2 + (i - 30) % 10), &[], &[]);
    }
    for i in 0..60 {
        world.step(Some(12), &[], &[]);
        let (person, wall) = world.moving(12);
        assert!(person > 0.95 && wall < 0.05, "frame {i}: {person} {wall}");
    }
    // Suspicion ends: free space of the stopped person and memory both expire.
    for _ in 0..300 {
        world.step(Some(12), &[], &[]);
    }
    assert_eq!(world.moving(12), (0.0, 0.0));
    // Control: a person static from the start is not suspected.
    let mut world = World::new();
    for _ in 0..100 {
        world.step(Some(12), &[], &[]);
    }
    assert_eq!(world.moving(12), (0.0, 0.0));
}

#[test]
fn detections_affect_only_the_current_frame() {
    let mut world = World::new();
    for _ in 0..60 {
        world.step(Some(12), &[], &[]);
    }
    // After two seconds of rest a box does not make a surface moving.
    assert!(world.moving(12).0.abs() < f64::EPSILON);
    let motion = world.surfaces.motion.clone();
    world.step(Some(12), &[mover(2.5)], &[]);
    assert!(world.moving(12).0 < 0.05);
    world.step(Some(12), &[], &[]);
    for (a, b) in motion.iter().zip(&world.surfaces.motion) {
        assert!((a - b).abs() < 0.5);
    }
    // In a new scene the box decides, for the person in it alone.
    let mut world = World::new();
    world.step(Some(12), &[mover(2.5)], &[]);
    let (person, wall) = world.moving(12);
    assert!(person > 0.9 && wall.abs() < f64::EPSILON, "{person} {wall}");
    assert!(world.surfaces.motion.iter().all(|m| m.abs() < f32::EPSILON));
    // Two boxes count as the stronger one.
    let odds = world.surfaces.odds.clone();
    let mut twice = World::new();
    twice.step(Some(12), &[mover(2.5), mover(1.0)], &[]);
    assert_eq!(twice.surfaces.odds, odds);
}

#[test]
fn flow_overrules_agreeing_depths() {
    // A smooth body that slides along itself: its depths do not change.
    let sliding: Vec<Vote> = (0..1200)
        .filter(|c| c % 3 == 0)
        .map(|cell| Vote {
            cell,
            moving: person(cell, 12),
        })
        .collect();
    let (mut world, mut control) = (World::new(), World::new());
    for _ in 0..30 {
        world.step(Some(12), &[], &sliding);
        control.step(Some(12), &[], &[]);
    }
    let (person, wall) = world.moving(12);
    assert!(
        person > 0.95 && wall.abs() < f64::EPSILON,
        "{person} {wall}"
    );
    assert_eq!(control.moving(12), (0.0, 0.0));
}

#[test]
fn person_moving_after_long_rest_is_detected_at_once() {
    let mut world = World::new();
    for _ in 0..150 {
        world.step(Some(12), &[], &[]);
    }
    assert!(world.surfaces.odds[15 * 40 + 16] < 0.0);
    // The person turns on the spot: depths do not change, only flow shows it.
    let votes: Vec<Vote> = (0..world.cells.count())
        .map(|cell| Vote {
            cell,
            moving: person(cell, 12),
        })
        .collect();
    for _ in 0..5 {
        world.step(Some(12), &[], &votes);
    }
    let (person, wall) = world.moving(12);
    assert!(person > 0.9 && wall < 0.01, "{person} {wall}");
}

#[test]
fn a_few_wrong_votes_do_not_move_a_wall() {
    let votes: Vec<Vote> = (0..1200)
        .filter(|c| c % 3 == 0)
        .map(|cell| Vote {
            cell,
            moving: cell % 15 == 0,
        })
        .collect();
    let mut world = World::new();
    for _ in 0..10 {
        world.step(None, &[], &votes);
    }
    assert!(world.moving(12).1.abs() < f64::EPSILON);
}

#[test]
fn flow_with_uncertain_camera_motion_marks_nothing() {
    let votes: Vec<Vote> = (0..1200)
        .map(|cell| Vote {
            cell,
            moving: person(cell, 12),
        })
        .collect();
    // Static surfaces stay static, and new ones do not count as moving.
    for known in [30, 0] {
        let judged = |certainty: f32| {
            let mut world = World::new();
            for _ in 0..known {
                world.step(Some(12), &[], &[]);
            }
            world.step_in_doubt(Some(12), &[], &votes, certainty);
            world.moving(12).0
        };
        // Control: the same flow with a known camera motion.
        assert!(judged(1.0) > 0.9, "{known}");
        assert!(judged(0.2).abs() < f64::EPSILON, "{known}");
    }
}

#[test]
fn depth_holes_keep_the_last_state_briefly() {
    let mut world = World::new();
    for i in 0..40 {
        world.step((i >= 30).then(|| 8 + (i - 30) / 2), &[], &[]);
    }
    world.step(Some(12), &[], &[]);
    // Neither the person nor the wall around has depth.
    world.holes = |cell| (3..30).contains(&(cell / 40));
    for i in 0..12 {
        world.step(Some(12), &[], &[]);
        let since = f64::from(i + 1) / 30.0;
        if (since - HELD).abs() < 0.01 {
            continue;
        }
        let (seen, (person, wall)) = (since < HELD, world.moving(12));
        assert_eq!(person > 0.95, seen, "frame {i}: {person}");
        assert!(seen || person == 0.0, "frame {i}: {person}");
        assert!(wall < 0.01, "frame {i}: {wall}");
        // Only cells with depth are masked.
        let labels = &world.surfaces.regions;
        let masks =
            |hole: bool| (0..labels.len()).any(|c| labels[c] > 0 && (world.holes)(c) == hole);
        assert!(!masks(true), "frame {i}");
        let middle = world.surfaces.depth[15 * 40 + 16];
        assert_eq!(middle, if seen { 1.5 } else { 0.0 }, "frame {i}");
    }
}

#[test]
fn intermittent_holes_keep_the_motion_state() {
    // The only evidence is that the person turned on the spot before; the wall behind was never seen.
    let suspected = |holes: fn(usize) -> bool| {
        let mut world = World::new();
        let all: Vec<Vote> = (0..world.cells.count())
            .map(|cell| Vote {
                cell,
                moving: person(cell, 12),
            })
            .collect();
        for _ in 0..10 {
            world.step(Some(12), &[], &all);
        }
        for i in 0..30 {
            world.holes = if i % 3 == 0 { holes } else { |_| false };
            world.step(Some(12), &[], &[]);
        }
        world.moving(12).0
    };
    assert!(suspected(|_| false) > 0.95);
    assert!(suspected(|cell| person(cell, 12)) > 0.95);
    assert!(suspected(|_| true) > 0.95);
}
