//! Accuracy of the outlines of masks of walking people, compared with the simulator's exact masks.

#![allow(clippy::print_stdout)] // Prints the figures of docs/evidence/people.md.

use std::sync::Arc;
use stillpoint_imaging::{GrayImage, RgbdFrame, Simd};
use stillpoint_simulator::{FrameTruth, Simulator, SimulatorConfig};
use stillpoint_slam::{Config, DynamicMask, Segments};

/// Number of processed frames, and the first scored one, from which a person walks.
const FRAMES: usize = 60;
const SCORED: usize = 36;
/// Speed below which a mover is ignored, m/s: an outline does not tell whether it should be masked.
const WALKS: f64 = 0.1;
/// Maximum distance between matching outlines, px.
const NEAR: i64 = 3;

/// Truth per pixel: 1 walking, 0 static, 2 ignored.
fn truth(found: &FrameTruth) -> Vec<u8> {
    let walks = |mover: u8| {
        let of = found.boxes.iter().find(|b| b.mover == u32::from(mover));
        let velocity = of.and_then(|b| b.motion).map_or([0.0; 3], |m| m.velocity);
        velocity.iter().map(|v| v * v).sum::<f64>().sqrt() > WALKS
    };
    let kinds: Vec<u8> = (0..=255)
        .map(|mover| match mover {
            0 => 0,
            _ if walks(mover) => 1,
            _ => 2,
        })
        .collect();
    let pixels = found.mask.data().iter();
    pixels.map(|mover| kinds[usize::from(*mover)]).collect()
}

/// Sums over frames: pixels in both masks and in either; matching and total points of the found and the true outline.
#[derive(Clone, Copy, Debug, Default)]
struct Score {
    both: usize,
    either: usize,
    found: [usize; 2],
    real: [usize; 2],
}

impl Score {
    fn add(&mut self, mask: &[bool], truth: &[u8], width: usize) {
        let asked = |i: usize| truth[i] < 2;
        let found: Vec<bool> = (0..mask.len()).map(|i| mask[i] && asked(i)).collect();
        let real: Vec<bool> = truth.iter().map(|t| *t == 1).collect();
        for (found, real) in found.iter().zip(&real) {
            self.both += usize::from(*found && *real);
            self.either += usize::from(*found || *real);
        }
        let outlines = [&found, &real].map(|m| outline(m, truth, width));
        for (counts, [own, other]) in [
            (&mut self.found, [&outlines[0], &outlines[1]]),
            (&mut self.real, [&outlines[1], &outlines[0]]),
        ] {
            let near = widened(other, width, mask.len());
            counts[0] += own.iter().filter(|i| near[**i]).count();
            counts[1] += own.len();
        }
    }

    fn overlap(&self) -> f64 {
        self.both as f64 / self.either.max(1) as f64
    }

    /// The harmonic mean of the matching shares of both outlines.
    fn outline(&self) -> f64 {
        let [found, real] = [self.found, self.real].map(|[n, all]| n as f64 / all.max(1) as f64);
        2.0 * found * real / (found + real).max(1e-9)
    }
}

/// Pixels of a mask adjacent to one outside of it, except next to ignored ones.
fn outline(mask: &[bool], truth: &[u8], width: usize) -> Vec<usize> {
    let neighbours = |i: usize| {
        let left = (!i.is_multiple_of(width)).then(|| i - 1);
        let right = (i % width + 1 < width).then_some(i + 1);
        let below = (i + width < mask.len()).then_some(i + width);
        [left, right, i.checked_sub(width), below]
            .into_iter()
            .flatten()
    };
    let asked = |i: &usize| neighbours(*i).all(|j| truth[j] < 2);
    (0..mask.len())
        .filter(|i| mask[*i] && neighbours(*i).any(|j| !mask[j]))
        .filter(asked)
        .collect()
}

fn widened(points: &[usize], width: usize, count: usize) -> Vec<bool> {
    let mut near = vec![false; count];
    let (w, h) = (width as i64, (count / width) as i64);
    for i in points {
        let (x, y) = (*i as i64 % w, *i as i64 / w);
        for (dx, dy) in (-NEAR..=NEAR).flat_map(|dx| (-NEAR..=NEAR).map(move |dy| (dx, dy))) {
            let (x, y) = (x + dx, y + dy);
            if dx * dx + dy * dy <= NEAR * NEAR && x >= 0 && y >= 0 && x < w && y < h {
                near[(y * w + x) as usize] = true;
            }
        }
    }
    near
}

/// Calls `see` with every frame of a scene, its truth, and the detected regions.
fn look(
    scene: &str,
    frames: usize,
    mut see: impl FnMut(usize, &RgbdFrame, &Simulator, (&Segments, &GrayImage)),
) {
    let config = SimulatorConfig {
        scene: scene.to_owned(),
        frames: Some(frames),
        ..SimulatorConfig::default()
    };
    let simulator = Simulator::new(&config).unwrap();
    let camera = *simulator.camera();
    let mut filter = DynamicMask::new(&Config::default(), camera, Simd::detect()).unwrap();
    for i in 0..frames {
        let frame = Arc::new(simulator.frame(i));
        let found = filter.step(&frame, None).unwrap();
        see(i, &frame, &simulator, (&found.segments, &found.mask()));
    }
}

#[test]
fn outlines_of_walking_people_are_accurate() {
    let (mut masks, mut cells) = (Score::default(), Score::default());
    for scene in ["walking_xyz", "walking_static"] {
        look(scene, FRAMES, |i, frame, simulator, (segments, mask)| {
            if i < SCORED {
                return;
            }
            let truth = truth(&simulator.truth(i));
            let width = frame.gray.width();
            let fine: Vec<bool> = mask.data().iter().map(|v| *v > 0).collect();
            masks.add(&fine, &truth, width);
            let cell = |p: usize| {
                (p / width / segments.cell_px).min(segments.height - 1) * segments.width
                    + (p % width / segments.cell_px).min(segments.width - 1)
            };
            let coarse: Vec<bool> = (0..fine.len())
                .map(|p| segments.labels[cell(p)] > 0)
                .collect();
            cells.add(&coarse, &truth, width);
        });
        println!(
            "{scene}: masks {:.3} {:.3}, cells {:.3} {:.3}",
            masks.overlap(),
            masks.outline(),
            cells.overlap(),
            cells.outline()
        );
    }
    let well = |score: &Score| score.overlap() > 0.8 && score.outline() > 0.45;
    assert!(well(&masks), "{masks:?}");
    // Control: the cells from which the masks are made.
    assert!(!well(&cells), "{cells:?}");
}

#[test]
fn empty_room_is_not_masked() {
    for scene in ["xyz", "halfsphere", "rpy", "static"] {
        let (mut masked, mut all) = (0, 0);
        look(scene, FRAMES, |_, _, _, (_, mask)| {
            masked += mask.data().iter().filter(|v| **v > 0).count();
            all += mask.data().len();
        });
        let share = masked as f64 / all as f64;
        println!("{scene}: {:.3} % masked", 100.0 * share);
        assert!(share < 0.01, "{scene}: {share}");
    }
}
